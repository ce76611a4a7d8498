"""A task as an environment of VLAgents' evaluation, whose seeds are our episodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from vlagents.envs.interface import EvalEnv  # pyright: ignore[reportMissingImports]
from vlagents.policies.interface import (  # pyright: ignore[reportMissingImports]
    Act,
    Obs,
    SingleAct,
)

from duobench.envs import base_of
from duobench.envs.execution import execute
from duobench.envs.observation_wrappers import PIXELS
from duobench.envs.registration import make
from duobench.errors import OptionError, PolicyError
from duobench.interop.vlagents.messages import as_action, as_obs
from duobench.randomness import EVAL, episode_seed, policy_seed
from duobench.tasks import catalog

SEED, STEP, MODE = "policy_seed", "episode_step", "action_mode"
"""Keys in the info of the left arm: the policy's seed, how many control steps the episode had, and
the environment's action mode. With them a policy of ours is seeded, knows where an episode begins,
and refuses an environment that would take its actions for something else. No agent is told the seed
of the layout."""
_PREFIX = "duobench/"


class TaskEnv(EvalEnv):
    """A task whose episode n is the n-th of our evaluation; success is its termination."""

    language_instruction = ""
    """The instruction of the running episode."""

    def __init__(
        self, env_id: str, execution_horizon: int | None = None, **env_kwargs: Any
    ) -> None:
        """Make the environment.

        Args:
            env_id: `duobench/<task>`; a task of one's own, after `register_env`, is
                `duobench/module:ATTRIBUTE`.
            execution_horizon: Actions of a chunk that are executed; None takes all.
            env_kwargs: As `duobench.make` takes them: cameras, image_size, horizon, look, ...
        """
        if env_kwargs.get("chunk") is not None:
            raise OptionError("VLAgents executes the actions of a chunk one by one: no `chunk`.")
        if env_kwargs.get("object_state"):
            raise OptionError("Observations of VLAgents have no place for an `object_state`.")
        self._import_path = env_id.removeprefix(_PREFIX)
        self._task = catalog.get(self._import_path)
        self._policy_seed: int | None = None
        self._steps = 0
        super().__init__(env_id, execution_horizon=execution_horizon, **env_kwargs)

    def do_import(self) -> None:
        """Nothing has to be imported first."""

    def make_gym(self) -> gym.Env:
        """The environment itself.

        Raises:
            DuoBenchError: If there is no such task, option or value.
        """
        env = make(self._import_path, **self.env_kwargs)
        self._config = env.get_wrapper_attr("config")
        if self._config.cameras:
            env.get_wrapper_attr("set_rendering")(False)  # `_obs` renders what an agent sees
        return env

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Obs, dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: Index of the episode in the evaluation; None samples any layout.
            options: As the environment takes them.

        Raises:
            OptionError: If the index is negative.
        """
        if seed is not None and seed < 0:
            raise OptionError(f"Episodes are counted from 0, got {seed}.")
        task, split = self._task.id, self.env_kwargs.get("split", EVAL)
        used = None if seed is None else episode_seed(task, seed, split)
        self._policy_seed = None if used is None else policy_seed(task, used, split)
        self._steps = 0
        observation, info = self.env.reset(seed=used, options=options)
        self.language_instruction = info["instruction"]
        return self._obs(observation), info

    def chunk_step(
        self, actions: Act, max_steps: int | None = None
    ) -> tuple[Obs, float, bool, bool, dict[str, Any]]:
        """Execute a chunk; images are rendered after its last action, and at the end.

        Raises:
            OptionError: If the evaluation would cut the episode before its horizon.
            PolicyError: If an action is none of both arms, or there is none.
        """
        horizon = self.env.get_wrapper_attr("_max_episode_steps")
        if max_steps is not None and self._steps + max_steps < horizon:
            raise OptionError(
                f"An episode of {self._task.id} has up to {horizon} control steps, but "
                f"max_steps_per_episode is {self._steps + max_steps}. Set it to {horizon}; for "
                "shorter episodes, whose scores are no others', also set horizon in env_kwargs."
            )
        counts = (len(actions.acts), max_steps, self.execution_horizon)
        return self._execute(actions.acts[: min(count for count in counts if count is not None)])

    def step(
        self, action: Mapping[str, SingleAct]
    ) -> tuple[Obs, float, bool, bool, dict[str, Any]]:
        """Execute one action.

        Raises:
            PolicyError: If it is no action of both arms.
        """
        return self._execute([action])

    def _execute(
        self, acts: Sequence[Mapping[str, SingleAct]]
    ) -> tuple[Obs, float, bool, bool, dict[str, Any]]:
        if not acts:
            raise PolicyError("At least one action is executed at a time, got none.")
        (size,) = self.env.action_space.shape or (0,)
        chunk = np.array([as_action(act, size) for act in acts])
        done = list(execute(self.env, chunk, before=self._steps))
        last = done[-1]
        self._steps, self.last_chunk_steps = last.number, len(done)
        reward = sum(step.reward for step in done)
        observation = self._obs(last.observation)
        return observation, reward, last.terminated, last.truncated, last.info

    def _obs(self, observation: Mapping[str, Any]) -> Obs:
        """An observation as theirs, with images, if only for a video."""
        cameras = self._config.cameras
        if cameras:
            images = base_of(self.env).backend.images(cameras, self._config.image_size)
            observation = {**observation, PIXELS: images}
        info: dict[str, Any] = {STEP: self._steps, MODE: self._config.action_mode}
        if self._policy_seed is not None:
            info[SEED] = self._policy_seed
        return as_obs(observation, self.language_instruction, info)
