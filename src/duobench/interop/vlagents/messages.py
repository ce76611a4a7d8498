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
from duobench.policy.serving.vlagents_messages import action_from
from duobench.types import ARM_JOINTS, SIDES

LEFT, RIGHT = map(str, SIDES)


def as_obs(observation: Mapping[str, Any], instruction: str, info: Mapping[str, Any]) -> Obs:
    """One of our observations as theirs.

    Args:
        observation: `agent_pos` (16,), `tcp_pose` (14,), and perhaps `pixels`.
        instruction: What to do, in words.
        info: What else the agent gets, in the info of the left arm.

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
    arms = {side: vars(arm) for side, arm in act.items()}
    return as_chunk(action_from(arms)[None], size)[0]
