"""The layout sheet: footprints of a layout's objects in their true size, on tiles of paper.

On paper up is away from the robot (the table's x), and left is the robot's left (y). Tiles lie edge
to edge on a grid of the table; what no object touches is left out.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from duobench.errors import check_known
from duobench.fabrication.pdf import pdf
from duobench.fabrication.sheet_pages import Mark, Paper, overview, tile_page, tiles_of
from duobench.objects.prop import Prop
from duobench.objects.solid import manifold_from, placed, printable
from duobench.sim.layout import Layout
from duobench.spatial import SE3
from duobench.tasks.task import Task
from duobench.types import Array

CONTACT = 0.002
"""Height in metres above its lowest point up to which an object counts as lying on the table."""
_SMALLEST = 1e-8
"""Area in m² under which a polygon is what arithmetic leaves."""


def outlines_of(
    prop: Prop, variants: Mapping[str, str] | None = None, *, below: float | None = None
) -> tuple[Array, ...]:
    """The footprint of an object that stands upright, all its hinges at zero.

    Args:
        prop: The object.
        variants: Those of the layout, `Layout.variants`; the first of each by default.
        below: Only what is lower than this, in metres above its lowest point; by default all of it,
            as seen from above.

    Returns:
        Outer outlines in the object's own frame, in metres: points (n, 2), counter-clockwise, the
        longest outline first. Holes in them are left out.

    Raises:
        UnknownNameError: The variants lack a value of the object's choice.
    """
    import manifold3d

    if variants is None and prop.choice is not None:
        variants = {prop.choice: min(prop.variants, key=_as_counted)}
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


def neutral_layout(task: Task) -> Layout:
    """A layout that belongs to no seed: everything in the middle of where it may be.

    Raises:
        LayoutError: The task leaves an object without a place.
    """
    middle = Layout(
        poses={
            name: SE3.at(
                _middle(place.x.low, place.x.high),
                _middle(place.y.low, place.y.high),
                place.z,
                yaw=_middle(place.yaw.low, place.yaw.high),
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

    Args:
        task: The task.
        layout: Where its objects are.
        title: What layout that is, in words.
        paper: What it is printed on.

    Raises:
        UnknownNameError: The layout lacks an object, or a value of its choice.
    """
    marks = tuple(_marks(task, layout))
    tiles = tiles_of(marks, paper)
    pages = [overview(f"{task.title}: {title}", marks, tiles, paper)]
    pages += [
        tile_page(f"{task.id}, {title}: sheet {number} of {len(tiles)}", place, marks, paper)
        for number, place in enumerate(tiles, 1)
    ]
    return pdf(pages, f"DuoBench {task.id}: {title}")


def _marks(task: Task, layout: Layout) -> Iterator[Mark]:
    """Where the objects are; outlines of those that stand on the table."""
    for prop in task.props:
        check_known("object of the layout", prop.name, layout.poses)
        pose = layout.poses[prop.name]
        x, y, z = (1000 * float(v) for v in pose.translation)
        yaw = math.degrees(pose.yaw)
        name = " ".join(filter(None, (prop.name, layout.variants.get(prop.choice or ""))))
        solids = prop.prints(layout.variants)
        poses = [SE3(), *(part.pose for part in prop.parts)]
        lowest = min(
            float(at.apply(printable(solid).vertices)[:, 2].min())
            for solid, at in zip(solids, poses, strict=True)
        )
        if z / 1000 + lowest > CONTACT:
            yield Mark(name=name, x=x, y=y, yaw=yaw, on_table=False)
            continue
        contact, seen = (
            tuple(_on_table(outline, pose) for outline in outlines_of(prop, variants, below=below))
            for variants, below in ((layout.variants, CONTACT), (layout.variants, None))
        )
        yield Mark(name=name, x=x, y=y, yaw=yaw, on_table=True, contact=contact, seen=seen)


def _on_table(outline: Array, pose: SE3) -> Array:
    """An outline in an object's frame as points (n, 2) of the table frame in mm."""
    points = np.column_stack([outline, np.zeros(len(outline))])
    return 1000 * SE3.at(*pose.translation[:2], yaw=pose.yaw).apply(points)[:, :2]


def _area(polygon: Array) -> float:
    """Area in m², negative for one that runs clockwise."""
    x, y = polygon.T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


def _middle(low: float, high: float) -> float:
    return (low + high) / 2


def _as_counted(name: str) -> tuple[int, str]:
    """Numbers in their order, before names."""
    return (int(name), "") if name.isdigit() else (10**9, name)
