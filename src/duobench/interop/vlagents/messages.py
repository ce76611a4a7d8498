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
from duobench.types import ARM_JOINTS, SIDES, Array, real_array

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


def as_action(act: Mapping[str, SingleAct], size: int | None = None) -> NDArray[np.float32]:
    """One of their actions as ours (size,).

    Args:
        act: The action of each arm.
        size: How many numbers there must be; None takes any.

    Raises:
        PolicyError: If an arm or a gripper is missing, or it has another size.
    """
    parts = [_arm(act, str(side)) for side in SIDES]
    left, right = map(len, parts)
    if left != right:
        raise PolicyError(
            f"The agent gives the left arm {left} numbers and the right one {right}, the opening "
            "included."
        )
    return as_chunk(np.concatenate(parts)[None], size)[0]


def _arm(act: Mapping[str, SingleAct], side: str) -> Array:
    """The numbers of an arm and the opening of its gripper."""
    arm = act.get(side)
    if arm is None or arm.action is None or arm.gripper is None:
        raise PolicyError(
            "An act has the arms `left` and `right`, each with an `action` and the opening of its "
            f"`gripper`; {side} has not. There is: {', '.join(act)[:200] or 'nothing'}."
        )
    try:
        action, gripper = (real_array(part, np.float64) for part in (arm.action, arm.gripper))
    except (TypeError, ValueError, OverflowError) as error:
        raise PolicyError(f"The agent gives no numbers: {arm!r:.80}.") from error
    if action.ndim != 1 or gripper.size != 1:
        raise PolicyError(
            "An `action` is a list of numbers and a `gripper` is one number, got arrays of shape "
            f"{action.shape} and {gripper.shape}."
        )
    return np.append(action, gripper)
