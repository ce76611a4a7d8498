"""A recorded episode as a policy: what was sent to the arms then is sent again, more slowly."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from duobench.data import Recording
from duobench.envs.action_modes import JOINT
from duobench.errors import OptionError, PolicyError
from duobench.policy import PolicyMetadata
from duobench.types import Array

TEMPO = 0.5
"""Part of the recorded speed with which it is played."""
CHUNK = 30
"""Actions of a chunk."""


class Playback:
    """Sends the commands of a recorded episode, joint targets and openings, in a slower tempo."""

    def __init__(self, recording: Recording, name: str = "playback", tempo: float = TEMPO) -> None:
        """Take an episode.

        Args:
            recording: The episode, simulated or real.
            name: What to call it.
            tempo: Part of its speed, at most 1; commands in between are interpolated.

        Raises:
            PolicyError: It has no commands.
            OptionError: The tempo is out of range.
        """
        if not len(recording):
            raise PolicyError("The episode has no commands that could be played.")
        if not 0.0 < tempo <= 1.0:
            raise OptionError(f"The tempo is over 0 and at most 1, got {tempo}.")
        self.commands = slowed(recording.sent, tempo)
        """The commands (n, 16) that are played."""
        self.metadata = PolicyMetadata(
            name=f"{name} at {tempo:g} of its speed", cameras=(), action_mode=JOINT.name
        )
        self._next = 0

    @staticmethod
    def read(path: Path, tempo: float = TEMPO) -> Playback:
        """Take an episode from its file.

        Raises:
            DataError: It cannot be read.
            PolicyError: It has no commands.
        """
        recording = Recording.read(path)
        return Playback(recording, f"playback of {recording.info.task}/{path.stem}", tempo)

    def reset(self, instruction: str, seed: int) -> None:  # noqa: ARG002 - as policies have it
        """Begin at the first command."""
        self._next = 0

    def act(self, observation: Mapping[str, Any]) -> Array:  # noqa: ARG002 - it looks at nothing
        """The next commands (30, 16); after the last one, that one."""
        places = np.minimum(self._next + np.arange(CHUNK), len(self.commands) - 1)
        self._next += CHUNK
        return self.commands[places]


def slowed(commands: Array, tempo: float) -> Array:
    """Commands in a slower tempo, interpolated.

    Args:
        commands: Commands (n, 16), one a control step.
        tempo: Part of their speed.

    Returns:
        Commands (m, 16) that begin and end with the same ones, one a control step.
    """
    last = len(commands) - 1
    times = np.minimum(np.arange(int(np.ceil(last / tempo)) + 1) * tempo, last)
    steps = np.arange(len(commands))
    return np.stack([np.interp(times, steps, column) for column in commands.T], axis=1)
