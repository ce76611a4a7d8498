"""Contacts between bodies: the only reader of the engine's contact list, once a control step.

Every geom belongs to one owner: a finger (its pad and its own linkage), the rest of a gripper, the
rest of an arm, or the body that carries it.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from enum import StrEnum
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from duobench.core.errors import Named
from duobench.core.spatial import dot, length, sum_of_products
from duobench.core.types import SIDES, Side
from duobench.world.robot.gripper import Gripper
from duobench.world.scene.naming import gripper_name, pad_names

if TYPE_CHECKING:
    import mujoco

MAX_PRESS_ANGLE = math.radians(60.0)
"""Angle in radians between a finger's contact normal and the direction to the other finger up to
which the finger presses towards it [task definitions]."""
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
    """Current axis of a hinge, in the table frame."""

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
        x = px - ox
        y = py - oy
        z = pz - oz
        return ay * z - az * y, az * x - ax * z, ax * y - ay * x


Pair = tuple[int, int]
"""An owner, by row, and a group of others."""


class Limb(StrEnum):
    """The parts of an arm that contacts tell apart."""

    LEFT_FINGER = "left_finger"
    RIGHT_FINGER = "right_finger"
    PALM = "palm"
    ARM = "arm"


def limb_owner(side: Side, limb: Limb) -> str:
    """Name of an owner that is a part of the robot."""
    return f"{side}/{limb}"


def gripper_owners(*sides: Side) -> tuple[str, ...]:
    """Names of the parts of grippers."""
    return tuple(
        limb_owner(side, limb)
        for side in sides
        for limb in Limb
        if limb is not Limb.ARM
    )


def arm_owners(side: Side) -> tuple[str, ...]:
    """Names of all parts of an arm."""
    return tuple(limb_owner(side, limb) for limb in Limb)


class Touch(NamedTuple):
    """Contacts on which the answer to a question depends."""

    owner: str
    others: tuple[str, ...]
    """Other owners: while none of them touches the first one, the answer is always the same."""
    is_all: bool = False
    """Whether it also is while one of them does, since nothing else is asked."""


_FINGERS = (Limb.LEFT_FINGER, Limb.RIGHT_FINGER)


def _owner_of_body(name: str, gripper: Gripper) -> str:
    for side in SIDES:
        prefix = f"{gripper_name(side)}/"
        if name.startswith(prefix):
            finger = gripper.finger_of(name.removeprefix(prefix))
            if finger is None:
                return limb_owner(side, Limb.PALM)
            return limb_owner(side, _FINGERS[gripper.fingers.index(finger)])
        if name.startswith(f"{side}/"):
            return limb_owner(side, Limb.ARM)
    return name


class ContactOwners(ABC):
    """Owners of the geoms of a model, and contacts between them, in one simulation or in many.

    All raise `UnknownNameError` where there is no such owner.
    """

    def __init__(self, model: mujoco.MjModel, gripper: Gripper) -> None:
        self._index = Named[int]("contact owner")
        bodies = (model.body(body).name for body in model.geom_bodyid)
        self._owners = [
            self._index.setdefault(_owner_of_body(body, gripper), len(self._index))
            for body in bodies
        ]
        """Row of each geom's owner."""
        self._limbs = {
            side: [self._index[limb_owner(side, limb)] for limb in Limb]
            for side in SIDES
        }
        self._single = [self._group([row]) for row in self._index.values()]
        self._arms = {side: self._group(rows) for side, rows in self._limbs.items()}
        self._grippers = {
            side: self._group(rows[:-1]) for side, rows in self._limbs.items()
        }
        self._hands = self._group(
            [row for rows in self._limbs.values() for row in rows[:-1]]
        )
        self._pad_bodies = {
            side: [model.body(name).id for name in pad_names(side, gripper)]
            for side in SIDES
        }

    @property
    def owners(self) -> tuple[str, ...]:
        """Names of all owners of geoms."""
        return tuple(self._index)

    @abstractmethod
    def _group(self, rows: list[int]) -> Any:
        """Some owners, by row, as `_touch` takes them."""

    @abstractmethod
    def _touch(self, row: int, group: Any) -> Any:
        """Whether an owner, by row, is in contact with one of a group: a bool, or booleans (n,)."""

    def between(self, one: str, other: str) -> Any:
        """Whether two owners are in contact."""
        return self._touch(self._index[one], self._single[self._index[other]])

    def gripper(self, side: Side, owner: str) -> Any:
        """Whether a finger or the palm of a gripper is in contact with an owner."""
        return self._touch(self._index[owner], self._grippers[side])

    def arm(self, side: Side, owner: str) -> Any:
        """Whether any part of an arm is in contact with an owner: links, camera or gripper."""
        return self._touch(self._index[owner], self._arms[side])

    def released(self, owner: str) -> Any:
        """Whether neither gripper is in contact with an owner."""
        return self._touch(self._index[owner], self._hands) ^ True


class Contacts(ContactOwners):
    """Contact questions about one model and its data."""

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, gripper: Gripper
    ) -> None:
        super().__init__(model, gripper)
        self._reach = gripper.reach
        self._data = data
        # A group of owners is a number whose binary digits are its rows.
        self._partners = [0] * len(self._index)
        """Partners that each owner touches, as a group."""
        self._fingers = {
            side: self._group(rows[:2]) for side, rows in self._limbs.items()
        }
        self._touching: list[int] = []
        """The two owners of each contact, as a group; none where there is but a margin."""
        self._frames: Any = None
        """Frame (9,) of each contact: a view of the engine's."""
        self._pairs: list[list[int]] = []
        self._distances: list[float] = []
        self._solved = False
        """Whether contacts have forces: the engine finds contacts first."""
        self._pads = {
            side: data.xipos[left :: right - left][:2]
            for side, (left, right) in self._pad_bodies.items()
        }
        """Centres (2, 3) of the left and the right pad of each gripper: views of the engine's."""
        self._model = model
        self._solids: dict[int, list[int]] = {}
        """Geoms of each owner that collide."""
        for geom, row in enumerate(self._owners):
            if model.geom_contype[geom] or model.geom_conaffinity[geom]:
                self._solids.setdefault(row, []).append(geom)
        self._hand_geoms = {
            side: [geom for limb in limbs[:-1] for geom in self._solids.get(limb, ())]
            for side, limbs in self._limbs.items()
        }
        """Geoms of each gripper that collide."""

    def update(self) -> None:
        """Read the engine's contact list; a geom margin alone is no contact."""
        contact = self._data.contact
        owners, single = self._owners, self._single
        partners, touching = [0] * len(self._index), []
        # Plain numbers: for a few dozen contacts they are several times faster than arrays.
        self._pairs, self._distances = contact.geom.tolist(), contact.dist.tolist()
        for (first, second), distance in zip(self._pairs, self._distances, strict=True):
            if distance <= 0.0:
                one, other = owners[first], owners[second]
                partners[one] |= single[other]
                partners[other] |= single[one]
                touching.append(single[one] | single[other])
            else:
                touching.append(0)
        self._partners, self._touching = partners, touching
        self._frames = contact.frame
        self._solved = False

    def pair(self, touch: Touch) -> Pair:
        """The owners of a touch, as `are_touching` takes them."""
        return self._index[touch.owner], self._group(
            [self._index[other] for other in touch.others]
        )

    def is_touching(self, pair: Pair) -> bool:
        """Whether the first owner of a pair is in contact with one of the others."""
        row, group = pair
        return self._partners[row] & group != 0

    def are_touching(self, pairs: Iterable[tuple[Pair, bool]]) -> bool:
        """Whether each of these pairs touches, or does not, as is said of it."""
        partners = self._partners
        for (row, group), touching in pairs:  # noqa: SIM110 - a generator takes longer
            if (partners[row] & group != 0) is not touching:
                return False
        return True

    def partners(self, owner: str) -> frozenset[str]:
        """All owners in contact with one."""
        return frozenset(name for name in self._index if self.between(owner, name))

    def pushes(
        self,
        side: Side,
        owner: str,
        hinge: Callable[[], HingeAxis],
    ) -> bool:
        """Whether a contact of any part of an arm turns an owner towards the open end of its hinge.

        The engine's normal tells where a contact pushes, and `MIN_LEVER` what turns nothing.
        """
        if not self.arm(side, owner):
            return False
        points = self._data.contact.pos
        axis = hinge()
        for number, sign in self._normals(self._limbs[side], self._index[owner]):
            opening = axis.opening_at(points[number].tolist())
            lever = sum_of_products(self._frames[number, :3].tolist(), opening)
            if sign * lever >= MIN_LEVER:
                return True
        return False

    def moment(
        self,
        side: Side,
        owner: str,
        hinge: HingeAxis,
    ) -> float:
        """Moment in N·m of all contacts of an arm with an owner about its hinge; above 0 it opens.

        The forces are those with which the next physics step begins. The engine solves for them
        anew in that step, so that to ask for them changes nothing.
        """
        from mujoco import mj_contactForce

        model = self._model
        data = self._data
        total = 0.0
        force = np.zeros(6)
        for number, sign in self._normals(self._limbs[side], self._index[owner]):
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
        both = {self._single[row] | self._single[part] for part in parts}
        for number, touching in enumerate(self._touching):
            if touching in both:
                # The engine's normal points from the first geom to the second.
                yield (
                    number,
                    1.0 if self._owners[self._pairs[number][1]] == row else -1.0,
                )

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

        model = self._model
        data = self._data
        ends = np.zeros(6)
        pad = self._pads[side][0].tolist()
        for other in self._solids.get(self._index[owner], ()):
            furthest = float(model.geom_rbound[other]) + self._reach + distance
            if math.dist(pad, data.geom_xpos[other].tolist()) > furthest:
                continue
            for one in self._hand_geoms[side]:
                gap = mj_geomDistance(model, data, one, other, distance, ends)
                if not 0.0 < gap < distance:
                    continue
                opening = hinge.opening_at(ends[3:].tolist())
                radius = length(opening)
                lever = dot(ends[3:] - ends[:3], opening) / gap
                cosine = lever / radius
                beside = gap * math.sqrt(max(0.0, 1.0 - cosine * cosine))
                least = (
                    MIN_PRESS_COSINE if beside <= MOST_BESIDE else _MIN_BACKING_COSINE
                )
                if lever >= MIN_LEVER and cosine >= least:
                    yield gap, radius

    def grasped(self, side: Side, owner: str) -> bool:
        """Whether both fingers of a gripper press on an owner, towards each other.

        A finger is its pad or its own linkage behind it, which clamps what reaches deep into the
        gripper. Fingers that are pressed on top of something touch it both, and grasp nothing: so
        each has a contact whose normal points to the other finger, within `MAX_PRESS_ANGLE`.
        """
        row, fingers = self._index[owner], self._fingers[side]
        if self._partners[row] & fingers != fingers:
            return False
        one, other, _, _ = self._limbs[side]
        left, right = self._pads[side].tolist()
        left_x, left_y, left_z = left
        right_x, right_y, right_z = right
        x = right_x - left_x
        y = right_y - left_y
        z = right_z - left_z
        far = math.sqrt(x * x + y * y + z * z)
        x, y, z = x / far, y / far, z / far
        return self._presses(one, row, x, y, z) and self._presses(
            other, row, -x, -y, -z
        )

    def _presses(
        self,
        finger: int,
        row: int,
        x: float,
        y: float,
        z: float,
    ) -> bool:
        """Whether a contact of a finger with an owner pushes it along a unit vector."""
        pair = self._single[finger] | self._single[row]
        touching = self._touching
        number = -1
        while True:
            try:
                number = touching.index(pair, number + 1)
            except ValueError:
                return False
            a, b, c = self._frames[number, :3].tolist()
            push = a * x + b * y + c * z
            # The engine's normal points from the first geom to the second.
            if self._owners[self._pairs[number][1]] != row:
                push = -push
            if push > MIN_PRESS_COSINE:
                return True

    def deepest(self, limit: float) -> list[tuple[str, str, float]]:
        """Contacts between different owners that penetrate by more than `limit` metres."""
        names, owners = self.owners, self._owners
        return [
            (names[owners[one]], names[owners[other]], -distance)
            for (one, other), distance in zip(self._pairs, self._distances, strict=True)
            if distance < -limit and owners[one] != owners[other]
        ]

    def _group(self, rows: list[int]) -> int:
        return sum(1 << row for row in rows)

    def _touch(self, row: int, group: int) -> bool:
        return self._partners[row] & group != 0
