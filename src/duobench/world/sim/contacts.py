"""Who touches whom: the only place that reads the engine's contact list, once a control step.

Every geom belongs to one owner: a finger (its pad and its own linkage), the rest of a gripper, the
rest of an arm, or the body that carries it.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from enum import StrEnum
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from duobench.core.errors import check_known
from duobench.core.spatial import dot, length
from duobench.core.types import SIDES, Side
from duobench.world.scene.naming import gripper_name, pad_names

if TYPE_CHECKING:
    import mujoco

MAX_PRESS_ANGLE = math.radians(60.0)
"""Angle in radians between a finger's contact normal and the direction to the other finger up to
which the finger presses towards it [task definitions]."""
HAND_SIZE = 0.25
"""No point of a gripper is further from its pads, in metres: 0.186 (measured, open and closed)."""
MIN_PRESS_COSINE = math.cos(MAX_PRESS_ANGLE)
MIN_LEVER = 0.020
"""Lever in metres about a hinge from which on a contact pushes a lid open or shut: nearer to the
axis, along it or towards it, it turns nothing [task definitions]."""
MAX_BACKING_ANGLE = math.radians(12.0)
"""Angle in radians between the way from a hand to a lid and the lid's normal up to which the hand
is inside the lid's outline: the way to its edge from beside it is further aslant."""
_MIN_BACKING_COSINE = math.cos(MAX_BACKING_ANGLE)
MOST_BESIDE = 0.004
"""How far in metres beside the outline a hand may be that is further aslant: what is so near is
struck by an edge that is as thick, or is round."""


class HingeAxis(NamedTuple):
    """The axis of a hinge as it is now, in the table frame."""

    anchor: Any
    """A point (3,) of the axis, in metres."""
    axis: Any
    """Its direction (3,): turning about it opens."""

    def opening_at(self, point: Iterable[Any]) -> tuple[Any, Any, Any]:
        """Velocity (3,) of a point (3,) of the hinged part while it opens by 1 rad/s, in m/s.

        It is as long as the point's distance from the axis in metres; its product with a direction
        is the lever of a push.
        """
        ax, ay, az = self.axis
        px, py, pz = point
        ox, oy, oz = self.anchor
        x, y, z = px - ox, py - oy, pz - oz
        return ay * z - az * y, az * x - ax * z, ax * y - ay * x


class Limb(StrEnum):
    """The parts of an arm that contacts tell apart."""

    LEFT_FINGER = "left_finger"
    RIGHT_FINGER = "right_finger"
    PALM = "palm"
    ARM = "arm"


def limb_owner(side: Side, limb: Limb) -> str:
    """Name of an owner that is a part of the robot."""
    return f"{side}/{limb}"


def _owner_of_body(name: str) -> str:
    for side in SIDES:
        for start, limb in (
            (f"{gripper_name(side)}/left_", Limb.LEFT_FINGER),
            (f"{gripper_name(side)}/right_", Limb.RIGHT_FINGER),
            (f"{gripper_name(side)}/", Limb.PALM),
            (f"{side}/", Limb.ARM),
        ):
            if name.startswith(start):
                return limb_owner(side, limb)
    return name


class ContactOwners(ABC):
    """Who owns each geom of a model, and who touches whom, in one simulation or in many.

    All raise `UnknownNameError` where there is no such owner.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self._index: dict[str, int] = {}
        bodies = (model.body(body).name for body in model.geom_bodyid)
        self._owners = [
            self._index.setdefault(_owner_of_body(body), len(self._index)) for body in bodies
        ]
        """Row of each geom's owner."""
        self._limbs = {
            side: [self._index[limb_owner(side, limb)] for limb in Limb] for side in SIDES
        }
        self._pad_bodies = {
            side: [model.body(name).id for name in pad_names(side)] for side in SIDES
        }

    @property
    def owners(self) -> tuple[str, ...]:
        """Names of all owners of geoms."""
        return tuple(self._index)

    def _row(self, owner: str) -> int:
        # Looked up first: to check each time takes a tenth of a judgement.
        if owner not in self._index:
            check_known("contact owner", owner, self._index)
        return self._index[owner]

    @abstractmethod
    def _touch(self, one: int, other: int) -> Any:
        """Whether two owners, by row, are in contact: a bool, or booleans (n,)."""

    def between(self, one: str, other: str) -> Any:
        """Whether two owners are in contact."""
        return self._touch(self._row(one), self._row(other))

    def gripper(self, side: Side, owner: str) -> Any:
        """Whether a finger or the palm of a gripper is in contact with an owner."""
        row = self._row(owner)
        left, right, palm, _ = self._limbs[side]
        return self._touch(left, row) | self._touch(right, row) | self._touch(palm, row)

    def arm(self, side: Side, owner: str) -> Any:
        """Whether any part of an arm is in contact with an owner: links, camera or gripper."""
        return self._touch(self._limbs[side][-1], self._row(owner)) | self.gripper(side, owner)

    def released(self, owner: str) -> Any:
        """Whether neither gripper is in contact with an owner."""
        return (self.gripper(Side.LEFT, owner) | self.gripper(Side.RIGHT, owner)) ^ True


class Contacts(ContactOwners):
    """Contact questions about one model and its data."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        super().__init__(model)
        self._data = data
        # A pair of owners is one number, lower row first, so that one set holds all contacts.
        self._stride = len(self._index)
        self._touching: set[int] = set()
        self._pairs: list[list[int]] = []
        self._distances: list[float] = []
        self._grasped: dict[tuple[Side, int], bool] = {}
        """Answers of `grasped` since the last update; several questions ask the same."""
        self._solved = False
        """Whether contacts have forces: the engine finds contacts first."""
        self._pad_centres = data.xipos
        self._model = model
        self._solids: dict[int, list[int]] = {}
        """Geoms of each owner that collide."""
        for geom, row in enumerate(self._owners):
            if model.geom_contype[geom] or model.geom_conaffinity[geom]:
                self._solids.setdefault(row, []).append(geom)
        self._hands = {
            side: [geom for limb in limbs[:-1] for geom in self._solids.get(limb, ())]
            for side, limbs in self._limbs.items()
        }
        """Geoms of each gripper that collide."""

    def update(self) -> None:
        """Read the engine's contact list; a geom margin alone is no contact."""
        contact = self._data.contact
        owners, stride = self._owners, self._stride
        touching = set()
        # Plain numbers: for a few dozen contacts they are several times faster than arrays.
        self._pairs, self._distances = contact.geom.tolist(), contact.dist.tolist()
        for (first, second), distance in zip(self._pairs, self._distances, strict=True):
            if distance <= 0.0:
                one, other = owners[first], owners[second]
                touching.add(one * stride + other if one < other else other * stride + one)
        self._touching = touching
        self._grasped.clear()
        self._solved = False

    def partners(self, owner: str) -> frozenset[str]:
        """All owners in contact with one."""
        row = self._row(owner)
        return frozenset(name for name, other in self._index.items() if self._touch(row, other))

    def pushes(self, side: Side, owner: str, hinge: HingeAxis) -> bool:
        """Whether a contact of any part of an arm turns an owner towards the open end of its hinge.

        The engine's normal tells where a contact pushes, and `MIN_LEVER` what turns nothing.
        """
        contact = self._data.contact
        return self.arm(side, owner) and any(
            sign * dot(contact.frame[number, :3], hinge.opening_at(contact.pos[number].tolist()))
            >= MIN_LEVER
            for number, sign in self._normals(self._limbs[side], self._row(owner))
        )

    def moment(self, side: Side, owner: str, hinge: HingeAxis) -> float:
        """Moment in N·m of all contacts of an arm with an owner about its hinge; above 0 it opens.

        The forces are those with which the next physics step begins. The engine solves for them
        anew in that step, so that to ask for them changes nothing.
        """
        from mujoco import mj_contactForce

        model, data, total, force = self._model, self._data, 0.0, np.zeros(6)
        for number, sign in self._normals(self._limbs[side], self._row(owner)):
            self._solve()
            mj_contactForce(model, data, number, force)
            contact = data.contact
            opening = hinge.opening_at(contact.pos[number].tolist())
            forces, torques = force.tolist()[:3], force.tolist()[3:]
            for push, turn, way in zip(
                forces, torques, contact.frame[number].reshape(3, 3), strict=True
            ):
                total += sign * (push * dot(way, opening) + turn * dot(way, hinge.axis))
        return total

    def _solve(self) -> None:
        """Let the engine solve for the forces of contacts, once for each state."""
        from mujoco import mj_fwdAcceleration, mj_fwdActuation, mj_fwdConstraint

        if not self._solved:
            for stage in (mj_fwdActuation, mj_fwdAcceleration, mj_fwdConstraint):
                stage(self._model, self._data)
            self._solved = True

    def _normals(self, parts: list[int], row: int) -> Iterator[tuple[int, float]]:
        """Contacts of parts of the robot with an owner, and the sign of the normal towards it."""
        owners = self._owners
        for number, (first, second) in enumerate(self._pairs):
            if self._distances[number] > 0.0:
                continue
            # The engine's normal points from the first geom to the second.
            if owners[second] == row and owners[first] in parts:
                yield number, 1.0
            elif owners[first] == row and owners[second] in parts:
                yield number, -1.0

    def behind(
        self, side: Side, owner: str, hinge: HingeAxis, distance: float
    ) -> Iterator[tuple[float, float]]:
        """Yield where a gripper is on the side of an owner from which it would push it open.

        A finger or the palm is at most `distance` metres from it, along the owner's normal there,
        so that the owner would turn onto the hand if it were let go. It measures between geoms,
        which takes as long as twenty of the other questions, unless the hand is far away.

        Yields:
            Each gap between two geoms, and its distance from the hinge's axis, in metres.
        """
        from mujoco import mj_geomDistance

        model, data, ends = self._model, self._data, np.zeros(6)
        pad = self._pad_centres[self._pad_bodies[side][0]].tolist()
        for other in self._solids.get(self._row(owner), ()):
            furthest = float(model.geom_rbound[other]) + HAND_SIZE + distance
            if math.dist(pad, data.geom_xpos[other].tolist()) > furthest:
                continue
            for one in self._hands[side]:
                gap = mj_geomDistance(model, data, one, other, distance, ends)
                if not 0.0 < gap < distance:
                    continue
                opening = hinge.opening_at(ends[3:].tolist())
                radius = length(opening)
                lever = dot(ends[3:] - ends[:3], opening) / gap
                cosine = lever / radius
                beside = gap * math.sqrt(max(0.0, 1.0 - cosine * cosine))
                least = MIN_PRESS_COSINE if beside <= MOST_BESIDE else _MIN_BACKING_COSINE
                if lever >= MIN_LEVER and cosine >= least:
                    yield gap, radius

    def grasped(self, side: Side, owner: str) -> bool:
        """Whether both fingers of a gripper press on an owner, towards each other.

        A finger is its pad or its own linkage behind it, which clamps what reaches deep into the
        gripper. Fingers that are pressed on top of something touch it both, and grasp nothing: so
        each has a contact whose normal points to the other finger, within `MAX_PRESS_ANGLE`.
        """
        row = self._row(owner)
        answer = self._grasped.get((side, row))
        if answer is None:
            answer = self._grasped[side, row] = self._grasps(side, row)
        return answer

    def _grasps(self, side: Side, row: int) -> bool:
        one, other, _, _ = self._limbs[side]
        if not (self._touch(one, row) and self._touch(other, row)):
            return False
        left, right = self._pad_bodies[side]
        across = self._pad_centres[right] - self._pad_centres[left]
        x, y, z = (across / length(across)).tolist()
        frames = self._data.contact.frame
        for finger, inwards in ((one, 1.0), (other, -1.0)):
            for number, sign in self._normals([finger], row):
                a, b, c = frames[number, :3].tolist()
                if inwards * sign * (a * x + b * y + c * z) > MIN_PRESS_COSINE:
                    break
            else:
                return False
        return True

    def deepest(self, limit: float) -> list[tuple[str, str, float]]:
        """Contacts between different owners that penetrate by more than `limit` metres."""
        names, owners = self.owners, self._owners
        return [
            (names[owners[one]], names[owners[other]], -distance)
            for (one, other), distance in zip(self._pairs, self._distances, strict=True)
            if distance < -limit and owners[one] != owners[other]
        ]

    def _touch(self, one: int, other: int) -> bool:
        low, high = (one, other) if one < other else (other, one)
        return low * self._stride + high in self._touching
