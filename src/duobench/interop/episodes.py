"""Episodes as a program of others plays them: chunks in and observations out, as a format says.

They are the episodes of the evaluation: the same seeds, horizons, stages and success.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray

from duobench.envs.config import IMAGE_SIZE, EnvConfig
from duobench.envs.duo_env import ResetNeededError
from duobench.envs.execution import execute, optional_method
from duobench.envs.registration import make
from duobench.policy.batch import Observation
from duobench.policy.policy import dimensions
from duobench.policy.serving.message_format import MessageFormat
from duobench.randomness import episode_seed
from duobench.tasks import catalog


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Turn:
    """What a chunk of actions has led to."""

    observation: Observation
    """The environment's, after the last action; without images if the episode ended before the
    chunk did."""
    reward: float
    """The reward of the last control step."""
    is_over: bool
    """Whether the episode is over."""
    info: Mapping[str, Any]
    """The environment's, with `success`, `stage` and `max_stage`."""
    steps: int
    """Control steps of the episode so far."""


class Episodes:
    """Plays episodes one after the other, in an environment that fits a format."""

    def __init__(self, message_format: MessageFormat, **options: Any) -> None:
        """Choose the environments; one is made when it is needed.

        Args:
            message_format: What is shown, and what actions mean.
            options: Of the environments, beside what follows from the format; see
                `duobench.envs.config.EnvConfig`.

        Raises:
            DuoBenchError: If there is no such environment.
        """
        metadata = message_format.metadata("", "", seeded=False)
        self._options = {
            "cameras": metadata.cameras,
            "image_size": metadata.image_size or IMAGE_SIZE,
            "action_mode": metadata.action_mode,
            **options,
        }
        EnvConfig.from_options(self._options)
        self.message_format = message_format
        """What is shown, and what actions mean."""
        self._import_path: str | None = None
        self._env: gym.Env | None = None
        self._instruction = ""
        self._last: Turn | None = None

    def begin(self, task: str, index: int) -> Turn:
        """Begin an episode of the evaluation.

        Args:
            task: Id of the task, or its import path "module:ATTRIBUTE".
            index: Index of the episode.

        Raises:
            UnknownNameError: If there is no such task.
        """
        if task != self._import_path:
            self.close()
        if self._env is None:
            self._env, self._import_path = make(task, **self._options), task
        optional_method(self._env, "set_rendering")(True)
        seed = episode_seed(catalog.get(task).id, index)
        observation, info = self._env.reset(seed=seed)
        self._instruction = info["instruction"]
        self._last = Turn(observation=observation, reward=0.0, is_over=False, info=info, steps=0)
        return self._last

    def execute(self, actions: ArrayLike) -> Turn:
        """Execute a chunk, until its end or the episode's.

        Args:
            actions: One action (n,) or a chunk (H, n), in the format's order.

        Raises:
            PolicyError: If they are no chunk of finite numbers; the next episode can be played.
            ResetNeededError: If no episode is running.
        """
        if self._env is None or self._last is None:
            raise ResetNeededError("No episode is running; begin one first.")
        chunk = self.message_format.chunk([actions] if dimensions(actions) == 1 else actions)
        turn, render_last = self._last, bool(self.message_format.images)
        try:
            for step in execute(self._env, chunk, before=turn.steps, render_last=render_last):
                turn = Turn(
                    observation=step.observation,
                    reward=step.reward,
                    is_over=step.is_last,
                    info=step.info,
                    steps=step.number,
                )
        except BaseException:
            self.close()  # whatever broke may have left it in any state
            raise
        self._last = turn
        return turn

    def shown(self, observation: Observation) -> dict[str, Any]:
        """An observation of the running episode as the format says."""
        return self.message_format.request(observation, self._instruction)

    def hold_action(self, last: ArrayLike | None) -> NDArray[np.float32]:
        """An action (n,) that keeps the arms where they were sent, in the format's order.

        Args:
            last: The last action or chunk that was executed; None if there was none, and then the
                arms stay where they are measured.
        """
        sizes = self.message_format.action_sizes
        if last is not None:
            action = np.atleast_2d(np.asarray(last, dtype=np.float32))[-1].copy()
        elif self._last is None:
            action = np.zeros(sum(sizes.values()), np.float32)
        else:
            action = self.message_format.measured_action(self._last.observation)
        if self.message_format.actions.mode.endswith("relative"):
            is_arm = np.repeat([not part.endswith("gripper") for part in sizes], [*sizes.values()])
            action[is_arm] = 0.0
        return action

    def close(self) -> None:
        """Free the environment."""
        if self._env is not None:
            self._env.close()
        self._env = self._import_path = self._last = None
