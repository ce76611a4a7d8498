"""The guard: our own simulation of the arms, asked before anything moves.

The control boxes of two arms know nothing of each other, nor of the table. The guard knows arms,
grippers, wrist cameras, table and mount, what a rig's file says of its cell, and what stands fixed
in a layout; it does not know loose objects. MuJoCo is loaded at first use.
"""

from __future__ import annotations

import threading
from collections.abc import (
    Iterable,
    Iterator,
    Mapping,
    Sequence,
)
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from duobench.core.errors import BackendError
from duobench.core.spatial import SE3
from duobench.core.types import SIDES, Array, Side
from duobench.real.cell import Obstacle, Workspace
from duobench.real.follower import HIGHEST, LOWEST
from duobench.world.robot.frames import Robot
from duobench.world.scene.naming import gripper_name, tcp_name

if TYPE_CHECKING:
    from mujoco import MjModel

    from duobench.world.objects.prop import Prop
    from duobench.world.sim.layout import Layout
    from duobench.world.sim.simulation import Simulation

MARGIN = 0.02
"""Distance in metres that arms and hands keep from each other, from table and mount."""
FINGER_MARGIN = 0.01
"""Distance of fingers from the other arm, and of a hand from its own arm: hands work together.
Experts of the tasks that the paper rebuilt keep it [measured]."""
TABLE_DEPTH = 0.002
"""Depth in metres to which fingers may be sent into the table: they grasp what lies on it."""
PROP_MARGIN = 0.01
"""Distance in metres that arms and hands keep from what stands fixed in a layout. Fingers may touch
it: they lift its lid, and grasp what lies in it."""
OBSTACLE = "obstacle"
"""Begins the name of what a rig's file says is in the way."""
PATH_STEP = 0.02
"""Largest change of a joint in radians between two configurations of a path that are looked at."""
_ALLOWED_NEARER = 1e-4
"""A path may begin too near something, if it comes no nearer than by this many metres."""
_GREY = (0.5, 0.5, 0.5, 1.0)


@dataclass(frozen=True, kw_only=True, slots=True)
class Clearance:
    """Distance of two parts."""

    distance: float
    """Their distance in metres; negative where they overlap."""
    margin: float
    """The distance that is right at least."""
    parts: tuple[str, str]
    """Names of both, in words."""

    @property
    def room(self) -> float:
        """Metres that are left; negative where they are too near."""
        return self.distance - self.margin

    def __str__(self) -> str:
        one, other = self.parts
        return (
            f"{one} would be {1000 * self.distance:.0f} mm from {other}; at least "
            f"{1000 * self.margin:.0f} mm is right."
        )


class Guard:
    """Keeps the arms apart, and off the table and their mount. Any thread may ask it.

    The simulation is made when it is first asked.
    """

    def __init__(
        self,
        robot: Robot,
        workspace: Workspace | None = None,
        obstacles: Mapping[str, Obstacle] | None = None,
    ) -> None:
        self._lock = threading.RLock()
        self._robot = robot
        self._workspace, self._obstacles = workspace, obstacles or {}
        self._fixed: tuple[Prop, ...] = ()
        self._poses: Mapping[str, SE3] = {}
        self._sim: Simulation | None = None

    def set_scene(self, props: Iterable[Prop], layout: Layout) -> None:
        """Look out for those props, too, that stand fixed in a layout, and for no earlier ones."""
        fixed = tuple(
            prop for prop in props if prop.fixed and prop.name in layout.poses
        )
        with self._lock:
            if fixed != self._fixed:
                self._fixed, self._sim = fixed, None
            self._poses = layout.poses
            if self._sim is not None:
                self._place(self._sim)

    def nearest(self, joints: Array, within: float = 0.1) -> Clearance | None:
        """The two parts with the least room at joint positions (2, 7) in radians.

        Those that are further apart than `within`, in metres, do not count; None if all are.
        """
        import mujoco

        with self._lock:
            sim = self._at(joints)
            best: Clearance | None = None
            for one, other, margin in self._near_pairs(sim, within):
                # Overlaps always count.
                most = within if best is None else best.room + margin
                reach = max(most, 0.0)
                distance = mujoco.mj_geomDistance(
                    sim.model, sim.data, one, other, reach, None
                )
                if distance < most:
                    parts = self._words[one], self._words[other]
                    best = Clearance(distance=distance, margin=margin, parts=parts)
            return best

    def problem(self, joints: Array) -> str | None:
        """Return what is too near or outside at joint positions (2, 7), in words, or None."""
        return next((words for room, words in self._rooms(joints) if room < 0.0), None)

    def plan_path(self, start: Array, end: Array) -> list[Array]:
        """A path between joint positions (2, 7) on which nothing comes too near anything.

        At its start the arms may be too near something; then it comes no nearer. A tool that is
        outside of the workspace gets no further out. It is what to go
        through, `end` last, each on a straight line from the one before.
        """
        why: str | None = None
        for path in path_candidates(start, end):
            problem = self._problem_on(start, path)
            if problem is None:
                return path
            why = why or problem
        raise BackendError(
            f"No free way home was found: on the straight one {why} Lead the arms by hand to a "
            "place from which they can go home."
        )

    def is_free(self, start: Array, path: Sequence[Array]) -> bool:
        """Whether nothing comes too near anything on a path, as `plan_path` gives them."""
        return self._problem_on(start, path) is None

    def _problem_on(self, start: Array, path: Sequence[Array]) -> str | None:
        rooms = [room for room, _ in self._rooms(start)]
        allowed = [room - _ALLOWED_NEARER if room < 0.0 else 0.0 for room in rooms]
        here = start
        for there in path:
            steps = max(1, int(np.ceil(np.max(np.abs(there - here)) / PATH_STEP)))
            for step in range(1, steps + 1):
                found = self._rooms(here + (there - here) * (step / steps))
                for number, (room, words) in enumerate(found):
                    if room < allowed[number]:
                        return words
                    allowed[number] = max(allowed[number], room - _ALLOWED_NEARER)
            here = there
        return None

    def _rooms(self, joints: Array) -> list[tuple[float, str]]:
        """Missing distances in metres (negative) of parts and of tools outside, with words."""
        with self._lock:
            nearest = self.nearest(joints, MARGIN)
            rooms = [
                (0.0, "") if nearest is None else (min(nearest.room, 0.0), str(nearest))
            ]
            workspace = self._workspace
            if workspace is not None:
                places = self._at(joints).data.site_xpos
                room, side = min(
                    (workspace.room(places[site]), side)
                    for side, site in self._tools.items()
                )
                far = f"{1000 * -room:.0f} mm outside of the workspace that the rig's file allows."
                rooms.append((min(room, 0.0), f"the {side} tool would be {far}"))
            return rooms

    def _at(self, joints: Array) -> Simulation:
        import mujoco

        sim = self._sim
        if sim is None:
            from duobench.world.sim.simulation import Simulation

            boxes = [
                _prop_of(name, obstacle) for name, obstacle in self._obstacles.items()
            ]
            sim = self._sim = Simulation([*self._fixed, *boxes], robot=self._robot)
            self._place(sim)
            self._describe(sim)
        sim.data.qpos[sim.duo.joints] = joints
        mujoco.mj_kinematics(sim.model, sim.data)
        return sim

    def _place(self, sim: Simulation) -> None:
        """Put what stands still where it stands."""
        for prop in self._fixed:
            sim.place(prop.name, self._poses[prop.name])
        for name, each in self._obstacles.items():
            sim.place(f"{OBSTACLE} {name}", SE3.at(*each.centre, yaw=each.yaw))

    def _describe(self, sim: Simulation) -> None:
        """Say what each geom is, and list all pairs of them that may come too near."""
        model = sim.model
        solid = np.flatnonzero(
            (model.geom_contype != 0) | (model.geom_conaffinity != 0)
        )
        parts = {int(geom): _part_of(model, int(geom), self._robot) for geom in solid}
        parts = {geom: part for geom, part in parts.items() if not part.is_hinged}
        self._tools = {side: model.site(tcp_name(side)).id for side in SIDES}
        self._words = {geom: part.words for geom, part in parts.items()}
        self._pairs = [
            (one, other, margin)
            for (one, first), (other, second) in combinations(parts.items(), 2)
            if (margin := _margin(first, second)) is not None
        ]
        self._first, self._second = np.array([pair[:2] for pair in self._pairs]).T
        self._reach = model.geom_rbound[self._first] + model.geom_rbound[self._second]

    def _near_pairs(
        self, sim: Simulation, within: float
    ) -> list[tuple[int, int, float]]:
        """Geoms whose spheres may come nearer than `within`, with the distance that they keep."""
        places = sim.data.geom_xpos
        between = places[self._first] - places[self._second]
        near = np.einsum("ij,ij->i", between, between) < (self._reach + within) ** 2
        return [self._pairs[number] for number in np.flatnonzero(near)]


@dataclass(frozen=True, kw_only=True, slots=True)
class _BodyPart:
    """Owner of a geom."""

    words: str
    side: Side | None = None
    """The arm; None for what stands still."""
    link: int = 0
    """Number of the link; those of hand and camera are 7."""
    is_finger: bool = False
    """Whether it is part of a gripper's fingers."""
    is_table: bool = False
    is_prop: bool = False
    """Whether it is an object of a task, which fingers may touch."""
    is_hinged: bool = False
    """Whether it is a lid or a door, whose angle is unknown."""


def _prop_of(name: str, obstacle: Obstacle) -> Prop:
    from duobench.world.objects.prop import Prop
    from duobench.world.objects.shapes import box
    from duobench.world.objects.solid import Solid

    shape = box(*obstacle.size)
    return Prop(
        name=f"{OBSTACLE} {name}", solid=Solid(shapes=(shape,), rgba=_GREY), fixed=True
    )


def _part_of(model: MjModel, geom: int, robot: Robot) -> _BodyPart:
    number = model.geom_bodyid[geom]
    body, name = model.body(number).name, model.geom(geom).name
    root = model.body_rootid[number]
    if model.body_mocapid[root] >= 0:
        thing = model.body(root).name
        return _BodyPart(
            words=f"the {thing.replace('_', ' ')}",
            is_prop=not thing.startswith(f"{OBSTACLE} "),
            is_hinged=bool(model.body_dofnum[number] > 0),
        )
    for side in SIDES:
        rest = body.removeprefix(f"{side}/")
        if rest == body:
            continue
        gripper = f"{gripper_name(side)}/"
        if body.startswith(gripper):
            part = body.removeprefix(gripper)
            is_finger = robot.gripper.finger_of(part) is not None
            words = (
                f"a finger of the {side} gripper"
                if is_finger
                else f"the {side} gripper"
            )
            return _BodyPart(
                words=words,
                side=side,
                link=7,
                is_finger=is_finger,
            )
        return _BodyPart(
            words=f"the {side} arm's {rest}", side=side, link=int(rest[-1])
        )
    words = {"table": "the table", "floor": "the floor"}.get(name, "the mount")
    return _BodyPart(words=words, is_table=name == "table")


def _margin(one: _BodyPart, other: _BodyPart) -> float | None:
    """The distance that two parts keep, in metres; None where it does not matter."""
    if one.side is None or other.side is None:
        arm, still = (one, other) if other.side is None else (other, one)
        if arm.side is None or (arm.link < 2 and not still.is_table):  # noqa: PLR2004
            return (
                None  # the shoulder stands on the mount, and never comes near the table
            )
        if still.is_prop:
            return None if arm.is_finger else PROP_MARGIN
        return -TABLE_DEPTH if arm.is_finger and still.is_table else MARGIN
    if one.side is other.side:
        nearer, further = sorted((one.link, other.link))
        # Links that follow each other, and the parts of a hand, touch by design.
        return FINGER_MARGIN if nearer <= 4 and further == 7 else None  # noqa: PLR2004
    if one.link < 2 and other.link < 2:  # noqa: PLR2004
        return None  # the shoulders stand side by side
    return FINGER_MARGIN if one.is_finger or other.is_finger else MARGIN


# --- paths ---

LIFTED = np.array([0.0, -0.4, 0.0, -0.25, 0.0, 0.0, 0.0])
"""Changes in radians that lift and draw back a hand before it goes on."""


def path_candidates(start: Array, end: Array) -> Iterator[list[Array]]:
    """Paths between two configurations (2, 7) of both arms, from the simplest to longer ones.

    Yields:
        Joint positions (2, 7) to go through, `end` last: straight; one arm after the other; both
        lifted first; one lifted after the other, and then one after the other.
    """
    yield [end]
    for first in (0, 1):
        yield [_one(start, end, first), end]
    lifted = np.clip(start + LIFTED, LOWEST, HIGHEST)
    yield [lifted, end]
    for first in (0, 1):
        yield [lifted, _one(lifted, end, first), end]
    for first in (0, 1):
        begun = _one(start, lifted, first)
        yield [begun, lifted, _one(lifted, end, first), end]
        yield [begun, _one(begun, end, first), end]


def _one(
    start: Array,
    end: Array,
    side: int,
) -> Array:
    """One arm at the end, the other one still where it is."""
    middle = np.array(start)
    middle[side] = end[side]
    return middle
