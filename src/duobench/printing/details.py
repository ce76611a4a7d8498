"""Facts about making the benchmark's objects, beside their geometry.

Sizes are those that the objects are made with, so that a recipe asks for what is simulated. What is
said in words stands in `recipes.toml`.
"""

import math
import string
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from fnmatch import fnmatch
from functools import cache
from importlib.resources import files
from typing import Any

import msgspec
import numpy as np

from duobench.tasks import pour_marbles
from duobench.tasks.task import Task
from duobench.world.objects import (
    blocks,
    bowl,
    chest,
    cup,
    gate,
    hexagon_peg,
    joint_blocks,
    maze_board,
    microwave,
    pot,
)
from duobench.world.objects.prop import Prop
from duobench.world.objects.shapes import JOINT_PLAY, Colour
from duobench.world.objects.solid import mass_properties, printable

FREE, MATING = 0.2, 0.1
"""Tolerance in mm of a size that stands alone, and of one that something goes into."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Dimension:
    """A size to measure with calipers."""

    what: str
    mm: float
    tolerance_mm: float


def _size(
    what: str,
    metres: float,
    tolerance: float = MATING,
) -> Dimension:
    return Dimension(what=what, mm=round(1000 * metres, 3), tolerance_mm=tolerance)


def _narrow(play: float) -> float:
    """Width in metres of a dovetail, or of its slot, in the plane of the rim's outside."""
    depth, root, end = maze_board.DOVETAIL
    share = maze_board.ROOT / (depth + maze_board.ROOT + play)
    return root + share * (end - root) + 2 * play


_SOCKET = 2 * (hexagon_peg.ACROSS_FLATS / 2 + hexagon_peg.CLEARANCE)
_KEY, _RING = gate.KEY[0], gate.RING_THICKNESS

DIMENSIONS: Mapping[str, tuple[Dimension, ...]] = {
    "hinge_chest/chest": (
        _size("cavity along the hinge, between the lugs", chest.CAVITY[1], FREE),
        _size("cavity across", chest.CAVITY[0], FREE),
        _size("hole in a lug, diameter", 2 * chest.HOLE_RADIUS),
    ),
    "hinge_chest/chest/lid": (
        _size("length of the hinge's barrel", chest.LID_WIDTH, FREE),
        _size("hole in the barrel, diameter", 2 * chest.THREAD_RADIUS),
    ),
    "pour_marbles/left_cup": (
        _size("inside, between flats", 2 * cup.INNER_RADIUS, FREE),
    ),
    "pour_marbles/right_cup": (
        _size("inside, between flats", 2 * cup.INNER_RADIUS, FREE),
    ),
    "ball_maze/board/floor": (
        _size("way between walls", maze_board.PITCH - maze_board.WALL, FREE),
    ),
    "ball_maze/board/frame": (
        _size("opening for a floor, above its shoulders", 2 * maze_board.INNER),
        _size("slot for a dovetail, at the rim's outside", _narrow(JOINT_PLAY)),
        _size(
            "slot for a dovetail, at its end", maze_board.DOVETAIL[2] + 2 * JOINT_PLAY
        ),
    ),
    "ball_maze/board/grip": (
        _size("dovetail where it leaves the stay", _narrow(0.0)),
        _size("dovetail at its end", maze_board.DOVETAIL[2]),
        _size("bar, thickness", maze_board.BAR[0], FREE),
    ),
    "join_blocks/light_block": (
        _size("peg, either way across", joint_blocks.PEG_WIDTH),
    ),
    "join_blocks/dark_block": (
        _size("sockets, either way across", joint_blocks.SOCKET_WIDTH),
        _size("depth of a socket", joint_blocks.SOCKET_DEPTH, FREE),
    ),
    "join_blocks/wall": (
        _size("peg, either way across", joint_blocks.PEG_WIDTH),
        _size("height of the peg's middle", joint_blocks.PEG_HEIGHT, FREE),
    ),
    "transfer_gate/gate/base": (
        _size("hole for the post", gate.POST + 2 * JOINT_PLAY),
    ),
    "transfer_gate/gate/post": (
        _size("edge of the post", gate.POST),
        _size("slot for the ring", _RING + 2 * JOINT_PLAY),
        _size("key in the slot", _KEY),
    ),
    "transfer_gate/gate/ring": (
        _size("bar of the ring, across", _RING),
        _size("notch for the key", _KEY + 2 * JOINT_PLAY),
        _size("opening, between flats", 2 * gate.RING_RADIUS, FREE),
    ),
    "transfer_reorient/peg": (_size("between flats", hexagon_peg.ACROSS_FLATS),),
    "transfer_reorient/board": (_size("hexagonal hole, between flats", _SOCKET),),
}
"""Sizes beyond those of the box around a part, by task, body and piece."""

CHANGES: Mapping[str, tuple[float, Colour]] = {
    "ball_maze/board/floor": (maze_board.BASE, maze_board.WALL_COLOUR),
    "bin_sort/black_bowl": (bowl.RIM_HEIGHT - bowl.RIM, blocks.PALE),
}
"""Heights in metres from which parts are printed in another colour, and the colours."""

FINE = (
    "join_blocks/light_block",
    "join_blocks/dark_block",
    "join_blocks/wall",
    "transfer_reorient/board",
    "transfer_reorient/peg",
)
"""Parts with chamfers that guide another part: finer layers."""


# --- in words ---

NAMED = {
    "maze_way": maze_board.PITCH - maze_board.WALL,
    "floor_play_mm": 1000 * maze_board.FLOOR_PLAY,
    "handle_height": pot.HEIGHT / 2 + pot.HANDLE_Z,
    "marble_grams": 1000 * cup.GLASS_DENSITY * 4 / 3 * math.pi * cup.MARBLE_RADIUS**3,
}
"""Numbers that the words name and no object has by itself: lengths in metres, but where a name says
mm, a mass in grams."""
_MODULES = {
    "cup": cup,
    "microwave": microwave,
    "pot": pot,
    "pour_marbles": pour_marbles,
}


@dataclass(frozen=True, kw_only=True, slots=True)
class PurchasedPart:
    """Part that is not printed: screws, or an object with the sizes of the simulated one."""

    name: str
    props: tuple[str, ...] = ()
    """The objects of the task that it stands for; none for screws and the like."""
    count: int = 1
    sizes: tuple[str, ...] = ()
    """One phrase each."""


@dataclass(frozen=True, kw_only=True, slots=True)
class TaskDetails:
    """Facts about the objects of one task, as in `recipes.toml`."""

    assembly: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    fixing: dict[str, str] = field(default_factory=dict[str, str])
    supports: dict[str, str] = field(default_factory=dict[str, str])
    bought: tuple[PurchasedPart, ...] = ()


class _Words(string.Formatter):
    """Fills in numbers: `:mm`, `:2mm` (twice the length), `:deg`, or as Python does."""

    def format_field(self, value: Any, format_spec: str) -> str:
        if format_spec.endswith("mm"):
            return f"{float(format_spec[:-2] or 1) * 1000 * value:.0f}"
        if format_spec == "deg":
            return f"{math.degrees(value):.0f}"
        return super().format_field(value, format_spec)


@cache
def details() -> Mapping[str, TaskDetails]:
    """Facts about the benchmark's tasks, by their ids."""
    text = (files("duobench.printing") / "recipes.toml").read_text(encoding="utf-8")
    text = _Words().vformat(text[text.index("[") :], (), {**NAMED, **_MODULES})
    return msgspec.toml.decode(text, type=dict[str, TaskDetails])


def details_of(task: str) -> TaskDetails:
    """Facts about a task; none about one that is not the benchmark's."""
    return details().get(task, TaskDetails())


def parts_to_buy(task: Task) -> tuple[PurchasedPart, ...]:
    """Return what is not printed of a task: nothing where all of its objects are.

    Objects of a task that is not the benchmark's, and not printable, are listed with their sizes.
    """
    if task.id not in details():
        return () if task.printable else tuple(map(_unprinted, task.props))
    names, bought = [prop.name for prop in task.props], []
    for part in details()[task.id].bought:
        props = tuple(
            name for name in names if any(fnmatch(name, each) for each in part.props)
        )
        bought.append(replace(part, props=props, count=len(props) or part.count))
    return tuple(bought)


def _unprinted(prop: Prop) -> PurchasedPart:
    solids = prop.prints({prop.choice or "": min(prop.variants, default="")})
    names = (prop.name, *(prop.part_name(part.name) for part in prop.parts))
    sizes = []
    for name, solid in zip(names, solids, strict=True):
        edges = " × ".join(
            f"{1000 * e:.0f}" for e in np.ptp(printable(solid).vertices, axis=0)
        )
        sizes.append(f"{name}: {edges} mm, {1000 * mass_properties(solid).mass:.0f} g")
    return PurchasedPart(name=prop.name, props=(prop.name,), sizes=tuple(sizes))


def lines_of(parts: Iterable[PurchasedPart]) -> Iterator[str]:
    """Yield a list in Markdown of what is not printed."""
    for part in parts:
        yield f"- {part.count} × {part.name}"
        yield from (f"    - {size}" for size in part.sizes)
