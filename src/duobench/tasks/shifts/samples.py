"""Sample of an episode along each axis: a function of task, split and seed of the layout alone.

The level scales what is sampled and is no part of what it is sampled from. So the levels of an axis
are the same episodes, shifted less or more in the same direction.
"""

from dataclasses import dataclass, replace

import numpy as np

from duobench.core.randomness import ANY_YAW, Uniform, shift_generator
from duobench.core.spatial import SE3
from duobench.tasks.shifts import levels
from duobench.tasks.shifts.levels import level_for
from duobench.tasks.shifts.shift import (
    CAMERA,
    INSTRUCTION,
    LAYOUT,
    LOOK,
    PHYSICS,
    RENDERER,
    SENSING,
    Shift,
)
from duobench.tasks.task import Placement, Task
from duobench.world.looks.catalog import look as named_look, random_look
from duobench.world.looks.look import (
    STUDIO,
    CameraOffset,
    Look,
    Material,
)
from duobench.world.robot.cameras import CAMERAS

_LIGHT, _COLOURS, _TEXTURES, _BACKGROUND, _OBJECTS = range(1, 6)
"""Levels from which a random look changes each of these."""


@dataclass(frozen=True, kw_only=True, slots=True)
class PhysicsScale:
    """Factors on the physics of an episode."""

    mass: float = 1.0
    """On masses and inertias of all objects, but for what a spring moves."""
    friction: float = 1.0
    """On the sliding friction of all surfaces."""
    spring: float = 1.0
    """On springs of the hinges of objects, and on mass and damping of what they move."""


UNSCALED = PhysicsScale()


@dataclass(frozen=True, kw_only=True, slots=True)
class EpisodeKey:
    """Key of an episode's samples."""

    task: str
    """Id of the task."""
    seed: int
    """Seed of the layout."""
    split: str
    """Split of its layouts."""

    def generator(self, axis: str) -> np.random.Generator:
        """Numbers for an axis, unrelated to those of others and to the layout's."""
        return shift_generator(self.task, self.seed, axis, self.split)


def shifted_look(
    shift: Shift,
    key: EpisodeKey,
    usual: Look,
) -> Look:
    """Look of an episode's images: light, colours, textures, background, cameras, noise."""
    look = usual
    level = level_for(shift, LOOK, key.task)
    if level:
        look = _other_look(level, key.generator(LOOK), look)
    level = level_for(shift, RENDERER, key.task)
    if level:
        look = replace(look, renderer=STUDIO, parts=named_look(STUDIO).parts)
    if level > 1:
        look = _other_look(level - 1, key.generator(LOOK), look)
    level = level_for(shift, CAMERA, key.task)
    if level:
        look = replace(
            look, cameras={**look.cameras, **_cameras(level, key.generator(CAMERA))}
        )
    level = level_for(shift, SENSING, key.task)
    if level:
        look = replace(
            look, noise=float(np.hypot(look.noise, levels.IMAGE_NOISE[level]))
        )
    return look


def _other_look(
    level: int,
    rng: np.random.Generator,
    usual: Look,
) -> Look:
    """A random look, of which each level has one thing more."""
    other = random_look(int(rng.integers(2**32)))
    parts = {
        name: material if level >= _TEXTURES else Material(colour=material.colour)
        for name, material in other.parts.items()
    }
    return replace(
        usual,
        seed=other.seed,
        lights=other.lights,
        ambient=other.ambient,
        exposure=other.exposure,
        parts=parts if level >= _COLOURS else usual.parts,
        clutter=8 + other.clutter if level >= _BACKGROUND else usual.clutter,
        colour_variation=1.0 if level >= _OBJECTS else usual.colour_variation,
        objects=other.objects if level >= _OBJECTS else usual.objects,
    )


def _cameras(level: int, rng: np.random.Generator) -> dict[str, CameraOffset]:
    offsets: dict[str, CameraOffset] = {}
    for name, camera in CAMERAS.items():
        share = 1.0 if camera.arm is None else levels.WRIST_SHARE
        directions = rng.uniform(-1.0, 1.0, 7)
        x, y, z = (directions[:3] * share * levels.CAMERA_METRES[level]).tolist()
        roll, pitch, yaw, zoom = (
            directions[3:] * levels.CAMERA_RADIANS[level]
        ).tolist()
        offsets[name] = CameraOffset(
            position=(x, y, z), rotation=(roll, pitch, yaw), field_of_view=zoom
        )
    return offsets


def physics_scale(shift: Shift, key: EpisodeKey) -> PhysicsScale:
    """Factors on the physics of an episode, as likely above 1 as below."""
    level = level_for(shift, PHYSICS, key.task)
    if not level:
        return UNSCALED
    mass, friction, spring = key.generator(PHYSICS).uniform(-1.0, 1.0, 3).tolist()
    return PhysicsScale(
        mass=levels.MASS_FACTORS[level] ** mass,
        friction=levels.FRICTION_FACTORS[level] ** friction,
        spring=levels.SPRING_FACTORS[level] ** spring,
    )


def kept_paraphrase(
    shift: Shift,
    key: EpisodeKey,
    count: int,
) -> int | None:
    """Number of an episode's paraphrase among the task's; None for the usual instruction."""
    level = level_for(shift, INSTRUCTION, key.task)
    rng = key.generator(INSTRUCTION)
    is_reworded = rng.uniform() < levels.REWORDED_SHARE[level]
    return int(rng.integers(count)) if count and is_reworded else None


@dataclass(frozen=True, kw_only=True, slots=True)
class OutsidePlacement(Placement):
    """A placement whose position lies beyond the ranges along at least one axis."""

    margin: float
    """Largest distance beyond the range of training, in metres."""
    turn: float
    """Largest turn beyond the range of training, in radians."""

    def sample(self, rng: np.random.Generator) -> SE3:
        """One pose in the table frame, upright."""
        x, y = self.x.low, self.y.low
        while self._is_inside(x, y):
            x = _wider(self.x, self.margin).sample(rng)
            y = _wider(self.y, self.margin).sample(rng)
        is_any = self.yaw.high - self.yaw.low >= ANY_YAW.high - ANY_YAW.low
        yaw = self.yaw if is_any else _wider(self.yaw, self.turn)
        return SE3.at(
            x,
            y,
            self.z,
            yaw=yaw.sample(rng),
        )

    def _is_inside(self, x: float, y: float) -> bool:
        return self.x.low <= x <= self.x.high and self.y.low <= y <= self.y.high


def shifted_task(task: Task, shift: Shift) -> Task:
    """A task whose layouts lie outside of the usual ones, if the shift says so.

    What never moves (a wall, painted squares) stays where it is.
    """
    level = level_for(shift, LAYOUT, task.id)
    if not level:
        return task
    return replace(
        task,
        placements={
            name: _outside(each, level) for name, each in task.placements.items()
        },
    )


def _outside(placement: Placement, level: int) -> Placement:
    if placement.x.low == placement.x.high and placement.y.low == placement.y.high:
        return placement
    return OutsidePlacement(
        x=placement.x,
        y=placement.y,
        z=placement.z,
        yaw=placement.yaw,
        margin=levels.MARGIN_METRES[level],
        turn=levels.MARGIN_RADIANS[level],
    )


def _wider(span: Uniform, margin: float) -> Uniform:
    return Uniform(span.low - margin, span.high + margin)
