"""The pages of a layout sheet: an overview, and tiles of the table in true size."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import product

import numpy as np

from duobench.fabrication.pdf import Page
from duobench.robot.workcell import TABLE_X, TABLE_Y
from duobench.types import Array

RULER = 100.0
"""Length of the rulers in mm."""
GRID = 50.0
"""Distance of the marks of a tile in mm."""
LABEL = 12.0
"""Room that the place of a mark takes, in mm."""
MARGIN, FOOT = 12.0, 22.0
"""White around a tile, and below it for the ruler, in mm."""


Tile = tuple[int, int]
"""Row and column of a tile, along the table's x and y."""
Box = tuple[float, float, float, float]
"""Left, lower, right and upper edge in mm."""


class Paper(StrEnum):
    """Sizes of paper, upright."""

    A4 = "a4"
    A3 = "a3"

    @property
    def size(self) -> tuple[float, float]:
        """Width and height in mm."""
        return (210.0, 297.0) if self is Paper.A4 else (297.0, 420.0)

    @property
    def tile(self) -> tuple[float, float]:
        """Width and height in mm of what a sheet shows of the table."""
        width, height = self.size
        return 10 * ((width - 2 * MARGIN) // 10), 10 * ((height - MARGIN - FOOT) // 10)


@dataclass(frozen=True, kw_only=True, slots=True)
class Mark:
    """Where one object is, and its outlines on the table in mm."""

    name: str
    x: float
    y: float
    yaw: float
    on_table: bool
    contact: tuple[Array, ...] = ()
    seen: tuple[Array, ...] = ()

    @property
    def words(self) -> str:
        """Its place in millimetres and degrees."""
        return f"x {self.x:.1f}, y {self.y:.1f} mm, yaw {self.yaw:.1f}°"


def tiles_of(marks: Sequence[Mark], paper: Paper) -> list[Tile]:
    """Rows and columns of the tiles that an outline touches; the middle column has y = 0."""
    width, height = paper.tile
    found = set()
    for mark in marks:
        for outline in mark.seen:
            low, high = outline.min(axis=0), outline.max(axis=0)
            rows = range(math.floor(low[0] / height), math.floor(high[0] / height) + 1)
            columns = range(math.floor(low[1] / width + 0.5), math.floor(high[1] / width + 0.5) + 1)
            found |= set(product(rows, columns))
    return sorted(found, key=lambda each: (-each[0], -each[1]))


def overview(
    title: str,
    marks: Sequence[Mark],
    tiles: Sequence[Tile],
    paper: Paper,
) -> Page:
    """All objects in small, with the tiles, and a table of their places."""
    page = Page(*paper.size)
    width, height = page.width - 2 * MARGIN, page.height
    page.text(MARGIN, height - 20, title, 5.0, bold=True)
    for number, line in enumerate(_explanation(tiles, paper)):
        page.text(MARGIN, height - 28 - 5 * number, line, 2.6)
    table_x, table_y = (tuple(1000 * v for v in edge) for edge in (TABLE_X, TABLE_Y))
    scale = width / (table_y[1] - table_y[0])
    top = height - 62

    def at(x: float, y: float) -> tuple[float, float]:
        return MARGIN + scale * (table_y[1] - y), top - scale * (table_x[1] - x)

    corners = [(x, y) for x, y in zip(_around(table_x, 0), _around(table_y, 1), strict=True)]
    page.polygon([at(*corner) for corner in corners], grey=0.5)
    tile_width, tile_height = paper.tile
    for number, (row, column) in enumerate(tiles, 1):
        x, y = row * tile_height, (column + 0.5) * tile_width
        edges = [(x, y), (x, y - tile_width), (x + tile_height, y - tile_width)]
        edges.append((x + tile_height, y))
        page.polygon([at(*edge) for edge in edges], line=0.15, grey=0.6, dash=1.0)
        left, low = at(x, y)
        page.text(left + 1, low + 1, str(number), 2.6)
    for number, mark in enumerate((m for m in marks if m.on_table), 1):
        for outline in mark.seen:
            page.polygon([at(*point) for point in outline], line=0.2, fill=0.85)
        page.text(*at(mark.x, mark.y), str(number), 2.4, bold=True)
    x, y = at(0.0, 0.0)
    page.line((x - 4, y), (x + 4, y))
    page.line((x, y - 4), (x, y + 4))
    page.text(x + 2, y + 2, "x = 0, y = 0", 2.2)
    _places(page, marks, top - scale * (table_x[1] - table_x[0]) - 10)
    return page


def _explanation(tiles: Sequence[Tile], paper: Paper) -> tuple[str, ...]:
    return (
        f"Print all pages at 100 % on {paper.value.upper()}; each sheet has two rulers of "
        f"{RULER:.0f} mm to check that.",
        f"{len(tiles)} sheets follow. Cut them at their frames and lay them edge to edge, as",
        "below. Up is away from the robot (x), left is the robot's left (y). x = 0, y = 0 is",
        "under the middle of the mount; corners of the sheets have their places in mm.",
        "Full lines are what lies on the table; dashed ones what is above it.",
    )


def _places(page: Page, marks: Sequence[Mark], top: float) -> None:
    """The table of objects and their places."""
    standing = [mark for mark in marks if mark.on_table]
    lines = [f"{number}  {mark.name}: {mark.words}" for number, mark in enumerate(standing, 1)]
    others = [mark for mark in marks if not mark.on_table]
    if len(others) > 3:  # noqa: PLR2004 - a heap, such as of marbles
        lines.append(f"In or on another object: {others[0].name} to {others[-1].name}")
    else:
        lines += [f"In or on another object: {mark.name}, {mark.words}" for mark in others]
    for number, line in enumerate(lines):
        page.text(MARGIN, top - 5.5 * number, line, 2.8)


def tile_page(title: str, place: Tile, marks: Sequence[Mark], paper: Paper) -> Page:
    """One tile in true size."""
    page = Page(*paper.size)
    width, height = paper.tile
    low_x, high_y = place[0] * height, (place[1] + 0.5) * width
    left = (page.width - width) / 2
    bottom = page.height - MARGIN - height

    def at(x: float, y: float) -> tuple[float, float]:
        return left + high_y - y, bottom + x - low_x

    for x in np.arange(math.ceil(low_x / GRID) * GRID, low_x + height + 1e-6, GRID):
        for y in np.arange(math.ceil((high_y - width) / GRID) * GRID, high_y + 1e-6, GRID):
            across, up = at(x, y)
            page.line((across - 2, up), (across + 2, up), line=0.1, grey=0.5)
            page.line((across, up - 2), (across, up + 2), line=0.1, grey=0.5)
            if across + LABEL < left + width:
                page.text(across + 0.6, up + 0.6, f"{x:.0f}, {y:.0f}", 1.3)
    inside = (left, bottom, left + width, bottom + height)
    for mark in marks:
        for outline in mark.seen:
            _clipped(page, [at(*point) for point in outline], inside, line=0.2, dash=1.5)
        for outline in mark.contact:
            _clipped(page, [at(*point) for point in outline], inside, line=0.4)
        if mark.on_table:
            _cross(page, mark, at(mark.x, mark.y), inside)
    frame = [(left, bottom), (left + width, bottom)]
    frame += [(x, y + height) for x, y in reversed(frame)]
    page.polygon(frame, line=0.15, dash=2.0, grey=0.4)
    corner = f"lower left corner: x {low_x:.0f}, y {high_y:.0f} mm"
    page.text(left, bottom - 5.5, f"{title}; {corner}", 2.2)
    _ruler(page, left, bottom - 14)
    _upright_ruler(page, left - 6, bottom)
    return page


def _cross(
    page: Page,
    mark: Mark,
    at: tuple[float, float],
    inside: Box,
) -> None:
    """An object's origin, an arrow along its x, and its place in words."""
    x, y = at
    if not (inside[0] <= x <= inside[2] and inside[1] <= y <= inside[3]):
        return
    angle = math.radians(mark.yaw)
    ahead = (-math.sin(angle), math.cos(angle))  # the table's x is up, its y to the left
    tip = (x + 12 * ahead[0], y + 12 * ahead[1])
    page.line((x, y), tip, line=0.3)
    for side in (-1, 1):
        turn = angle + side * 2.7
        page.line(tip, (tip[0] - 3 * math.sin(turn), tip[1] + 3 * math.cos(turn)), line=0.3)
    page.line((x - 3, y), (x + 3, y), line=0.2)
    page.line((x, y - 3), (x, y + 3), line=0.2)
    begin = min(x + 2, inside[2] - 62)
    page.text(begin, y - 5, mark.name, 2.6, bold=True)
    page.text(begin, y - 9, mark.words, 2.2)


def _clipped(
    page: Page,
    points: Sequence[tuple[float, float]],
    inside: Box,
    **style: float,
) -> None:
    """The parts of an outline that lie on a tile."""
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
            ends = [
                tuple(a + share * (b - a) for a, b in zip(start, end, strict=True))
                for share in (first, last)
            ]
            page.line(*ends, **style)


def _ruler(page: Page, x: float, y: float) -> None:
    page.line((x, y), (x + RULER, y))
    for k in range(int(RULER) // 10 + 1):
        page.line((x + 10 * k, y), (x + 10 * k, y + (3 if k % 5 == 0 else 2)))
    page.text(x + RULER + 2, y, f"{RULER:.0f} mm", 2.4)


def _upright_ruler(page: Page, x: float, y: float) -> None:
    page.line((x, y), (x, y + RULER))
    for k in range(int(RULER) // 10 + 1):
        page.line((x, y + 10 * k), (x + (3 if k % 5 == 0 else 2), y + 10 * k))


def _around(edges: tuple[float, ...], phase: int) -> tuple[float, ...]:
    """The corners of a rectangle along one axis, in turn."""
    low, high = edges
    return (low, low, high, high) if phase else (low, high, high, low)
