"""Where parts lie on the beds of a printer, without overlapping, and clear of one corner."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from duobench.fabrication.parts import PrintedPart
from duobench.objects.shapes import KEPT_FREE, PRINTER

GAP = 0.006
"""Distance between parts in metres: room for brims, and for the nozzle's hood."""


BESIDE, BEHIND = PRINTER - KEPT_FREE[0], PRINTER - KEPT_FREE[1]
"""Width of the bed beside the corner that is kept free, and depth behind it, in metres."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Spot:
    """Where one copy of a part lies."""

    part: PrintedPart
    copy: int
    """Which of its copies, from 0."""
    bed: int
    x: float
    """Middle of the part's box on the bed, in metres from its left edge."""
    y: float
    """The same from its front edge."""


@dataclass(slots=True)
class _Row:
    """Parts side by side."""

    front: float
    depth: float
    used: float = 0.0
    spots: list[tuple[PrintedPart, int, float]] = field(default_factory=list)

    def add(self, part: PrintedPart, copy: int) -> bool:
        """Put a part to the right of the others, if there is room."""
        width, depth, _ = part.size
        begin = self.used + GAP if self.spots else 0.0
        if depth > self.depth or begin + width > (BESIDE if self.spots else PRINTER):
            return False
        self.spots.append((part, copy, begin + width / 2))
        self.used = begin + width
        return True


def lay_out(parts: Sequence[PrintedPart]) -> tuple[Spot, ...]:
    """Lay parts out in rows, the deepest ones first, on as many beds as that takes.

    Args:
        parts: Parts that fit a bed of `shapes.PRINTER`.

    Returns:
        A spot for every copy of every part. What lies on a bed is in its middle, or in that of what
        is beside or behind the corner that is kept free; a part that fills the bed lies alone.
    """
    copies = [(part, copy) for part in parts for copy in range(part.count)]
    copies.sort(key=lambda each: (-each[0].size[1], -each[0].size[0], each[0].name, each[1]))
    beds: list[list[_Row]] = []
    for part, copy in copies:
        if not any(row.add(part, copy) for rows in beds for row in rows):
            _new_row(beds, *map(float, part.size[:2])).add(part, copy)
    return tuple(spot for bed, rows in enumerate(beds) for spot in _centred(bed, rows))


def _new_row(beds: list[list[_Row]], width: float, depth: float) -> _Row:
    """A row behind the others of a bed that has room, or the first of a new bed."""
    for rows in beds:
        front = rows[-1].front + rows[-1].depth + GAP
        is_narrow = max(width, *(row.used for row in rows)) <= BESIDE
        if front + depth <= (PRINTER if is_narrow else BEHIND):
            rows.append(_Row(front=front, depth=depth))
            return rows[-1]
    beds.append([_Row(front=0.0, depth=depth)])
    return beds[-1][0]


def _centred(bed: int, rows: list[_Row]) -> list[Spot]:
    width, depth = max(row.used for row in rows), rows[-1].front + rows[-1].depth
    left, front = (PRINTER - width) / 2, (PRINTER - depth) / 2
    aside = behind = 0.0
    if left < KEPT_FREE[0] and front < KEPT_FREE[1]:
        if width <= BESIDE:
            aside = KEPT_FREE[0] / 2
        elif depth <= BEHIND:
            behind = KEPT_FREE[1] / 2
    return [
        Spot(
            part=part,
            copy=copy,
            bed=bed,
            x=aside + (PRINTER - row.used) / 2 + x,
            y=behind + front + row.front + row.depth / 2,
        )
        for row in rows
        for part, copy, x in row.spots
    ]
