"""The watcher that makes the record of an episode."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import gymnasium as gym

from duobench.core.errors import escaped
from duobench.core.randomness import SUITE_VERSION
from duobench.core.types import Array
from duobench.envs.duo_env import base_of
from duobench.envs.episode_state import EpisodeState
from duobench.envs.execution import Step
from duobench.evaluation.rollouts import Info, Observation
from duobench.results.excess import Excess
from duobench.results.records import Record, StateHashes, pack_targets
from duobench.results.run import Run
from duobench.results.suite import Episode
from duobench.tasks.stages.logic import Words
from duobench.world.robot.joints import joint_speed


class EpisodeRecorder:
    """Watches an episode, and keeps what its record needs, whether or not it ends well.

    Args:
        episode: The episode, of which nothing is known but its place in the suite.
        on_stage: Called when it has begun, and whenever it has reached a new stage.
    """

    def __init__(
        self, episode: Episode, on_stage: Callable[[], None] = lambda: None
    ) -> None:
        self._episode = episode
        self._on_stage = on_stage
        self._env: gym.Env | None = None
        self._info: Info = {}
        self._stage_changes: list[tuple[int, int]] = []
        self._last: Step | None = None
        self._requested: list[Array] = []  # at the start, then step by step
        self._sent: list[Array] = []
        self._clipped, self._speed = 0, 0.0
        self._unmet: Words | None = None
        self._start: EpisodeState | None = None
        self._end: EpisodeState | None = None

    def on_episode_start(
        self,
        env: gym.Env,
        observation: Observation,  # noqa: ARG002 - the protocol's signature
        info: Info,
    ) -> None:
        """Note what the reset sampled, and the state that it led to."""
        self._env = env
        self._info = info
        self._requested = [base_of(env).requested]
        self._start = _state(env)
        stage = info["stage"]
        if stage:
            self._stage_changes.append((0, stage))
        env.get_wrapper_attr("explain_stages")()
        self._on_stage()

    def on_step(self, step: Step) -> None:
        """Note what was sent, and a stage that was newly reached.

        Steps after success are no part of the episode: only a recording has them.
        """
        if self._last is not None and self._last.info["success"]:
            return
        self._last = step
        self._sent.append(step.info["sent"])
        if self._env is not None:
            base = base_of(self._env)
            self._requested.append(base.requested)
            self._speed = max(self._speed, joint_speed(base.backend.joint_velocities()))
        self._clipped += bool(step.info["clipped"].any())
        stage = step.info["stage"]
        if stage > self.stage:
            self._stage_changes.append((step.number, stage))
            self._look()
            self._on_stage()

    def on_episode_end(self, error: BaseException | None) -> None:
        """Note the final state, and what the next stage lacks."""
        self._look()
        if self._env is not None and error is None:
            self._end = _state(self._env)

    def _look(self) -> None:
        if self._env is not None:
            self._unmet = self._env.get_wrapper_attr("unmet")

    def _excess(self) -> Excess | None:
        if self._env is None or not self._clipped:
            return None
        limits = base_of(self._env).backend.limits
        return Excess.of(self._requested, self._sent, self._speed, limits)

    @property
    def steps(self) -> int:
        """Control steps so far."""
        return self._last.number if self._last else 0

    @property
    def stage(self) -> int:
        """Highest stage so far."""
        return self._stage_changes[-1][1] if self._stage_changes else 0

    def record(
        self, run: Run, versions: Mapping[str, str | None], policy: str = ""
    ) -> Record:
        """The record so far, in a run, with versions of all that the result may depend on.

        Of several policies of the run, the one that plays is named.
        """
        task, last = self._episode.task, self._last
        candidate = run.of(policy) if policy else run.candidate
        return Record(
            run=run.hash,
            suite_version=SUITE_VERSION,
            suite=run.suite.label,
            execution=run.suite.execution_of(task.id, self._episode.shift),
            task=task.id,
            episode=self._episode.index,
            seed=self._episode.seed,
            policy_seed=self._episode.policy_seed,
            policy=candidate.policy,
            policy_version=candidate.metadata.version,
            config=replace(candidate.config, shift=self._episode.shift),
            instruction=escaped(self._info.get("instruction", "")),
            success=self.stage == task.max_stage,
            success_at_end=bool(last and last.info["success_at_end"]),
            final_stage=self.stage,
            max_stage=task.max_stage,
            unmet=self._unmet,
            stage_changes=tuple(self._stage_changes),
            steps=self.steps,
            horizon=task.horizon,
            terminated=bool(last and last.terminated),
            truncated=bool(last and last.truncated),
            error=None,
            layout=self._info.get("layout", {}),
            state_hash=self._end and self._end.hash,
            start=_hashes(self._start),
            end=_hashes(self._end),
            sent=pack_targets(self._sent),
            clipped=self._clipped,
            excess=self._excess(),
            versions=dict(versions),
            software=run.software,
        )


def _state(env: gym.Env) -> EpisodeState | None:
    """The whole state of the running episode, where there is a simulation that can tell it."""
    is_simulated = hasattr(env.unwrapped, "save_state")
    return env.get_wrapper_attr("save_state")() if is_simulated else None


def _hashes(state: EpisodeState | None) -> StateHashes | None:
    return state and StateHashes(physics=state.physics_hash, stages=state.progress_hash)
