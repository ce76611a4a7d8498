"""What hands hold in demonstrations, and the same held otherwise.

A scripted person grasps alike every time, and brings what is held to the same place to a tenth of a
millimetre: so demonstrations do not show that a hand has to go elsewhere where it holds a thing
otherwise. A network that plays grasps some millimetres off, and then has to. So it learns from rows
in which things are moved in the hand, and where the hand is to go as far the other way; and from
rows in which what a hand goes for lies elsewhere, and the hand goes there: else it takes what is
not where it was shown for held.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from demonstrations import Demonstrations, opening_columns
from frames import Frames, columns
from numpy.typing import NDArray

from duobench.core.types import SIDES

REACH = 0.2
"""Metres from a tool to the origin of what it may hold: a pot is held by its handles."""
SOON = 5
"""Rows over which what is held stays where it is in the hand."""
SLIP = 2e-3
"""Metres that it may move there over them."""
MOVED = 0.01
"""Metres that a thing is moved by a hand that holds it, at least."""
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
class Shift:
    """How far things are moved that hands hold or go for, for B rows.

    Attributes:
        things: In the table's frame, of tools, objects and the table (B, K, 3), in metres.
        goes: The same of what each hand goes for (B, sides, 3).
        inside: In the frames of the tools, of what they hold (B, sides, 3).
        left: For how many steps of a chunk (B, sides) that counts.
    """

    things: Any
    goes: Any
    inside: Any
    left: Any

    @staticmethod
    def drawn(size: float, things: Any, holds: Any, left: Any, rotations: Any) -> Shift:
        """One drawn at random, of grasps (B, sides), with frames (B, K, 3, 3)."""
        import torch

        turns = rotations[:, : len(SIDES)]
        shift = torch.zeros(rotations.shape[:-1]).to(turns)
        rows = torch.arange(len(shift), device=shift.device)
        there = size * torch.randn(len(shift), len(SIDES), 3).to(turns)
        for side in range(len(SIDES)):
            some = (things[:, side] != NOTHING)[:, None]
            place = things[:, side].clamp(min=0) + len(SIDES)
            shift[rows, place] = torch.where(some, there[:, side], shift[rows, place])
        place = things.clamp(min=0) + len(SIDES)
        there = shift.gather(1, place[..., None].expand(-1, -1, 3))
        there = torch.where((things == NOTHING)[..., None], 0.0, there)
        inside = (turns.mT @ there[..., None])[..., 0]
        goes = torch.where(holds[..., None], 0.0, there)
        inside = torch.where(holds[..., None], inside, 0.0)
        return Shift(shift, goes, inside, left)

    def features(self, rotations: Any, names: tuple[str, ...], width: int) -> Any:
        """By how much features (B, width) change, with frames (B, K, 3, 3)."""
        import torch

        places, ways = columns(names)
        change = torch.zeros(len(rotations), width).to(rotations)
        for k, part in enumerate(places, len(SIDES)):
            change[:, part] = self.things[:, k]
        for k, part in enumerate(ways):
            away = self.things - self.things[:, k, None]
            seen = away @ rotations[:, k]
            others = [other for other in range(len(ways)) if other != k]
            change[:, part] = seen[:, others].flatten(1)
        return change

    def labels(self, axes: Any) -> Any:
        """By how much the places of tools (B, steps, sides, 3) change, with axes (..., 2, 3)."""
        import torch
        from torch.nn import functional

        x, y = functional.normalize(axes, dim=-1).unbind(-2)
        turned = torch.stack([x, y, torch.linalg.cross(x, y)], -1)
        held = (turned @ self.inside[:, None, ..., None])[..., 0]
        steps = torch.arange(axes.shape[1], device=axes.device)
        over = (steps[None, :, None] - self.left[:, None]) / FADE
        return (self.goes[:, None] - held) * (1 - over).clamp(0, 1)[..., None]
