"""The smallest baseline: play the chunk that followed the most similar demonstrated state.

CHECKPOINT=exports/bin_sort duobench eval --policy nearest:Nearest --tasks bin_sort --out runs/nn
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from typing import Any

import numpy as np
from demonstrations import (
    Demonstrations,
    Grippers,
    Rows,
    action_mode,
    checkpoint,
    openings,
    to_actions,
)
from frames import features

from duobench.policy import PolicyMetadata
from duobench.world.robot.frames import other_robot, robot_with
from duobench.world.robot.mounts import DEFAULT_MOUNT

HORIZON = 30
"""Actions that are played of each demonstration."""


class Nearest:
    """Looks a state up in an export; it needs NumPy alone."""

    def __init__(self, data: Demonstrations | None = None) -> None:
        """Take demonstrations, or those of the export in the folder CHECKPOINT.

        The variables EPISODES and UNTIL limit it.
        """
        if data is None:
            episodes = int(os.environ["EPISODES"]) if "EPISODES" in os.environ else None
            data = Demonstrations.load(
                checkpoint(), episodes, os.environ.get("UNTIL", "end")
            )
        self._data = data
        robot = robot_with(self._data.gripper)
        seen = features(self._data.state, self._data.objects, self._data.names, robot)
        self._mean, self._scale = seen.mean(axis=0), seen.std(axis=0) + 1e-3
        self._seen = (seen - self._mean) / self._scale
        self._chunks = self._data.chunks(HORIZON)
        self._grippers = Grippers(openings(self._data.labels))
        self.metadata = PolicyMetadata(
            name="nearest state",
            cameras=(),
            object_state=True,
            action_mode=action_mode(self._data.labels),
            robot=other_robot(self._data.gripper, DEFAULT_MOUNT),
            horizon=HORIZON,
            version=hashlib.sha256(self._seen.tobytes()).hexdigest()[:16],
        )

    def reset(self, instruction: str, seed: int) -> None:  # noqa: ARG002
        """Begin an episode with open hands."""
        self._grippers = Grippers(openings(self._data.labels))

    def act(self, observation: Mapping[str, Any]) -> Rows:
        """The demonstrated chunk (30, 16) that began in the nearest state."""
        columns = list(self._data.columns)
        state = observation["agent_pos"][None]
        objects = observation["environment_state"][None, columns]
        robot = robot_with(self._data.gripper)
        now = features(state, objects, self._data.names, robot)[0]
        now = (now - self._mean) / self._scale
        row = int(np.argmin(((self._seen - now) ** 2).sum(axis=1)))
        chunk = self._data.labels[self._chunks[row]].copy()
        for label in chunk:
            self._grippers.switch(label)
        return to_actions(chunk)
