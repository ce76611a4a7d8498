"""How smooth the joint targets of episodes are, as labels that a policy is to learn."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from duobench.data.recording import Recording
from duobench.envs.action_modes import JOINT
from duobench.envs.spaces import JOINT_NAMES
from duobench.robot.joints import JOINT_RANGES
from duobench.types import FLAT_SIZE, OPENING_SLOTS, SIDES, Array

AT_LIMIT = 1e-3
"""A target this near to the end of its joint's range is at the limit, in radians."""
REVERSAL = 0.02
"""Two steps in opposite directions, each longer than this, are a reversal: 0.6 rad/s to and fro, in
radians. A policy that averages over them learns neither."""
JUMP = 0.05
"""A step longer or shorter than the one before by more than this is a jump, in radians: 45 rad/s²,
where an FR3 allows 10 rad/s²."""
JOINTS = [place for place in range(FLAT_SIZE) if place not in OPENING_SLOTS]
"""Places of the joints among the 16 numbers of a command."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Smoothness:
    """What episodes' joint targets do that is hard to learn, or to execute on real arms."""

    at_limit: float
    """Share of steps with a joint at an end of its range."""
    reversals: float
    """Reversals an episode, of all joints together, in the mean."""
    jumps: float
    """Share of steps with a jump of a joint."""


def measure(recordings: Iterable[Recording]) -> Smoothness:
    """How smooth some episodes are; as smooth as can be where there is no step."""
    targets = [_labels(each) for each in recordings]
    increments = [np.diff(each, axis=0) for each in targets]
    steps = sum(map(len, targets))
    return Smoothness(
        at_limit=sum(int(at_limit(each).any(axis=1).sum()) for each in targets) / max(steps, 1),
        reversals=sum(int(_reversals(each).sum()) for each in increments) / max(len(targets), 1),
        jumps=sum(int(_jumps(each).any(axis=1).sum()) for each in increments) / max(steps, 1),
    )


def at_limit(targets: Array) -> NDArray[np.bool_]:
    """Which joint targets (T, 14) are at an end of their joint's range (T, 14)."""
    low, high = np.tile(JOINT_RANGES, (len(SIDES), 1)).T
    return (targets < low + AT_LIMIT) | (targets > high - AT_LIMIT)


def _labels(recording: Recording) -> Array:
    """Joint targets (T, 14) as the actor wanted them; as they were sent, if it wanted poses."""
    info = recording.info
    is_joint = info.action_mode == JOINT.name and info.action_names == JOINT_NAMES
    return (recording.action if is_joint else recording.sent)[:, JOINTS]


def _reversals(increments: Array) -> NDArray[np.bool_]:
    before, after = increments[:-1], increments[1:]
    long = np.minimum(np.abs(before), np.abs(after)) > REVERSAL
    return long & (before * after < 0)


def _jumps(increments: Array) -> NDArray[np.bool_]:
    return np.abs(np.diff(increments, axis=0)) > JUMP
