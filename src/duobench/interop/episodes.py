"""Episodes as a program of others plays them: chunks in and observations out, as a format says.

They are the episodes of the evaluation: the same seeds, horizons, stages and success.
"""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray

from duobench.envs.config import IMAGE_SIZE, EnvConfig
from duobench.envs.duo_env import ResetNeededError
from duobench.envs.execution import Step, execute, optional_method
from duobench.envs.registration import make
from duobench.policy.batch import Observation
from duobench.policy.policy import dimensions
from duobench.policy.serving.message_format import MessageFormat
from duobench.randomness import episode_seed
from duobench.tasks import catalog


class Episodes:
    """Plays episodes one after the other, in an environment that fits a format.

    Args:
        message_format: What is shown, and what actions mean.
        options: Of the environments, beside what follows from the format; see
            `duobench.envs.config.EnvConfig`.

    Raises:
        DuoBenchError: If there is no such environment.
    """

    def __init__(self, message_format: MessageFormat, **options: Any) -> None:
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
        self._last: Step | None = None

    def begin(self, task: str, index: int) -> Step:
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
        self._last = Step(
            number=0,
            action=np.empty(0),
            observation=observation,
            reward=0.0,
            terminated=False,
            truncated=False,
            info=info,
        )
        return self._last

    def execute(self, actions: ArrayLike) -> Step:
        """Execute a chunk, until its end or the episode's; the last control step.

        Its observation has no images if the episode ended before the chunk did.

        Args:
            actions: One action (n,) or a chunk (H, n), in the format's order.

        Raises:
            PolicyError: If they are no chunk of finite numbers; the next episode can be played.
            ResetNeededError: If no episode is running.
        """
        if self._env is None or self._last is None:
            raise ResetNeededError("No episode is running; begin one first.")
        chunk = self.message_format.chunk([actions] if dimensions(actions) == 1 else actions)
        before, render_last = self._last.number, bool(self.message_format.images)
        try:
            *_, self._last = execute(self._env, chunk, before=before, render_last=render_last)
        except BaseException:
            self.close()  # it may be in any state now
            raise
        return self._last

    def request(self, observation: Observation) -> dict[str, Any]:
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
