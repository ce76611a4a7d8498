"""How smoothly an expert moves: its intended joint targets, before a variety's noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import duobench
from duobench.core.randomness import EVAL
from duobench.core.types import OPENING_SLOTS, SIDES, DuoCommand
from duobench.policy import Policy
from duobench.world.kinematics.inverse import Kinematics
from duobench.world.robot.frames import ROBOT
from duobench.world.robot.joints import JOINT_RANGES
from duobench.world.robot.mounts import HOME_JOINTS

MAX_REVERSAL = 0.02
"""Largest reversal of an expert's joint target in radians: the smaller one of two successive
changes of opposite signs [task definitions]."""
MAX_JUMP = 0.05
"""Largest second difference of an expert's joint targets in rad a step² [task definitions]."""
LEAST_MARGIN = 0.05
"""Least distance of an expert's joint targets from the joints' limits in radians [task
definitions]."""

LAG_STEPS = 5
"""Control steps for which a replay holds the last poses: the commands end at the step of success,
and other elbows may lag by a step."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Smoothness:
    """The worst of one episode, or of many."""

    reversal: float = 0.0
    """Largest reversal in radians."""
    jump: float = 0.0
    """Largest second difference in rad a step²."""
    margin: float = np.inf
    """Least distance from a joint's limit in radians."""

    @staticmethod
    def of(targets: NDArray[np.floating]) -> Smoothness:
        """That of flat commands (n, 16), which begin at home."""
        joints = np.delete(np.asarray(targets, dtype=np.float64), OPENING_SLOTS, axis=1)
        joints = np.vstack([HOME_JOINTS.ravel(), joints])
        low, high = np.tile(JOINT_RANGES, (len(SIDES), 1)).T
        changes = np.diff(joints, axis=0)
        if len(changes) < 2:  # noqa: PLR2004 - nothing to compare
            return Smoothness(
                margin=float(np.minimum(joints - low, high - joints).min())
            )
        before, after = changes[:-1], changes[1:]
        turned = np.where(
            before * after < 0.0, np.minimum(np.abs(before), np.abs(after)), 0.0
        )
        return Smoothness(
            reversal=float(turned.max()),
            jump=float(np.abs(after - before).max()),
            margin=float(np.minimum(joints - low, high - joints).min()),
        )

    def __str__(self) -> str:
        """The three numbers."""
        return f"{self.reversal:.3f} {self.jump:.3f} {self.margin:.3f}"

    def worst(self, other: Smoothness) -> Smoothness:
        """The worse one of each number."""
        return Smoothness(
            reversal=max(self.reversal, other.reversal),
            jump=max(self.jump, other.jump),
            margin=min(self.margin, other.margin),
        )

    @property
    def within(self) -> bool:
        """Whether it keeps to all bounds."""
        return (
            self.reversal <= MAX_REVERSAL
            and self.jump <= MAX_JUMP
            and self.margin >= LEAST_MARGIN - 1e-6  # targets are told in float32
        )


class Intended:
    """A policy, and the commands that it intended in this episode."""

    def __init__(self, policy: Policy) -> None:
        """Watch a policy."""
        self._policy = policy
        self.metadata = policy.metadata
        self.commands: list[NDArray[np.floating]] = []
        """Flat commands (16,)."""

    @property
    def intended_action(self) -> NDArray[np.floating] | None:
        """The last one, for recorders."""
        return getattr(self._policy, "intended_action", None)

    def reset(self, instruction: str, seed: int) -> None:
        """Begin an episode."""
        self.commands.clear()
        self._policy.reset(instruction, seed)

    def act(self, observation: Mapping[str, Any]) -> NDArray[np.floating]:
        """What the policy does."""
        chunk = np.asarray(self._policy.act(observation))
        wanted = self.intended_action
        self.commands.extend(chunk if wanted is None else [wanted])
        return chunk


def replay_as_poses(
    task: str, seed: int, commands: list[NDArray[np.floating]], *, split: str = EVAL
) -> bool:
    """Whether tool poses and openings alone, without the elbows, win the episode once more.

    Args:
        task: Id of the task.
        seed: Seed of the layout.
        commands: Flat commands (16,) of an expert that won; only their tool poses are sent.
        split: Split of the seed.
    """
    env: gym.Env = duobench.make(
        task, cameras=False, action_mode="cartesian", split=split
    )
    kinematics = Kinematics(ROBOT)
    _, info = env.reset(seed=seed)
    for flat in [*commands, *commands[-1:] * LAG_STEPS]:
        command = DuoCommand.from_flat(np.asarray(flat, dtype=np.float64))
        tools = kinematics.forward(command.joints)
        poses = [[*tools[side].tquat, command.openings[side.index]] for side in SIDES]
        *_, terminated, truncated, info = env.step(np.ravel(poses))
        if terminated or truncated:
            break
    env.close()
    return bool(info["success"])
