"""Rows in which an operator led nothing, and nothing moved."""

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from duobench.core.types import (
    FLAT_SIZE,
    OPENING_SLOTS,
    SIDES,
    Array,
)
from duobench.data.recording import Recording
from duobench.data.used_rows import Span
from duobench.envs.action_modes import CARTESIAN_RELATIVE, JOINT_RELATIVE
from duobench.tasks import catalog
from duobench.world.robot.frames import Robot

STILL = 1e-4
"""Motion in a step below which an object is at rest, in metres."""
STILL_TOOL = 5e-4
"""The same of a tool as measured: joints are noisy, and settle long after all else."""
STILL_ANGLE = 1e-3
"""The same of joints of arms, and of rotations of tools and objects, in radians."""
STILL_HINGE = 3e-4
"""The same of lids and doors, which are long."""
STILL_OPENING = 5e-3
"""The same of a measured opening."""
STILL_TARGET = 1e-4
"""The same of a commanded target, in radians or as an opening."""
DRIFT = 10.0
"""Multiple of the motions above that adjacent rows left out may add up to: 1 mm, 10 mrad."""
SEAM = 1e-4
"""Excess over the longest step of the episode that a step across rows left out may have, in its
units."""
_PLACE = (STILL, 3)
"""Rest of an object's place, and how many numbers it has."""
_ROTATION = (STILL_ANGLE / 2, 4)
"""The same of a quaternion, whose numbers are those of half the angle."""
_QPOS = 1
"""Place of the first coordinate in a state of the simulation, behind the time."""


def idle_rows(
    recording: Recording,
    task: str,
    span: Span,
) -> NDArray[np.bool_]:
    """Tell which rows of a span are idle, (rows,).

    A row is idle if nobody leads, no judgement changes, and joints, tools, objects and targets are
    still where the last used row left them, but for a small drift. A step from a used row to the
    next one exceeds the longest of the episode by `SEAM` at most: a slow motion keeps some rows.
    """
    first, end = span
    poses, rests, counts = _poses(recording, task)
    seen = poses / np.repeat(rests, counts)
    judged = np.column_stack(
        [recording.stage, recording.success, recording.success_at_end]
    )
    sent = recording.sent / STILL_TARGET
    is_active = recording.clutch.any(axis=1) | _asks(recording)
    is_active |= recording.is_led_by_policy
    is_active |= (judged[1:] != judged[:-1]).any(axis=1)
    idle = np.zeros(end - first, np.bool_)
    motions = np.abs(np.diff(seen, axis=0))
    is_active |= motions.max(axis=1) > 1.0
    parts = np.maximum.reduceat(motions.max(axis=0), np.cumsum(counts) - counts)
    largest = np.repeat(parts + SEAM / rests, counts)
    was, rest, told = seen[first], seen[first], sent[first]
    for row in range(first, end):
        drifts = (np.abs(seen[row + 1] - was) > largest).any()
        drifts |= np.abs(seen[row + 1] - rest).max() > DRIFT
        if is_active[row] or drifts or np.abs(sent[row] - told).max() > 1.0:
            was, rest, told = seen[row], seen[row + 1], sent[row]
        else:
            idle[row - first] = True
    return idle


def _asks(recording: Recording) -> NDArray[np.bool_]:
    """Whether actions (T,) ask for a motion by themselves, as relative ones do."""
    if recording.info.action_mode not in (JOINT_RELATIVE.name, CARTESIAN_RELATIVE.name):
        return np.zeros(len(recording), np.bool_)
    sides = recording.action.reshape(len(recording), len(SIDES), -1)
    return np.asarray(sides[..., :-1].any(axis=(1, 2)))


def _poses(
    recording: Recording,
    task: str,
) -> tuple[Array, Array, NDArray[np.int64]]:
    """Poses (T + 1, n); what counts as rest of each of their parts, and its count of numbers.

    They are those of the arms as measured, and of everything where states are known.
    """
    parts = [(STILL_ANGLE, 1)] * FLAT_SIZE
    for slot in OPENING_SLOTS:
        parts[slot] = (STILL_OPENING, 1)
    parts += [(STILL_TOOL, 3), _ROTATION] * len(SIDES)
    poses: list[NDArray[Any]] = [recording.agent_pos, recording.tcp_pose]
    if not recording.info.is_real:
        coordinates = _coordinates(task, recording.info.robot)
        parts += coordinates
        size = sum(count for _, count in coordinates)
        poses.append(recording.state[:, _QPOS : _QPOS + size])
    rests, counts = zip(*parts, strict=True)
    return np.hstack(poses, dtype=np.float64), np.array(rests), np.array(counts)


@lru_cache(maxsize=1)
def _coordinates(task: str, robot: Robot) -> list[tuple[float, int]]:
    """The same of the coordinates of a task's simulation."""
    # Recordings of real arms do without the engine.
    import mujoco

    from duobench.world.sim.simulation import Simulation

    model = Simulation(catalog.get(task).props, robot=robot).model
    parts_of = {
        mujoco.mjtJoint.mjJNT_FREE: [_PLACE, _ROTATION],
        mujoco.mjtJoint.mjJNT_BALL: [_ROTATION],
        mujoco.mjtJoint.mjJNT_SLIDE: [(STILL, 1)],
        mujoco.mjtJoint.mjJNT_HINGE: [(STILL_HINGE, 1)],
    }
    arms = tuple(f"{side}/" for side in SIDES)
    parts: list[tuple[float, int]] = []
    for joint, kind in enumerate(model.jnt_type):
        if model.joint(joint).name.startswith(arms):
            parts.append((STILL_ANGLE, 1))
        else:
            parts += parts_of[mujoco.mjtJoint(kind)]
    return parts
