"""What images show of an object state: places, axes and bits, and how objects are turned forwards.

Pure arithmetic on rows; networks that see (`images.py`) and their training (`train_images.py`)
share it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from demonstrations import Demonstrations, Rows
from frames import QUARTERS, bodies, frames, places_in, rotations_of
from numpy.typing import NDArray

from duobench.core.types import SIDES

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Kinds:
    """Which numbers of what is seen are of which kind; each has a loss of its own."""

    places: list[slice]
    """Places of objects."""
    axes: list[slice]
    """Axes of objects."""
    chosen: list[int]
    """Numbers that a layout chose, such as a wall: they are whole, and never change."""
    others: list[int]
    """All others, such as the angle of a hinge, and quarters of a turn."""

    @staticmethod
    def of(data: Demonstrations) -> Kinds:
        """Those of demonstrations."""
        first = np.repeat(np.cumsum(data.lengths) - data.lengths, data.lengths)
        still = (data.objects == data.objects[first]).all(0)
        whole = (data.objects == data.objects.round()).all(0)
        places = places_in(data.names)
        axes = [part for _, x, z in axes_in(data.names) for part in (x, z)]
        known = {n for part in places + axes for n in range(part.start, part.stop)}
        vary = (data.objects != data.objects[0]).any(0)
        chosen = sorted(set(np.flatnonzero(still & whole & vary).tolist()) - known)
        quarters = range(len(data.names), len(data.names) + QUARTERS * len(axes) // 2)
        others = sorted(set(range(quarters.stop)) - known - set(chosen))
        return Kinds(places, axes, chosen, others)


def shown(objects: Rows, names: tuple[str, ...]) -> Rows:
    """What there is to be seen of object states (T, n): the same, but objects turned forwards.

    A cube looks the same after a quarter turn, so which of its axes is x cannot be seen. It is
    told apart, as quarters of a turn (four numbers an object), and guessed where nothing shows it.
    """
    here = frames(np.zeros((len(objects), 16), np.float32), objects, names)
    seen, quarters = objects.copy(), []
    for k, x, z in axes_in(names):
        seen[:, x], seen[:, z] = (here.rotations[:, k, :, axis] for axis in (0, 2))
        quarters.append(np.eye(QUARTERS, dtype=np.float32)[here.quarters[:, k]])
    return np.hstack([seen, *quarters])


def rotations_seen(seen: Rows, names: tuple[str, ...]) -> NDArray[np.float64]:
    """Rotations (T, K, 3, 3) of objects whose axes were seen (T, k), those that point forwards."""
    turns = np.tile(np.eye(3), (len(seen), len(bodies(names)), 1, 1))
    for k, x, z in axes_in(names):
        up = seen[:, z] / np.linalg.norm(seen[:, z], axis=1, keepdims=True)
        ahead = seen[:, x] - (seen[:, x] * up).sum(1, keepdims=True) * up
        ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
        turns[:, k - len(SIDES)] = rotations_of(ahead, up)
    return turns


def recognized(seen: Rows, names: tuple[str, ...]) -> Rows:
    """Object states (T, n) of what was seen of them (T, k)."""
    objects, quarters = seen[:, : len(names)].copy(), seen[:, len(names) :]
    turns = rotations_seen(seen, names)
    for nth, (k, x, z) in enumerate(axes_in(names)):
        ahead, aside, up = np.moveaxis(turns[:, k - len(SIDES)], -1, 0)
        turn = quarters[:, QUARTERS * nth : QUARTERS * (nth + 1)].argmax(1)
        objects[:, x] = np.choose(turn, (ahead.T, aside.T, -ahead.T, -aside.T)).T
        objects[:, z] = up
    return objects


def axes_in(names: tuple[str, ...]) -> list[tuple[int, slice, slice]]:
    """Of objects with axes: which of the things they are, and where x and z axes stand."""
    found = []
    for k, body in enumerate(bodies(names), len(SIDES)):
        name = f"{body}_x_axis_x"
        if name in names:
            x, z = names.index(name), names.index(f"{body}_z_axis_x")
            found.append((k, slice(x, x + 3), slice(z, z + 3)))
    return found


def poses(objects: Rows, names: tuple[str, ...]) -> tuple[Array, Array]:
    """Places (T, K, 3) and rotations (T, K, 3, 3) of objects, turned forwards."""
    here = frames(np.zeros((len(objects), 16), np.float32), objects, names)
    things = slice(len(SIDES), -1)
    return here.positions[:, things], here.rotations[:, things]
