"""The steps of an episode, kept as they come."""

import gymnasium as gym

from duobench.evaluation.rollouts import Info, Observation, Step


class Steps(list[Step]):
    """A watcher of a rollout that keeps every step."""

    def on_episode_start(
        self,
        env: gym.Env,  # noqa: ARG002 - the protocol's signature
        observation: Observation,  # noqa: ARG002 - the protocol's signature
        info: Info,  # noqa: ARG002
    ) -> None:
        """Forget the steps of an earlier episode."""
        self.clear()

    def on_step(self, step: Step) -> None:
        """Keep it."""
        self.append(step)

    def on_episode_end(self, error: BaseException | None) -> None:
        """Nothing more to keep."""
