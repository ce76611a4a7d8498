"""What hands hold in demonstrations, and the same held otherwise.

A scripted person grasps alike every time, and brings what is held to the same place to a tenth of a
millimetre: so demonstrations do not show that a hand has to go elsewhere where it holds a thing
otherwise. A network that plays grasps some millimetres off, and then has to. So it learns from rows
in which things are moved and turned in the hand, and where the hand is to go the other way; and
from rows in which what a hand goes for lies elsewhere, and the hand goes there: few demonstrations
then show every place near those that they show.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from demonstrations import Demonstrations, Rows, opening_columns
from frames import Frames, bodies, places_in, rotations_by
from numpy.typing import NDArray

from duobench.core.types import SIDES

REACH = 0.2
"""Metres from a tool to the origin of what it may hold: a pot is held by its handles. So near, a
hand that goes for a thing that lies otherwise is turned with it; twice as far, it comes as it came.
"""
SOON = 5
"""Rows over which what is held stays where it is in the hand."""
SLIP = 2e-3
"""Metres that it may move there over them."""
MOVED = 0.01
"""Metres that a thing is moved by a hand that holds it, at least."""
MOVED_BY, TURNED_BY = 0.01, 0.1
"""Standard deviations (m along each axis, rad about each) of how things lie or are held otherwise.
"""
FADE = 15
"""Steps after which goals are as demonstrated again, once a thing was let go or has moved."""
NOTHING = -1
"""Number of the object of an empty hand."""


@dataclass(frozen=True)
class Grasps:
    """What hands hold in T rows of demonstrations, and what they go for.

    Attributes:
        things: Which object each hand holds or goes for (T, sides), or `NOTHING`.
        holds: Whether it holds it (T, sides).
        left: For how many rows from there on (T, sides) it holds it, or it lies where it lies.
    """

    things: NDArray[np.int64]
    holds: NDArray[np.bool_]
    left: NDArray[np.int64]

    @staticmethod
    def of(data: Demonstrations, here: Frames) -> Grasps:
        """Those of demonstrations, in the frames of their rows."""
        ends = np.repeat(np.cumsum(data.lengths), data.lengths)
        sides = [
            _grasps_of(side, data.labels[:, column], here, ends)
            for side, column in enumerate(opening_columns(data.labels))
        ]
        things, holds, left = (
            np.stack(part, axis=1) for part in zip(*sides, strict=True)
        )
        passed = holds[:, ::-1] & ~holds & (things == things[:, ::-1])
        return Grasps(np.where(passed, NOTHING, things), holds, left)

    def carried(self, steps: Sequence[int]) -> NDArray[np.int64]:
        """Which frame moves with each tool at steps from each row on (T, sides, steps).

        It is that of what the hand holds by then and still, or its own.
        """
        still = self.holds[..., None] & (np.array(steps) < self.left[..., None])
        own = np.arange(len(SIDES))[:, None]
        return np.where(still, self.things[..., None] + len(SIDES), own)


def _grasps_of(
    side: int, openings: NDArray[np.floating], here: Frames, ends: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.bool_], NDArray[np.int64]]:
    """What one hand holds or goes for (T,), whether it holds it, and for how long."""
    objects = here.positions[:, len(SIDES) : -1]
    rows = np.arange(len(ends))
    soon = np.minimum(rows + SOON, ends - 1)
    closed = _closed(openings, ends)
    stretch = _stretches(closed, ends)
    first = np.searchsorted(stretch, np.arange(stretch[-1] + 1))
    last = np.append(first[1:], len(rows)) - 1
    away = objects - here.positions[:, side, None]
    inside = np.einsum("tij,tki->tkj", here.rotations[:, side], away)
    slip = np.linalg.norm(inside[soon] - inside, axis=-1)
    far = np.linalg.norm(away, axis=-1)
    moved = np.linalg.norm(objects[last] - objects[first], axis=-1) > MOVED
    held = moved[stretch] & closed[:, None] & (slip < SLIP) & (far < REACH)
    near = np.add.reduceat(np.where(held, REACH - far, 0), first)
    thing = np.where(near.any(1), near.argmax(1), NOTHING)  # of each stretch
    holds = held[rows, thing[stretch]] & (thing[stretch] != NOTHING)
    things = np.where(holds, thing[stretch], NOTHING)
    left = last[stretch] + 1 - rows
    for one in np.flatnonzero(thing != NOTHING):
        if first[one] == 0 or ends[first[one] - 1] != ends[first[one]]:
            continue  # an episode begins with it in the hand
        before = slice(first[one - 1], first[one])
        there = objects[:, thing[one]]
        gone = np.linalg.norm(
            there[first[one] : last[one] + 1] - there[first[one]], axis=-1
        )
        lies = np.linalg.norm(there[before] - there[first[one]], axis=-1) < SLIP
        things[before] = np.where(lies, thing[one], NOTHING)
        left[before] = first[one] + (gone > MOVED).argmax() - rows[before]
    return things, holds, left


def _closed(
    openings: NDArray[np.floating], ends: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Rows (T,) of which the last change of an opening was to a smaller one.

    A hand that is open may be told less than half: it was then opened as far as it had room.
    """
    starts = np.flatnonzero(np.diff(ends, prepend=0))
    before = np.roll(openings, 1)
    before[starts] = openings.max()  # an episode begins with open hands
    changes = np.sign((openings - before).round(3))
    changes[starts] = np.where(changes[starts] < 0, -1, 1)
    last = np.where(changes != 0, np.arange(len(changes)), 0)
    return changes[np.maximum.accumulate(last)] < 0


def _stretches(closed: NDArray[np.bool_], ends: NDArray[np.int64]) -> NDArray[np.int64]:
    """Number (T,) of the stretch of rows, alike and of one episode, that each row is in."""
    changes = (np.diff(closed) != 0) | (np.diff(ends) != 0)
    return np.concatenate([[0], np.cumsum(changes)])


@dataclass(frozen=True)
class Moves:
    """Moves of T hands: turns about a centre, and then ways; of NumPy or PyTorch.

    Attributes:
        turns: Rotation matrices (T, sides, 3, 3).
        ways: In metres (T, sides, 3).
        centres: In metres (T, sides, 3).
    """

    turns: Any
    ways: Any
    centres: Any

    @staticmethod
    def none(rows: int) -> Moves:
        """No moves."""
        turns = np.tile(np.eye(3), (rows, len(SIDES), 1, 1))
        return Moves(turns, *np.zeros((2, rows, len(SIDES), 3)))


@dataclass(frozen=True)
class Otherwise:
    """What T rows of demonstrations were, had things lain or been held otherwise.

    What a hand holds is turned about that hand, and what hands go for about its origin.

    Attributes:
        objects: Object states (T, n).
        goals: How hands go elsewhere to get things, in the table's frame.
        held: How they go elsewhere to bring things where they were brought, in frames of the tools.
    """

    objects: Rows
    goals: Moves
    held: Moves

    @staticmethod
    def drawn(
        data: Demonstrations,
        here: Frames,
        grasps: Grasps,
        rng: np.random.Generator,
        size: tuple[float, float] = (MOVED_BY, TURNED_BY),
    ) -> Otherwise:
        """One drawn at random: standard deviations of ways and turns are in metres and rad."""
        names, rows = data.names, len(data.objects)
        objects = data.objects.copy()
        goals, held = Moves.none(rows), Moves.none(rows)
        for thing, (body, place) in enumerate(
            zip(bodies(names), places_in(names), strict=True)
        ):
            hands = grasps.things == thing
            some = np.flatnonzero(hands.any(1))
            hands, holds = hands[some], hands[some] & grasps.holds[some]
            axes = [f"{body}_{axis}_axis_x" for axis in "xz"]
            starts = [names.index(axis) for axis in axes if axis in names]
            way = size[0] * rng.normal(size=(len(some), 3))
            angle = size[1] if starts else 0.0
            turn = rotations_by(angle * rng.normal(size=(len(some), 3)))
            origin = here.positions[some, len(SIDES) + thing]
            hand = here.positions[some, holds.argmax(1)]
            centre = np.where(holds.any(1)[:, None], hand, origin)
            objects[some, place] = centre + _by(turn, origin - centre) + way
            for start in starts:
                axis = slice(start, start + 3)
                objects[some, axis] = _by(turn, data.objects[some, axis])
            for side in range(len(SIDES)):
                goes = hands[:, side] & ~holds[:, side]
                goals.turns[some[goes], side] = turn[goes]
                goals.ways[some[goes], side] = way[goes]
                goals.centres[some[goes], side] = centre[goes]
                has = holds[:, side]
                tool, frame = (
                    part[some[has], side] for part in (here.positions, here.rotations)
                )
                back, into = turn[has].swapaxes(1, 2), frame.swapaxes(1, 2)
                brought = centre[has] + _by(back, tool - way[has] - centre[has])
                held.turns[some[has], side] = into @ back @ frame
                held.ways[some[has], side] = _by(into, brought - tool)
        return Otherwise(objects, goals, held)


def moved(poses: Any, goals: Moves, held: Moves, left: Any) -> Any:
    """Where hands are to be (B, steps, sides, 9), had things lain or been held otherwise.

    Args:
        poses: Where they were to be: places, and two axes, as tensors.
        goals: See `Otherwise`; of B rows.
        held: The same.
        left: For how many steps that counts (B, sides).
    """
    import torch
    from torch.nn import functional

    places, axes = poses[..., :3], poses[..., 3:].unflatten(-1, (2, 3))
    same = torch.eye(3, device=poses.device)
    more = (goals.turns - same)[:, None]
    away = places - goals.centres[:, None]
    near = (2 - away.norm(dim=-1, keepdim=True) / REACH).clamp(0, 1)
    ways = goals.ways[:, None] + near * (more @ away[..., None])[..., 0]
    turned = near[..., None] * (axes @ more.mT)
    x, y = functional.normalize(axes, dim=-1).unbind(-2)
    frame = torch.stack([x, y, torch.linalg.cross(x, y)], -1)
    ways = ways + (frame @ held.ways[:, None, ..., None])[..., 0]
    turned = turned + (frame @ (held.turns - same)[:, None])[..., :2].mT
    steps = torch.arange(poses.shape[1], device=poses.device)
    over = (steps[None, :, None] - left[:, None]) / FADE
    counts = (1 - over).clamp(0, 1)[..., None]
    return poses + counts * torch.cat([ways, turned.flatten(-2)], -1)


def _by(
    turns: NDArray[np.floating], vectors: NDArray[np.floating]
) -> NDArray[np.floating]:
    """Vectors (T, 3) turned by matrices (T, 3, 3)."""
    return (turns @ vectors[..., None])[..., 0]
