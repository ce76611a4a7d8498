"""Contacts in many simulations of one model: questions answered with arrays."""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce
from operator import or_
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from duobench.core.spatial import sum_of_products
from duobench.core.types import SIDES, Array, Side
from duobench.world.robot.gripper import Gripper
from duobench.world.sim.contacts import (
    MIN_LEVER,
    MIN_PRESS_COSINE,
    ContactOwners,
    HingeAxis,
)

if TYPE_CHECKING:
    import mujoco

Booleans = NDArray[np.bool_]
Integers = NDArray[np.intp]


class ContactTable(ContactOwners):
    """The questions of `Contacts` about n simulations, but for gaps and forces: (n,) each."""

    def __init__(self, model: mujoco.MjModel, count: int, gripper: Gripper) -> None:
        super().__init__(model, gripper)
        self._of_geom, rows = np.array(self._owners), len(self._index)
        self._touching, self._presses = np.zeros((2, rows, rows, count), dtype=bool)
        """Whether two owners touch; and whether a finger presses on one, towards the other."""
        self._is_robot = np.isin(np.arange(rows), [*self._limbs.values()])
        self._worlds = self._one = self._other = np.empty(0, dtype=np.intp)
        self._normals = self._points = np.empty((3, 0))
        self._copies: list[NDArray[Any]] = []

    def copy(self, worlds: Integers, data_of: Callable[[int], mujoco.MjData]) -> None:
        """Copy the contacts of some simulations, by number, out of the engine.

        The data of one of them may be overwritten by that of the next.
        """
        copies: list[list[NDArray[Any]]] = [[], [], [], []]
        for world in worlds.tolist():
            contact = data_of(world).contact
            for kept, name in zip(
                copies, ("geom", "dist", "frame", "pos"), strict=True
            ):
                kept.append(getattr(contact, name).copy())
        counts = [len(distances) for distances in copies[1]]
        self.take(np.repeat(worlds, counts), *map(np.concatenate, copies))

    def take(self, *copies: NDArray[Any]) -> None:
        """Take contacts (k,) in any order, in place of `copy`.

        Args:
            copies: Of each the number of its simulation, its two geoms, the distance, the frame
                (k, 9) and the place (k, 3), under the names of MuJoCo's contacts.
        """
        self._copies = list(copies)

    def update(self, centres: Array) -> None:
        """Take what was copied; simulations that were not have no contacts then.

        Args:
            centres: Centres (n, bodies, 3) of mass of all bodies, in metres.
        """
        worlds, geoms, distances, frames, points = self._copies
        touch = np.flatnonzero(distances <= 0.0)  # a geom margin alone is no contact
        # Column by column: rows of two or three numbers are gathered several times slower.
        worlds, one, other = (
            worlds[touch],
            *(self._of_geom[each[touch]] for each in geoms.T),
        )
        self._touching.fill(False)
        self._touching[one, other, worlds] = True
        self._touching[other, one, worlds] = True
        # What presses and pushes is a contact of the robot.
        robot = np.flatnonzero(self._is_robot[one] | self._is_robot[other])
        self._worlds = worlds[robot]
        self._one = one[robot]
        self._other = other[robot]
        touch = touch[robot]
        self._normals, self._points = (
            np.stack([column[touch] for column in rows.T[:3]])
            for rows in (frames, points)
        )
        self._presses.fill(False)
        for side in SIDES:
            left, right = self._pad_bodies[side]
            across = (centres[:, right] - centres[:, left]).T
            across = across / np.sqrt(sum_of_products(across, across))
            for finger, inwards in zip(self._limbs[side][:2], (1.0, -1.0), strict=True):
                found, partner, sign = self._contacts_of(
                    self._one == finger, self._other == finger
                )
                along = across[:, self._worlds[found]]
                cosine = (
                    inwards * sign * sum_of_products(self._normals[:, found], along)
                )
                presses = cosine > MIN_PRESS_COSINE
                self._presses[
                    finger, partner[presses], self._worlds[found[presses]]
                ] = True

    def _contacts_of(
        self, first: Booleans, second: Booleans
    ) -> tuple[Integers, Integers, Array]:
        """Contacts that have a part as their first or second geom: number, partner, sign."""
        found = np.flatnonzero(first | second)
        first = first[found]
        partner = np.where(first, self._other[found], self._one[found])
        return found, partner, np.where(first, 1.0, -1.0)

    def _group(self, rows: list[int]) -> list[int]:
        return rows

    def _touch(self, row: int, group: list[int]) -> Booleans:
        return reduce(or_, (self._touching[row, other] for other in group))

    def grasped(self, side: Side, owner: str) -> Any:
        """Whether both fingers of a gripper press on an owner, towards each other."""
        return self._presses[self._limbs[side][:2], self._index[owner]].all(axis=0)

    def pushes(
        self, side: Side, owner: str, hinge: Callable[[], HingeAxis]
    ) -> Booleans:
        """Whether a contact of an arm turns an owner towards the open end of its hinge (3, n)."""
        row, limbs = self._index[owner], self._limbs[side]
        found, _, sign = self._contacts_of(
            np.isin(self._one, limbs) & (self._other == row),
            np.isin(self._other, limbs) & (self._one == row),
        )
        worlds = self._worlds[found]
        here = HingeAxis(*(np.asarray(part)[:, worlds] for part in hinge()))
        opening = here.opening_at(self._points[:, found])
        pushed = np.zeros(self._touching.shape[-1], dtype=bool)
        lever = sign * sum_of_products(self._normals[:, found], opening)
        pushed[worlds[lever >= MIN_LEVER]] = True
        return pushed
