"""A watcher of an episode that makes two calls."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import gymnasium as gym

    from duobench.evaluation.rollout import Info, Observation, Step


class Watch:
    """Says that an episode has begun, and the number of each control step."""

    def __init__(self, on_start: Callable[[], None], on_step: Callable[[int], None]) -> None:
        """Remember whom to tell."""
        self._on_start, self._on_step = on_start, on_step

    def on_episode_start(self, env: gym.Env, observation: Observation, info: Info) -> None:  # noqa: ARG002 - the protocol's signature
        """The arms are at home, and the policy begins."""
        self._on_start()

    def on_step(self, step: Step) -> None:
        """A control step was executed."""
        self._on_step(step.number)

    def on_episode_end(self, error: BaseException | None) -> None:
        """Whoever plays says so."""
