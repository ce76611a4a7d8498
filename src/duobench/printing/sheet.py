"""The layout sheet: footprints of a layout's objects in their true size, on tiles of paper.

On paper up is away from the robot (the table's x), and left is the robot's left (y). Tiles lie edge
to edge on a grid of the table, the first one against the jig's front edge. What no object touches,
and leads to none, is left out.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from duobench.core.errors import check_known
from duobench.core.randomness import Uniform
from duobench.core.sheets import Paper, Sheet, pdf
from duobench.core.spatial import SE3
from duobench.core.types import Array
from duobench.printing import jig
from duobench.tasks.task import Task
from duobench.world.objects.prop import Prop
from duobench.world.objects.solid import manifold_from, placed, printable
from duobench.world.robot.workcell import TABLE_X, TABLE_Y
from duobench.world.sim.layout import Layout

CONTACT = 0.002
"""Height in metres above its lowest point up to which an object counts as lying on the table."""
_SMALLEST = 1e-8
"""Area in m² under which a polygon is what arithmetic leaves."""
RULER = 100.0
GRID = 50.0
"""Distance of the marks of a tile in mm."""
LABEL = 12.0
"""Room that the place of a mark takes, in mm."""
MARGIN, FOOT = 12.0, 22.0
"""White around a tile, and below it for the ruler, in mm."""
START = 1000 * jig.LINE
"""Beginning of the first row of tiles: x in mm."""
FIRST = (0, 0)
"""The tile that lies against the jig, its lower edge's middle at the notch."""
Tile = tuple[int, int]
"""Row and column of a tile, along the table's x and y."""
Box = tuple[float, float, float, float]
"""Left, lower, right and upper edge in mm."""
Point = tuple[float, float]


def outlines_of(
    prop: Prop, variants: Mapping[str, str] | None = None, *, below: float | None = None
) -> tuple[Array, ...]:
    """The footprint of an object that stands upright, all its hinges at zero.

    Args:
        prop: The object.
        variants: Variants of the layout, `Layout.variants`; by default the first of each.
        below: Height in metres above its lowest point; higher parts are left out. None takes all.

    Returns:
        Outer outlines without their holes in the object's own frame, in metres: points (n, 2),
        counter-clockwise, the longest outline first.

    Raises:
        UnknownNameError: The variants lack a value of the object's choice.
    """
    import manifold3d

    if variants is None and prop.choice is not None:
        variants = {prop.choice: min(prop.variants, key=as_counted)}
    root, *others = prop.prints(variants or {})
    poses = [SE3(), *(part.pose for part in prop.parts)]
    solids = [
        placed(manifold_from(printable(solid)), pose)
        for solid, pose in zip((root, *others), poses, strict=True)
    ]
    if below is not None:
        top = min(solid.bounding_box()[2] for solid in solids) + below
        solids = [solid.trim_by_plane((0.0, 0.0, -1.0), -top) for solid in solids]
    shadows = [solid.project() for solid in solids]
    whole = manifold3d.CrossSection.batch_boolean(shadows, manifold3d.OpType.Add)
    polygons = [np.array(polygon) for polygon in whole.simplify(1e-6).to_polygons()]
    outer = [polygon for polygon in polygons if _area(polygon) > _SMALLEST]
    return tuple(sorted(outer, key=_area, reverse=True))


def outlines_on_table(
    prop: Prop, layout: Layout, below: float | None
) -> tuple[Array, ...]:
    """Outlines of an object in the table frame, at its pose in a layout; see `outlines_of`."""
    pose = layout.poses[prop.name]
    upright = SE3.at(*pose.translation[:2], yaw=pose.yaw)
    return tuple(
        upright.apply(np.column_stack([outline, np.zeros(len(outline))]))[:, :2]
        for outline in outlines_of(prop, layout.variants, below=below)
    )


def neutral_layout(task: Task) -> Layout:
    """A layout that belongs to no seed: everything in the middle of where it may be.

    Raises:
        LayoutError: The task leaves an object without a place.
    """
    middle = Layout(
        poses={
            name: SE3.at(
                _middle(place.x), _middle(place.y), place.z, yaw=_middle(place.yaw)
            )
            for name, place in task.placements.items()
        },
        variants={name: choice.options[0] for name, choice in task.variants.items()},
    )
    return task.arranged(middle)


def layout_sheet(
    task: Task, layout: Layout, title: str = "neutral layout", paper: Paper = Paper.A4
) -> bytes:
    """The sheet as the bytes of a PDF file: a page that shows all, then the tiles.

    The title says what layout that is.

    Raises:
        UnknownNameError: The layout lacks an object, or a value of its choice.
    """
    marks = tuple(marks_of(task, layout))
    tiles = _tiles_of(marks, paper)
    pages = [_overview(f"{task.title}: {title}", marks, tiles, paper)]
    pages += [
        _tile_sheet(
            f"{task.id}, {title}: sheet {number} of {len(tiles)}", place, marks, paper
        )
        for number, place in enumerate(tiles, 1)
    ]
    return pdf(pages, f"DuoBench {task.id}: {title}")


def marks_of(task: Task, layout: Layout) -> Iterator[Mark]:
    """Places of the objects of a task in a layout, in the order of the task."""
    for prop in task.props:
        check_known("object of the layout", prop.name, layout.poses)
        pose = layout.poses[prop.name]
        x, y, z = (1000 * float(v) for v in pose.translation)
        yaw = math.degrees(pose.yaw)
        name = " ".join(
            filter(None, (prop.name, layout.variants.get(prop.choice or "")))
        )
        solids = prop.prints(layout.variants)
        poses = [SE3(), *(part.pose for part in prop.parts)]
        lowest = min(
            float(at.apply(printable(solid).vertices)[:, 2].min())
            for solid, at in zip(solids, poses, strict=True)
        )
        if z / 1000 + lowest > CONTACT:
            yield Mark(
                name=name,
                x=x,
                y=y,
                yaw=yaw,
                on_table=False,
            )
            continue
        contact, seen = (
            tuple(1000 * outline for outline in outlines_on_table(prop, layout, below))
            for below in (CONTACT, None)
        )
        yield Mark(
            name=name, x=x, y=y, yaw=yaw, on_table=True, contact=contact, seen=seen
        )


def _area(polygon: Array) -> float:
    """Area in m², negative for one that runs clockwise."""
    x, y = polygon.T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


def _middle(values: Uniform) -> float:
    return (values.low + values.high) / 2


def as_counted(name: str) -> tuple[int, str]:
    """Numbers in their order, before names."""
    return (int(name), "") if name.isdigit() else (10**9, name)


# --- drawing ---


def tile_size(paper: Paper) -> tuple[float, float]:
    """Width and height in mm of what a sheet shows of the table."""
    width, height = paper.size
    return 10 * ((width - 2 * MARGIN) // 10), 10 * ((height - MARGIN - FOOT) // 10)


@dataclass(frozen=True, kw_only=True, slots=True)
class Mark:
    """Place of one object: x and y in mm from the middle of the robot's base, yaw in degrees."""

    name: str
    """Name with the variant of the layout, such as "board 4"."""
    x: float
    y: float
    yaw: float
    on_table: bool
    """Whether it stands on the table, and not in or on another object, with which it is placed."""
    contact: tuple[Array, ...] = ()
    """Outlines (n, 2) in mm of what touches the table."""
    seen: tuple[Array, ...] = ()
    """The same as seen from above."""

    @property
    def words(self) -> str:
        """Its place, for people."""
        return f"x {self.x:.1f}, y {self.y:.1f} mm, yaw {self.yaw:.1f}°"


def _tiles_of(marks: Sequence[Mark], paper: Paper) -> list[Tile]:
    """Rows and columns of the tiles that an outline touches, and of those that lead to them.

    The middle column has y = 0. Each tile but the first lies beside an earlier one.
    """
    width, height = tile_size(paper)
    found = {FIRST}
    for mark in marks:
        for outline in mark.seen:
            low, high = outline.min(axis=0), outline.max(axis=0)
            near, far = ((x - START) / height for x in (low[0], high[0]))
            rows = range(math.floor(near), math.floor(far) + 1)
            columns = range(
                math.floor(low[1] / width + 0.5), math.floor(high[1] / width + 0.5) + 1
            )
            found |= set(product(rows, columns))
    for row, column in sorted(found, key=_from_jig):
        down, across = int(np.sign(row)), int(np.sign(column))
        nearer = {(row - down, column), (row, column - across)} - {(row, column)}
        if nearer and not nearer & found:
            found |= {(0, k) for k in range(min(column, 0), max(column, 0) + 1)}
            found |= {(k, column) for k in range(min(row, 0), max(row, 0) + 1)}
    return sorted(found, key=_from_jig)


def _from_jig(tile: Tile) -> tuple[int, int, int]:
    """Order of tiles from the jig: row by row, and in a row from its middle."""
    return abs(tile[0]), abs(tile[1]), -tile[1]


def _overview(
    title: str, marks: Sequence[Mark], tiles: Sequence[Tile], paper: Paper
) -> Sheet:
    """All objects in small, with the tiles, and a table of their places."""
    sheet = Sheet(*paper.size)
    width, height = sheet.width - 2 * MARGIN, sheet.height
    sheet.text(
        MARGIN,
        height - 20,
        title,
        5.0,
        bold=True,
    )
    explanation = (
        f"Print all pages at 100 % on {paper.value.upper()}; each sheet has two rulers of "
        f"{RULER:.0f} mm to check that.",
        f"{len(tiles)} sheets follow. Cut them at their frames. Sheet 1 lies against the jig, its",
        "mark at the notch (duobench print jig), and the others edge to edge with it, as they do",
        "below. Up is away from the robot (x), left is the robot's left (y). x = 0, y = 0 is",
        f"under the middle of the mount, {START:.0f} mm behind the notch. Places are in mm.",
        "Full lines are what lies on the table; dashed ones what is above it.",
    )
    for number, line in enumerate(explanation):
        sheet.text(MARGIN, height - 28 - 5 * number, line, 2.6)
    (low_x, high_x), (low_y, high_y) = (
        1000 * np.array(edge) for edge in (TABLE_X, TABLE_Y)
    )
    scale = width / (high_y - low_y)
    top = height - 67

    def at(x: float, y: float) -> tuple[float, float]:
        return MARGIN + scale * (high_y - y), top - scale * (high_x - x)

    sheet.polygon(_rectangle(at(low_x, high_y), at(high_x, low_y)), grey=0.5)
    tile_width, tile_height = tile_size(paper)
    for number, (row, column) in enumerate(tiles, 1):
        x, y = START + row * tile_height, (column + 0.5) * tile_width
        left, low = at(x, y)
        frame = _rectangle((left, low), at(x + tile_height, y - tile_width))
        sheet.polygon(
            frame,
            line=0.15,
            grey=0.6,
            dash=1.0,
        )
        sheet.text(left + 1, low + 1, str(number), 2.6)
    for number, mark in enumerate((m for m in marks if m.on_table), 1):
        for outline in mark.seen:
            sheet.polygon([at(*point) for point in outline], line=0.2, fill=0.85)
        sheet.text(
            *at(mark.x, mark.y),
            str(number),
            2.4,
            bold=True,
        )
    half = 500 * jig.WIDTH
    edge = _rectangle(at(START - 1000 * jig.BAR, half), at(START, -half))
    sheet.polygon(
        edge,
        line=0.2,
        grey=0.4,
        fill=0.95,
    )
    x, y = at(0.0, 0.0)
    _plus(sheet, x, y, 4)
    sheet.text(x + 2, y + 2, "x = 0, y = 0", 2.2)
    _places(sheet, marks, top - scale * (high_x - low_x) - 10)
    return sheet


def _places(
    sheet: Sheet,
    marks: Sequence[Mark],
    top: float,
) -> None:
    standing = [mark for mark in marks if mark.on_table]
    lines = [
        f"{number}  {mark.name}: {mark.words}"
        for number, mark in enumerate(standing, 1)
    ]
    others = [mark for mark in marks if not mark.on_table]
    if len(others) > 3:  # noqa: PLR2004 - a heap, such as of marbles
        lines.append(f"In or on another object: {others[0].name} to {others[-1].name}")
    else:
        lines += [
            f"In or on another object: {mark.name}, {mark.words}" for mark in others
        ]
    for number, line in enumerate(lines):
        sheet.text(MARGIN, top - 5.5 * number, line, 2.8)


def _tile_sheet(
    title: str,
    place: Tile,
    marks: Sequence[Mark],
    paper: Paper,
) -> Sheet:
    sheet = Sheet(*paper.size)
    width, height = tile_size(paper)
    low_x, high_y = START + place[0] * height, (place[1] + 0.5) * width
    left = (sheet.width - width) / 2
    bottom = sheet.height - MARGIN - height

    def at(x: float, y: float) -> tuple[float, float]:
        return left + high_y - y, bottom + x - low_x

    columns = np.arange(math.ceil((high_y - width) / GRID) * GRID, high_y + 1e-6, GRID)
    rows = np.arange(math.ceil(low_x / GRID) * GRID, low_x + height + 1e-6, GRID)
    for x, y in product(rows, columns):
        across, up = at(x, y)
        _plus(
            sheet,
            across,
            up,
            2,
            line=0.1,
            grey=0.5,
        )
        if across + LABEL < left + width:
            sheet.text(across + 0.6, up + 0.6, f"{x:.0f}, {y:.0f}", 1.3)
    inside = (left, bottom, left + width, bottom + height)
    for mark in marks:
        for outlines, style in (
            (mark.seen, {"line": 0.2, "dash": 1.5}),
            (mark.contact, {"line": 0.4}),
        ):
            for outline in outlines:
                for start, end in _clipped([at(*point) for point in outline], inside):
                    sheet.line(start, end, **style)
        if mark.on_table:
            _cross(sheet, mark, at(mark.x, mark.y), inside)
    frame = _rectangle((left, bottom), (left + width, bottom + height))
    sheet.polygon(
        frame,
        line=0.15,
        dash=2.0,
        grey=0.4,
    )
    if place == FIRST:
        _mark_of_jig(sheet, *at(START, 0.0))
    corner = f"lower left corner: x {low_x:.0f}, y {high_y:.0f} mm"
    sheet.text(left, bottom - 5.5, f"{title}; {corner}", 2.2)
    _rulers(sheet, (left, bottom - 14), (left - 6, bottom))
    return sheet


def _mark_of_jig(
    sheet: Sheet,
    x: float,
    y: float,
) -> None:
    """Mark that meets the notch of the jig."""
    sheet.polygon(((x, y), (x - 3, y + 6), (x + 3, y + 6)), line=0.15, fill=0.0)
    sheet.text(x + 5, y + 2, "this edge against the jig, this mark at its notch", 2.2)


def _cross(
    sheet: Sheet,
    mark: Mark,
    at: tuple[float, float],
    inside: Box,
) -> None:
    """An object's origin, an arrow along its x, and its place in words."""
    x, y = at
    if not (inside[0] <= x <= inside[2] and inside[1] <= y <= inside[3]):
        return
    angle = math.radians(mark.yaw)
    # The table's x is up, its y to the left.
    tip = (x - 12 * math.sin(angle), y + 12 * math.cos(angle))
    sheet.line((x, y), tip, line=0.3)
    for side in (-1, 1):
        turn = angle + side * 2.7
        sheet.line(
            tip, (tip[0] - 3 * math.sin(turn), tip[1] + 3 * math.cos(turn)), line=0.3
        )
    _plus(
        sheet,
        x,
        y,
        3,
        line=0.2,
    )
    begin = min(x + 2, inside[2] - 62)
    base = y - 5 if y - 10 > inside[1] else y + 7
    sheet.text(
        begin,
        base,
        mark.name,
        2.6,
        bold=True,
    )
    sheet.text(begin, base - 4, mark.words, 2.2)


def _clipped(points: Sequence[Point], inside: Box) -> Iterator[tuple[Point, Point]]:
    """The parts of a closed outline's lines that lie in a box."""
    left, low, right, high = inside
    for start, end in zip(points, [*points[1:], points[0]], strict=True):
        first, last = 0.0, 1.0
        for a, b, least, most in (
            (start[0], end[0], left, right),
            (start[1], end[1], low, high),
        ):
            if abs(b - a) < 1e-9:  # noqa: PLR2004 - parallel to the edge
                if not least <= a <= most:
                    last = -1.0
                continue
            enter, leave = sorted(((least - a) / (b - a), (most - a) / (b - a)))
            first, last = max(first, enter), min(last, leave)
        if first < last:
            way = (end[0] - start[0], end[1] - start[1])
            one, other = (
                (start[0] + share * way[0], start[1] + share * way[1])
                for share in (first, last)
            )
            yield one, other


def _rulers(
    sheet: Sheet,
    flat: Point,
    upright: Point,
) -> None:
    """Two rulers from their zeros: one to the right, one up."""
    for (x, y), (across, up) in ((flat, (1, 0)), (upright, (0, 1))):
        sheet.line((x, y), (x + RULER * across, y + RULER * up))
        for k in range(int(RULER) // 10 + 1):
            mark = (x + 10 * k * across, y + 10 * k * up)
            length = 3 if k % 5 == 0 else 2
            sheet.line(mark, (mark[0] + length * up, mark[1] + length * across))
    sheet.text(flat[0] + RULER + 2, flat[1], f"{RULER:.0f} mm", 2.4)


def _plus(
    sheet: Sheet,
    x: float,
    y: float,
    half: float,
    **style: float,
) -> None:
    sheet.line((x - half, y), (x + half, y), **style)
    sheet.line((x, y - half), (x, y + half), **style)


def _rectangle(low: Point, high: Point) -> list[Point]:
    return [low, (high[0], low[1]), high, (low[0], high[1])]
