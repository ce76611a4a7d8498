"""Pegs in sockets: the predicate `inserted`, for pegs and sockets on any two bodies."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING

from duobench.core.spatial import (
    SE3,
    hypot,
    root,
    sum_of_products,
)
from duobench.tasks.stages.logic import (
    Predicate,
    StateView,
    any_of,
    leaf,
)
from duobench.tasks.stages.predicates import USUAL_WAY, mm

if TYPE_CHECKING:
    from duobench.world.sim.questions import Questions

MAX_ANGLE_DEGREES = 10.0
"""Largest angle between the axes of an inserted peg and its socket [task definitions]."""
MAX_OFFSET = 0.004
"""Largest lateral distance of an inserted peg's tip from the socket's axis, in metres [task
definitions]."""
MAX_DEPTH = 0.030
"""Depth in metres at which a tip has left any socket of the benchmark on its far side."""


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    eq=False,
)
class Port:
    """An end of a peg, or the mouth of a socket, on a body."""

    body: str
    pose: SE3
    """Frame in the body: origin at the peg's tip or the socket's mouth, z pointing outwards."""

    at: tuple[float, float, float] = field(init=False)
    """Its origin in the body's frame, in metres."""
    outwards: tuple[float, float, float] = field(init=False)
    """Its outward direction in the body's frame."""
    reach: float = field(init=False)
    """Distance of its origin from that of the body, in metres."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "at", tuple(self.pose.translation.tolist()))
        object.__setattr__(self, "outwards", tuple(self.pose.rotation[:, 2].tolist()))
        object.__setattr__(self, "reach", math.hypot(*self.at))

    def axis(self, simulation: Questions) -> Sequence[float]:
        """Outward direction (3,) in the table frame."""
        return simulation.turned(self.body, self.outwards)

    def position(self, simulation: Questions) -> Sequence[float]:
        """Position (3,) in the table frame, in metres."""
        offset = simulation.turned(self.body, self.at)
        return [
            a + b for a, b in zip(offset, simulation.origin(self.body), strict=True)
        ]


def led_in(
    state: StateView, peg: Port, socket: Port, depth: float, offset: float
) -> bool:
    """Whether a peg's tip is in a socket, however the peg is turned there.

    Args:
        state: The step, of one simulation or of many at once.
        peg: Tip of the peg.
        socket: Mouth of the socket.
        depth: How far inside the mouth the tip is at least, in metres; `MAX_DEPTH` is the most.
        offset: How far from the socket's axis the tip is at most, in metres.
    """
    # This costs a tenth of what follows, and is the answer at most steps of an episode.
    x, y, z = state.relative_position(peg.body, socket.body)
    at_x, at_y, at_z = socket.at
    x, y, z = x - at_x, y - at_y, z - at_z
    furthest = MAX_DEPTH + offset + peg.reach
    near = x * x + y * y + z * z <= furthest * furthest
    if near is False:  # one simulation; of many, some may be near
        return False
    height, aside = tip_in(state, peg, socket)
    return near & (height >= -MAX_DEPTH) & (height <= -depth) & (aside <= offset)


def tip_in(
    state: StateView,
    peg: Port,
    socket: Port,
) -> tuple[float, float]:
    """Distances in metres of a peg's tip outside the mouth of a socket and beside its axis."""
    return state.once((peg, socket), partial(_tip_in, peg, socket))


def _tip_in(
    peg: Port,
    socket: Port,
    simulation: Questions,
) -> tuple[float, float]:
    outwards = socket.axis(simulation)
    ends = zip(peg.position(simulation), socket.position(simulation), strict=True)
    tip = [end - mouth for end, mouth in ends]
    height = sum_of_products(tip, outwards)
    beside = [along - height * axis for along, axis in zip(tip, outwards, strict=True)]
    return height, root(sum_of_products(beside, beside))


def tip_off(
    state: StateView,
    peg: Port,
    socket: Port,
    depth: float,
) -> float:
    """Distance of a peg's tip from its place in a socket, in usual distances."""
    height, aside = tip_in(state, peg, socket)
    return hypot(height + depth, aside) / USUAL_WAY


def tip_in_words(
    state: StateView,
    peg: Port,
    socket: Port,
) -> str:
    """The same as a sentence."""
    height, aside = tip_in(state, peg, socket)
    where = f"{mm(height)} outside" if height > 0 else f"{mm(-height)} inside"
    return f"peg of {peg.body} is {where} a socket of {socket.body} and {mm(aside)} beside its axis"


def inserted(
    peg: Port,
    socket: Port,
    depth: float,
) -> Predicate:
    """The peg is in the socket: aligned, and its tip on the axis, deep enough and not beyond.

    The axes differ by at most 10 degrees, the tip is at most 4 mm beside the axis and less than
    30 mm inside.

    Args:
        peg: Tip of the peg.
        socket: Mouth of the socket.
        depth: How far inside the mouth the tip is at least, in metres.
    """
    limit = -math.cos(math.radians(MAX_ANGLE_DEGREES))

    def test(state: StateView) -> bool:
        sim = state.simulation
        inside = led_in(state, peg, socket, depth, MAX_OFFSET)
        if inside is False:
            return False
        return inside & (sum_of_products(peg.axis(sim), socket.axis(sim)) <= limit)

    def otherwise(state: StateView) -> str:
        sim = state.simulation
        cosine = -sum_of_products(peg.axis(sim), socket.axis(sim))
        angle = math.degrees(math.acos(max(-1.0, min(1.0, cosine))))
        return (
            f"{tip_in_words(state, peg, socket)}, {angle:.0f} degrees from it; "
            f"{mm(depth)} inside, {mm(MAX_OFFSET)} and {MAX_ANGLE_DEGREES:g} degrees are asked for"
        )

    return leaf(
        f"peg of {peg.body} is {depth * 1000:.0f} mm inside {socket.body}",
        test,
        otherwise=otherwise,
        off=lambda state: tip_off(state, peg, socket, depth),
    )


def in_any_way(
    ways: Sequence[tuple[Port, Port]], question: Callable[[Port, Port], Predicate]
) -> Predicate:
    """One of several pegs or ends is in one of several sockets; the nearest one is explained.

    Args:
        ways: Each peg with a socket that will do.
        question: Whether that one is in that one, such as `engaged`.
    """
    each = [question(peg, socket) for peg, socket in ways]

    def otherwise(state: StateView) -> str:
        away = [math.hypot(*tip_in(state, peg, socket)) for peg, socket in ways]
        return ", ".join(each[away.index(min(away))].unmet(state))

    return any_of(*each).called(each[0].name, otherwise)
