"""What hands hold in demonstrations, and the same held otherwise.

A scripted person grasps alike every time, and brings what is held to the same place to a tenth of a
millimetre: so demonstrations do not show that a hand has to go elsewhere where it holds a thing
otherwise. A network that plays grasps some millimetres off, and then has to. So it learns from rows
in which things are moved in the hand, and where the hand is to go as far the other way.
"""

from __future__ import annotations

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
NOTHING = -1
"""Number of the object of an empty hand."""


@dataclass(frozen=True)
class Grasps:
    """What hands hold in T rows of demonstrations.

    Attributes:
        things: Which object each hand holds (T, sides), or `NOTHING`.
        left: For how many rows from there on the hand stays closed (T, sides).
    """

    things: NDArray[np.int64]
    left: NDArray[np.int64]

    @staticmethod
    def of(data: Demonstrations, here: Frames) -> Grasps:
        """Those of demonstrations, in the frames of their rows."""
        objects = here.positions[:, len(SIDES) : -1]
        ends = np.repeat(np.cumsum(data.lengths), data.lengths)
        rows = np.arange(len(ends))
        soon = np.minimum(rows + SOON, ends - 1)
        things, left = [], []
        for side, column in enumerate(opening_columns(data.labels)):
            closed = _closed(data.labels[:, column], ends)
            stretch = _stretches(closed, ends)
            first = np.searchsorted(stretch, stretch)
            last = np.searchsorted(stretch, stretch, "right") - 1
            away = objects - here.positions[:, side, None]
            inside = np.einsum("tij,tki->tkj", here.rotations[:, side], away)
            slip = np.linalg.norm(inside[soon] - inside, axis=-1)
            moved = np.linalg.norm(objects[last] - objects[first], axis=-1)
            far = np.linalg.norm(away, axis=-1)
            held = (slip < SLIP) & (moved > MOVED) & (far < REACH) & closed[:, None]
            far[~held] = REACH
            near = np.add.reduceat(REACH - far, np.unique(first))  # (stretches, K)
            thing = near.argmax(1)[stretch]
            things.append(np.where(held[rows, thing], thing, NOTHING))
            left.append(np.where(closed, last + 1 - rows, 0))
        return Grasps(np.stack(things, axis=1), np.stack(left, axis=1))


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
    """How far things are moved in hands, for B rows.

    Attributes:
        inside: In the frames of the tools (B, sides, 3), in metres.
        things: In the table's frame, of tools, objects and the table (B, K, 3).
        left: For how many steps of a chunk (B, sides) the hand holds on.
    """

    inside: Any
    things: Any
    left: Any

    @staticmethod
    def drawn(size: float, held: Any, left: Any, rotations: Any) -> Shift:
        """One drawn at random, of what is held (B, sides), with frames (B, K, 3, 3)."""
        import torch

        count, things = rotations.shape[:2]
        turns = rotations[:, : len(SIDES)]
        inside = size * torch.randn(count, len(SIDES), 3).to(turns)
        there = (turns @ inside[..., None])[..., 0]
        both = (held[:, 0] == held[:, 1])[:, None]  # one thing moves one way
        there = torch.stack(
            [there[:, 0], torch.where(both, there[:, 0], there[:, 1])], 1
        )
        there = torch.where((held == NOTHING)[..., None], 0.0, there)
        shift = torch.zeros(count, things, 3).to(turns)
        for side in reversed(range(len(SIDES))):
            place = (held[:, side] + len(SIDES)).clamp(min=0)
            some = (held[:, side] != NOTHING)[:, None]
            rows = torch.arange(count, device=place.device)
            shift[rows, place] = torch.where(some, there[:, side], shift[rows, place])
        inside = (turns.mT @ there[..., None])[..., 0]
        return Shift(inside, shift, left)

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
        moved = -(turned @ self.inside[:, None, ..., None])[..., 0]
        steps = torch.arange(axes.shape[1], device=axes.device)
        holds = steps[None, :, None] < self.left[:, None]
        return torch.where(holds[..., None], moved, 0.0)
