"""Observations and actions of both arms, from our arrays to the classes of VLAgents and back."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from vlagents.policies.interface import (  # pyright: ignore[reportMissingImports]
    Act,
    Obs,
    SingleAct,
    SingleObs,
)

from duobench.errors import PolicyError
from duobench.policy import as_chunk
from duobench.types import ARM_JOINTS, SIDES, Side

LEFT, RIGHT = map(str, SIDES)


def as_obs(observation: Mapping[str, Any], instruction: str, info: Mapping[str, Any]) -> Obs:
    """One of our observations as theirs.

    Args:
        observation: `agent_pos` (16,), `tcp_pose` (14,), and perhaps `pixels`.
        instruction: What to do, in words.
        info: What else the agent is told, in the info of the left arm.

    Returns:
        Joints in radians, the gripper's opening 0 closed to 1 open, and the tool pose x y z qx qy
        qz qw of each arm; all images belong to the left arm, so that each is sent once.
    """
    arms = np.split(np.asarray(observation["agent_pos"], dtype=np.float32), 2)
    poses = np.split(np.asarray(observation["tcp_pose"], dtype=np.float32), 2)
    both = {
        str(side): SingleObs(joints=arm[:ARM_JOINTS], gripper=float(arm[ARM_JOINTS]), tquat=pose)
        for side, arm, pose in zip(SIDES, arms, poses, strict=True)
    }
    both[LEFT].cameras = dict(observation.get("pixels", {}))
    both[LEFT].info = dict(info)
    return Obs(obs=both, language_instruction=instruction)


def as_observation(obs: Obs) -> dict[str, Any]:
    """One of their observations as ours, with the images of both arms.

    Raises:
        PolicyError: If an arm, its joints or its gripper is missing.
    """
    arms, poses = [], []
    for side in SIDES:
        arm = obs.obs.get(str(side))
        if arm is None or arm.joints is None or arm.gripper is None:
            raise PolicyError(
                "A policy sees the arms 'left' and 'right', each with joints and gripper; the "
                f"observation has {', '.join(map(repr, obs.obs)) or 'no arm'}."
            )
        arms += [
            np.asarray(arm.joints, dtype=np.float32),
            np.array([arm.gripper], dtype=np.float32),
        ]
        poses.append(arm.tquat)
    observation: dict[str, Any] = {"agent_pos": np.concatenate(arms)}
    if all(pose is not None for pose in poses):
        observation["tcp_pose"] = np.concatenate(poses).astype(np.float32)
    images = {**obs.obs[RIGHT].cameras, **obs.obs[LEFT].cameras}
    if images:
        observation["pixels"] = {name: np.array(image) for name, image in images.items()}
    return observation


def as_act(chunk: NDArray[np.float32]) -> Act:
    """One of our chunks (H, n) as theirs."""
    return Act(
        acts=[
            {
                str(side): SingleAct(action=arm[:-1], gripper=float(arm[-1]))
                for side, arm in zip(SIDES, np.split(action, 2), strict=True)
            }
            for action in chunk
        ]
    )


def as_action(act: Mapping[str, SingleAct], size: int) -> NDArray[np.float32]:
    """One of their actions as ours (size,).

    Raises:
        PolicyError: If an arm or a gripper is missing, or it has another size.
    """
    parts = [_arm(act, side, size // 2) for side in SIDES]
    return as_chunk(np.concatenate(parts)[None], size)[0]


def _arm(act: Mapping[str, SingleAct], side: Side, size: int) -> NDArray[np.float64]:
    arm = act.get(str(side))
    if arm is None or arm.gripper is None or np.shape(arm.action) != (size - 1,):
        raise PolicyError(
            f"An action has {size - 1} numbers and a gripper for each of the arms 'left' and "
            f"'right'; {side} got {None if arm is None else np.shape(arm.action)} and the gripper "
            f"{None if arm is None else arm.gripper}."
        )
    return np.append(np.asarray(arm.action, dtype=np.float64), arm.gripper)
