"""Actions of a recording, in the mode that they are exported for."""

from functools import cache

import numpy as np

from duobench.core.spatial import SE3, product, rotation_by
from duobench.core.types import (
    ARM_JOINTS,
    FLAT_SIZE,
    OPENING_SLOTS,
    SIDE_SIZE,
    SIDES,
    Array,
    DuoCommand,
)
from duobench.data.lerobot.folder import Residual
from duobench.data.lerobot.options import ActionSource
from duobench.data.recording import Recording
from duobench.data.used_rows import Steps, UsedRows
from duobench.envs.action_labels import tool_labels
from duobench.envs.action_modes import CARTESIAN, CARTESIAN_RELATIVE, JOINT
from duobench.world.kinematics.inverse import Kinematics
from duobench.world.robot.frames import Robot

_kinematics = cache(Kinematics)


def labels_of(
    recording: Recording, mode: str, source: ActionSource, steps: Steps | None = None
) -> tuple[Array, Residual | None]:
    """Actions of some steps, or all, as labels (n, m) of a mode.

    Where inverse kinematics solved them, its residual comes with them.

    Actions that were not given in the wanted mode are joint targets, whose tool poses follow by
    forward kinematics. A relative one leads from the pose that the step before sent (where the arms
    were in that row, with anything that an actor added to its own actions) to the label's pose.
    """
    steps = steps or UsedRows.every(len(recording)).steps()
    is_own = mode == recording.info.mode.name and source is not ActionSource.SENT
    if is_own and mode != JOINT.name:
        return _as_given(recording.action[steps.rows], mode), None
    targets, residual = _joint_targets(recording, steps, source)
    if mode == JOINT.name:
        return targets, residual
    robot = recording.info.robot
    positions, rotations = _tools(targets, robot)
    if mode == CARTESIAN_RELATIVE.name:
        home = DuoCommand(joints=robot.home, openings=np.ones(len(SIDES))).flat
        before, turned = _tools(
            np.vstack([home, recording.sent])[steps.before + 1], robot
        )
        positions = positions - before
        rotations = _turns_between(turned, rotations)
    return tool_labels(positions, rotations, targets[:, OPENING_SLOTS]), residual


def _as_given(actions: Array, mode: str) -> Array:
    """Labels of actions that were given in their mode, in other numbers of the rotation alone."""
    sides = actions.reshape(len(actions), len(SIDES), -1)
    numbers = sides[..., 3:-1].reshape(2 * len(actions), -1)
    if mode == CARTESIAN.name:
        rotations = [SE3.from_wxyz(xyzw[[3, 0, 1, 2]]).rotation for xyzw in numbers]
    else:
        rotations = [rotation_by(vector) for vector in numbers]
    shape = (len(actions), len(SIDES), 3, 3)
    return tool_labels(sides[..., :3], np.reshape(rotations, shape), sides[..., -1])


def _tools(commands: Array, robot: Robot) -> tuple[Array, Array]:
    """Positions (T, 2, 3) and rotations (T, 2, 3, 3) of the tools at flat commands (T, 16)."""
    sides = commands.reshape(len(commands), len(SIDES), -1)
    frames = [
        robot.tool_frames(side, sides[:, side.index, :ARM_JOINTS]) for side in SIDES
    ]
    positions, rotations = zip(*frames, strict=True)
    return np.stack(positions, axis=1), np.stack(rotations, axis=1)


def _turns_between(before: Array, after: Array) -> Array:
    """Rotations (T, 2, 3, 3) about the table's axes that lead from one to the other."""
    pairs = zip(before.reshape(-1, 3, 3), after.reshape(-1, 3, 3), strict=True)
    return np.reshape([product(two, one.T) for one, two in pairs], after.shape)


def _joint_targets(
    recording: Recording, steps: Steps, source: ActionSource
) -> tuple[Array, Residual | None]:
    """The actions as joint targets and openings (n, 16)."""
    if recording.info.mode == JOINT and source is not ActionSource.SENT:
        return recording.action[steps.rows], None
    if source is ActionSource.GIVEN:
        return _solved(recording, steps)
    return recording.sent[steps.rows], None


def _solved(recording: Recording, steps: Steps) -> tuple[Array, Residual]:
    """Joint targets of tool poses, solved for from the observed joints of each row."""
    kinematics = _kinematics(recording.info.robot)
    solved, errors = np.empty((len(steps), FLAT_SIZE)), []
    for number, row in enumerate(steps.rows):
        action = recording.action[row].reshape(len(SIDES), SIDE_SIZE)
        targets = {
            side: SE3.from_tquat(action[side.index, :ARM_JOINTS]) for side in SIDES
        }
        observed = DuoCommand.from_flat(recording.agent_pos[row]).joints
        joints, _ = kinematics.solve(observed, targets)
        solved[number] = DuoCommand(
            joints=joints,
            openings=action[:, ARM_JOINTS],
        ).flat
        reached = kinematics.forward(joints)
        errors += [reached[side].distance(targets[side]) for side in SIDES]
    positions, rotations = zip(*errors, strict=True)
    return solved, Residual(
        targets=len(errors),
        sum_position=sum(positions),
        sum_rotation=sum(rotations),
        max_position=max(positions),
        max_rotation=max(rotations),
    )
