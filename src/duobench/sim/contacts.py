"""Who touches whom: the only place that reads the engine's contact list.

Every geom belongs to one owner: a finger pad, the rest of a gripper, the rest of an arm, or the
body that carries it. One vectorized query a control step turns the contact list into a symmetric
boolean matrix over owners.
"""

from __future__ import annotations

from enum import StrEnum

import mujoco
import numpy as np
from numpy.typing import NDArray

from duobench.errors import UnknownNameError
from duobench.scene.naming import gripper_name, pad_names
from duobench.types import SIDES, Side


class Limb(StrEnum):
    """The parts of an arm that contacts tell apart."""

    LEFT_PAD = "left_pad"
    RIGHT_PAD = "right_pad"
    HAND = "hand"
    ARM = "arm"


def limb_owner(side: Side, limb: Limb) -> str:
    """Name of an owner that is a part of the robot."""
    return f"{side}/{limb}"


def _owner_of_body(name: str) -> str:
    for side in SIDES:
        if name in pad_names(side):
            limb = Limb.LEFT_PAD if name == pad_names(side)[0] else Limb.RIGHT_PAD
            return limb_owner(side, limb)
        if name.startswith(f"{gripper_name(side)}/"):
            return limb_owner(side, Limb.HAND)
        if name.startswith(f"{side}/"):
            return limb_owner(side, Limb.ARM)
    return name


class Contacts:
    """Contact questions about one model and its data."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Assign every geom to its owner."""
        self._data = data
        self._index: dict[str, int] = {}
        owner = np.empty(model.ngeom, dtype=np.int64)
        for geom in range(model.ngeom):
            name = _owner_of_body(model.body(model.geom_bodyid[geom]).name)
            owner[geom] = self._index.setdefault(name, len(self._index))
        self._owner = owner
        self._touch = np.zeros((len(self._index),) * 2, dtype=bool)
        self._fingers = {
            side: self.ids(limb_owner(side, Limb.LEFT_PAD), limb_owner(side, Limb.RIGHT_PAD))
            for side in SIDES
        }
        self._grippers = {
            side: np.append(self._fingers[side], self.ids(limb_owner(side, Limb.HAND)))
            for side in SIDES
        }

    @property
    def owners(self) -> tuple[str, ...]:
        """Names of all owners, in the order of the matrix."""
        return tuple(self._index)

    def ids(self, *owners: str) -> NDArray[np.int64]:
        """Rows of owners in the matrix.

        Raises:
            UnknownNameError: There is no such owner.
        """
        for owner in owners:
            if owner not in self._index:
                raise UnknownNameError("contact owner", owner, self._index)
        return np.array([self._index[owner] for owner in owners], dtype=np.int64)

    def update(self) -> None:
        """Read the engine's contact list; a geom margin alone is no contact."""
        contact = self._data.contact
        touching = contact.dist <= 0.0
        first, second = self._owner[contact.geom[touching]].T
        self._touch[:] = False
        self._touch[first, second] = True
        self._touch[second, first] = True

    def between(self, one: str, other: str) -> bool:
        """Whether two owners are in contact."""
        a, b = self.ids(one, other)
        return bool(self._touch[a, b])

    def partners(self, owner: str) -> frozenset[str]:
        """All owners in contact with one."""
        row = self._touch[self.ids(owner)[0]]
        return frozenset(name for name, number in self._index.items() if row[number])

    def gripper(self, side: Side, owner: str) -> bool:
        """Whether a finger or the palm of a gripper is in contact with an owner."""
        return bool(self._touch[self._grippers[side], self._index[owner]].any())

    def pads(self, side: Side, owner: str) -> bool:
        """Whether both finger pads of a gripper are in contact with an owner."""
        return bool(self._touch[self._fingers[side], self._index[owner]].all())

    def deepest(self, limit: float) -> list[tuple[str, str, float]]:
        """Contacts between different owners that penetrate by more than `limit` metres."""
        contact = self._data.contact
        deep = np.flatnonzero(contact.dist < -limit)
        names = self.owners
        return [
            (names[a], names[b], -float(contact.dist[i]))
            for i in deep
            for a, b in [self._owner[contact.geom[i]]]
            if a != b
        ]
