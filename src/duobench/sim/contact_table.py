"""Who touches whom in many simulations of one model: contact questions answered with arrays."""

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from duobench.sim.contacts import MIN_LEVER, MIN_PRESS_COSINE, ContactOwners, HingeAxis
from duobench.spatial import hypot, sum_of_products
from duobench.types import SIDES, Array, Side

Booleans = NDArray[np.bool_]
Integers = NDArray[np.intp]


class ContactTable(ContactOwners):
    """The questions of `Contacts`, but for `backs`, about n simulations: each answer is (n,)."""

    def __init__(self, model: mujoco.MjModel, count: int) -> None:
        super().__init__(model)
        rows = len(self._index)
        self._of_geom = np.array(self._owners)
        self._side_of = np.full(rows, -1)
        """Side of each owner, by its index; -1 for what is no part of an arm."""
        for side, limbs in self._limbs.items():
            self._side_of[limbs] = side.index
        self._touching = np.zeros((rows, rows, count), dtype=bool)
        self._presses = np.zeros((rows, rows, count), dtype=bool)
        """Whether a finger presses on an owner, towards the other finger."""
        self._worlds = self._one = self._other = np.empty(0, dtype=np.intp)
        self._normals = self._points = np.empty((3, 0))
        self._answers: dict[tuple[Any, ...], Any] = {}

    def gather(self, worlds: Integers, data_of: Callable[[int], mujoco.MjData]) -> None:
        """Copy the contacts of some simulations out of the engine; the others have none then.

        Args:
            worlds: Numbers of the simulations.
            data_of: Gives the data of one of them, which may be overwritten by the next.
        """
        counts: list[int] = []
        parts: tuple[list[NDArray[Any]], ...] = ([], [], [], [])
        for world in worlds.tolist():
            contact = data_of(world).contact
            values = contact.geom, contact.dist, contact.frame, contact.pos
            for kept, value in zip(parts, values, strict=True):
                kept.append(value.copy())
            counts.append(len(values[1]))
        geoms, distances, frames, points = map(np.concatenate, parts)
        touch = np.flatnonzero(distances <= 0.0)  # a geom margin alone is no contact
        self._mark(value=False)
        self._worlds = np.repeat(worlds, counts)[touch]
        self._one, self._other = self._of_geom[geoms[touch].T]
        self._normals, self._points = frames[touch, :3].T, points[touch].T
        self._mark(value=True)

    def _mark(self, *, value: bool) -> None:
        self._touching[self._one, self._other, self._worlds] = value
        self._touching[self._other, self._one, self._worlds] = value

    def update(self, pad_centres: Array) -> None:
        """Find out which fingers press on what, and forget the answers of the step before.

        Args:
            pad_centres: Centres (n, bodies, 3) of mass of all bodies, in metres.
        """
        self._answers.clear()
        self._presses.fill(False)
        for side in SIDES:
            left, right = self._pad_bodies[side]
            across = (pad_centres[:, right] - pad_centres[:, left]).T
            across = across / hypot(*across)
            for finger, inwards in zip(self._limbs[side][:2], (1.0, -1.0), strict=True):
                first = self._one == finger
                found = np.flatnonzero(first | (self._other == finger))
                worlds, first = self._worlds[found], first[found]
                sign = np.where(first, inwards, -inwards)
                cosine = sign * sum_of_products(self._normals[:, found], across[:, worlds])
                partner = np.where(first, self._other[found], self._one[found])
                pressed = cosine > MIN_PRESS_COSINE
                self._presses[finger, partner[pressed], worlds[pressed]] = True

    def between(self, one: str, other: str) -> Booleans:
        """Whether two owners are in contact."""
        return self._touching[self._row(one), self._row(other)]

    def gripper(self, side: Side, owner: str) -> Booleans:
        """Whether a finger or the palm of a gripper is in contact with an owner."""
        return self._any_of(self._limbs[side][:-1], owner)

    def arm(self, side: Side, owner: str) -> Booleans:
        """Whether any part of an arm is in contact with an owner: links, camera or gripper."""
        return self._any_of(self._limbs[side], owner)

    def _any_of(self, limbs: list[int], owner: str) -> Booleans:
        row = self._row(owner)
        answer = self._answers.get((len(limbs), limbs[0], row))
        if answer is None:
            answer = self._touching[limbs, row].any(axis=0)
            self._answers[len(limbs), limbs[0], row] = answer
        return answer

    def released(self, owner: str) -> Booleans:
        """Whether neither gripper is in contact with an owner."""
        left, right = (self.gripper(side, owner) for side in SIDES)
        return ~(left | right)

    def grasped(self, side: Side, owner: str) -> Booleans:
        """Whether both fingers of a gripper press on an owner, towards each other."""
        row = self._row(owner)
        one, other, _, _ = self._limbs[side]
        return self._presses[one, row] & self._presses[other, row]

    def pushes(self, side: Side, owner: str, hinge: HingeAxis) -> Booleans:
        """Whether a contact of any part of an arm turns an owner towards the open end of its hinge.

        Args:
            side: Which arm.
            owner: What hangs on the hinge.
            hinge: Where the hinge is: arrays (3, n).
        """
        row, sides = self._row(owner), self._side_of
        first = (sides[self._one] == side.index) & (self._other == row)
        second = (sides[self._other] == side.index) & (self._one == row)
        found = np.flatnonzero(first | second)
        worlds = self._worlds[found]
        here = HingeAxis(*(np.asarray(part)[:, worlds] for part in hinge))
        opening = here.opening_at(self._points[:, found])
        lever = sum_of_products(self._normals[:, found], opening)
        pushed = np.zeros(self._touching.shape[-1], dtype=bool)
        pushed[worlds[np.where(first[found], lever, -lever) >= MIN_LEVER]] = True
        return pushed
