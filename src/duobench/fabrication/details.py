"""What is known about printing the benchmark's objects, by body: the part beside the geometry.

Sizes are those that the objects are made with, so that a recipe asks for what is simulated.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from duobench.objects import blocks, bowl, chest, cup, gate, hexagon_peg, joint_blocks, maze_board
from duobench.objects.shapes import JOINT_PLAY

FREE, MATING = 0.2, 0.1
"""Tolerance in mm of a size that stands alone, and of one that something goes into."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Dimension:
    """A size to measure with calipers."""

    what: str
    """What is measured."""
    mm: float
    """Its size in millimetres."""
    tolerance_mm: float
    """How far it may be off, in millimetres."""


@dataclass(frozen=True, kw_only=True, slots=True)
class ColourChange:
    """From which height on a part is printed in another colour."""

    above_mm: float
    """Height above the bed in millimetres."""
    rgba: tuple[float, float, float, float]
    """The colour."""


def _size(what: str, metres: float, tolerance: float = MATING) -> Dimension:
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
    "pour_marbles/left_cup": (_size("inside, between flats", 2 * cup.INNER_RADIUS, FREE),),
    "pour_marbles/right_cup": (_size("inside, between flats", 2 * cup.INNER_RADIUS, FREE),),
    "ball_maze/board/floor": (
        _size("way between walls", maze_board.PITCH - maze_board.WALL, FREE),
        _size("slot for a dovetail, at the rim's outside", _narrow(JOINT_PLAY)),
        _size("slot for a dovetail, at its end", maze_board.DOVETAIL[2] + 2 * JOINT_PLAY),
    ),
    "ball_maze/board/grip": (
        _size("dovetail where it leaves the stay", _narrow(0.0)),
        _size("dovetail at its end", maze_board.DOVETAIL[2]),
        _size("bar, thickness", maze_board.BAR[0], FREE),
    ),
    "join_blocks/light_block": (_size("peg, either way across", joint_blocks.PEG_WIDTH),),
    "join_blocks/dark_block": (
        _size("sockets, either way across", joint_blocks.SOCKET_WIDTH),
        _size("depth of a socket", joint_blocks.SOCKET_DEPTH, FREE),
    ),
    "join_blocks/wall": (
        _size("peg, either way across", joint_blocks.PEG_WIDTH),
        _size("height of the peg's middle", joint_blocks.PEG_HEIGHT, FREE),
    ),
    "transfer_gate/gate/base": (_size("hole for the post", gate.POST + 2 * JOINT_PLAY),),
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

CHANGES: Mapping[str, tuple[ColourChange, ...]] = {
    "ball_maze/board/floor": (
        ColourChange(above_mm=round(1000 * maze_board.BASE, 3), rgba=maze_board.RIM_COLOUR),
    ),
    "bin_sort/black_bowl": (
        ColourChange(above_mm=round(1000 * (bowl.RIM_HEIGHT - bowl.RIM), 3), rgba=blocks.PALE),
    ),
}
"""Where the colour changes with the height."""

SUPPORTS: Mapping[str, str] = {
    "ball_maze/ball": "from the bed, with a brim of 5 mm; sand off what is left of them",
}
"""What needs supports; anything else needs none."""

ASSEMBLY: Mapping[str, tuple[str, ...]] = {
    "hinge_chest": (
        "Hold the lid's barrel between the lugs of the chest.",
        "Turn an M3 × 20 mm screw from either side through the lug into the barrel, until its head "
        "touches the lug and the lid still falls by its own weight.",
    ),
    "ball_maze": (
        "Push the two dovetails of each grip from below into the slots of the rim, up to the "
        "stop, with glue.",
        "Stick a square of red film on the floor of the goal's corner and a green one on that of "
        f"the start's, {1000 * (maze_board.PITCH - maze_board.WALL):.0f} mm wide: the notes "
        "below say which.",
    ),
    "join_blocks": (
        "Nothing is glued: the light block's peg slides into a socket of the dark block, and the "
        "wall's peg into the other one.",
    ),
    "transfer_gate": (
        "Glue the post into the hole of the base, its slot along the longer edge of the base.",
        "Glue the ring into the slot, with its notch over the key.",
    ),
}
"""How parts go together."""

FIXING: Mapping[str, str] = {
    "hinge_chest/chest": "double-sided tape under the floor, or a clamp inside",
    "join_blocks/wall": "tape does not bear the push on the peg: clamp the foot of the plate, or "
    "screw an angle behind it to the table",
    "transfer_gate/gate": "clamp the base, or screw it through holes drilled into its corners",
    "transfer_gate/mat": "double-sided tape",
    "transfer_reorient/board": "double-sided tape over the whole underside, or clamps at its ends",
}
"""How what stands still is fixed to the table."""

NOTES: Mapping[str, tuple[str, ...]] = {
    "hinge_chest": (
        "The lid has no spring, as in simulation: its weight shuts it, so print it solid.",
    ),
    "ball_maze": (
        "There are ten mazes. A layout names one of them by its number, and all weigh the same: "
        "print those that your evaluation asks for.",
    ),
    "join_blocks": (
        "The finished pair droops by about two degrees a joint: that is meant, as in simulation.",
    ),
    "transfer_reorient": (
        f"The peg is turned by up to {math.degrees(math.pi / 6):.0f}° about its axis until it "
        "fits the hexagonal hole; the two other holes do not take it, however it is turned.",
    ),
}
"""What else there is to know about a task."""

FINE = frozenset(
    (
        *(f"join_blocks/{name}" for name in ("light_block", "dark_block", "wall")),
        *(f"transfer_reorient/{name}" for name in ("board", "peg")),
    )
)
"""What has chamfers that something finds its way by: finer layers."""
