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

STILL = 1e-4
"""Motion in a step below which an object is at rest, in metres."""
STILL_TOOL = 5e-4
"""The same of a measured tool, whose joints are noisy."""
STILL_ANGLE = 3e-4
"""The same in radians."""
STILL_ROTATION = STILL_ANGLE / 2
"""The same of the numbers of a quaternion."""
STILL_OPENING = 5e-3
"""The same of a measured opening."""
STILL_TARGET = 1e-4
"""The same of a commanded target, in radians or as an opening."""
DRIFT = 10.0
"""Multiple of the motions above that adjacent rows left out may add up to: 1 mm, 3 mrad."""
_QPOS = 1
"""Place of the first coordinate in a state of the simulation, behind the time."""


def idle_rows(
    recording: Recording,
    task: str,
    span: Span,
) -> NDArray[np.bool_]:
    """Tell which rows of a span are idle, (rows,).

    A row is idle if nobody leads, no judgement changes, and joints, tools, objects and targets are
    still where the last used row left them, but for a small drift. No step from a used row to the
    next one is longer than the longest step of the episode, so that a slow motion keeps some rows.
    """
    first, end = span
    poses, units = _poses(recording, task)
    seen = poses / units
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
    largest = np.empty(len(units))
    for unit in np.unique(units):  # each kind has its own
        kind = units == unit
        largest[kind] = max(motions[:, kind].max(), 1.0)
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


def _poses(recording: Recording, task: str) -> tuple[Array, Array]:
    """Poses (T + 1, n), and what counts as rest for each of their numbers (n,).

    They are those of the arms as measured, and of everything where states are known.
    """
    joints = np.full(FLAT_SIZE, STILL_ANGLE)
    joints[list(OPENING_SLOTS)] = STILL_OPENING
    tool = [STILL_TOOL] * 3 + [STILL_ROTATION] * 4
    poses: list[NDArray[Any]] = [recording.agent_pos, recording.tcp_pose]
    units = [joints, np.array(tool * len(SIDES))]
    if not recording.info.is_real:
        units.append(_units(task))
        poses.append(recording.state[:, _QPOS : _QPOS + len(units[-1])])
    return np.hstack(poses, dtype=np.float64), np.hstack(units)


@lru_cache(maxsize=1)
def _units(task: str) -> Array:
    """What counts as rest for each coordinate (nq,) of a task's simulation."""
    # Recordings of real arms do without the engine.
    import mujoco

    from duobench.world.sim.simulation import Simulation

    model = Simulation(catalog.get(task).props).model
    units = np.full(model.nq, STILL_ANGLE)
    for kind, place in zip(model.jnt_type, model.jnt_qposadr, strict=True):
        if kind == mujoco.mjtJoint.mjJNT_FREE:
            units[place : place + 3] = STILL
            units[place + 3 : place + 7] = STILL_ROTATION
        elif kind == mujoco.mjtJoint.mjJNT_BALL:
            units[place : place + 4] = STILL_ROTATION
        elif kind == mujoco.mjtJoint.mjJNT_SLIDE:
            units[place] = STILL
    return units
