"""The record of one finished episode: everything that a table or a report is computed from.

A record holds no clock time and no name of a machine's folder, so that the same episode gives the
same bytes however it was run: with another number of workers, in another order, after a restart.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated, TypedDict

import gymnasium as gym
from msgspec import Meta

from duobench.envs.config import EnvConfig
from duobench.errors import EvaluationError, PolicyTimeoutError, printable, traceback_text
from duobench.evaluation.rollout import Info, Observation, Step
from duobench.evaluation.suite import Episode, Setup
from duobench.randomness import SUITE_VERSION

RECORD_SCHEMA = 3
"""Version of the record's fields; raised when earlier records cannot be read any more: a field is
removed, changes its meaning, or is added without a default."""


class SampledLayout(TypedDict, total=False):
    """What the reset sampled, as `Layout.to_json` gives it; empty if nothing was."""

    poses: dict[str, Annotated[list[float], Meta(min_length=7, max_length=7)]]
    """Positions in metres and quaternions [x, y, z, qx, qy, qz, qw], in the table frame."""
    variants: dict[str, str]
    """Named choices."""


@dataclass(frozen=True, kw_only=True, slots=True)
class EpisodeRecord:
    """One episode of one task, from its seed to its last stage."""

    suite_version: str
    """Version of the benchmark's episodes that the seed belongs to."""
    task: str
    """Id of the task."""
    episode: int
    """Index of the episode in the suite."""
    seed: int
    """Seed of the reset; a pure function of (task, suite version, episode)."""
    policy_seed: int | None = None
    """Seed of the policy, a hash of that of the reset; None before suite 4, whose policies got that
    of the reset itself."""
    policy: str
    """Name of the policy, as the user gave it."""
    policy_version: str | None
    """Version of the policy, None if unknown."""
    config: EnvConfig
    """Configuration of the environment."""
    instruction: str
    """Instruction of the policy; empty if the episode crashed before its reset."""
    success: bool
    """Whether the last stage was reached."""
    success_at_end: bool
    """Whether the constraints of the last stage still held after the last step."""
    final_stage: int
    """Highest stage that was reached, 0 for none."""
    max_stage: int
    """The task's last stage."""
    unmet: tuple[str, ...] | None = None
    """Why the next stage was not reached: what of its constraints did not hold after the last step,
    in words; empty after a success, None in records that do not have it."""
    stage_changes: tuple[tuple[int, int], ...]
    """Pairs (control step, stage): after how many steps each newly reached stage was reached."""
    steps: int
    """Control steps that were executed."""
    horizon: int
    """Control steps after which the task truncates an episode."""
    terminated: bool
    """Whether the environment ended the episode."""
    truncated: bool
    """Whether the horizon ended the episode."""
    error: str | None
    """Traceback of what made the episode crash; such an episode counts as failed."""
    layout: SampledLayout
    """Where the objects began."""
    state_hash: str | None
    """SHA-256 of the full simulation state after the last step; None if the episode crashed."""
    versions: dict[str, str | None]
    """Versions of everything that the result may depend on."""

    def __post_init__(self) -> None:
        """Reject a record that contradicts itself."""
        reached = [stage for _, stage in self.stage_changes]
        when = [step for step, _ in self.stage_changes]
        problems = {
            "stage_changes must rise in step and stage": when != sorted(set(when))
            or reached != sorted(set(reached)),
            "final_stage must be the last stage of stage_changes": self.final_stage
            != (reached[-1] if reached else 0),
            "final_stage must lie in 0..max_stage": not 0 <= self.final_stage <= self.max_stage,
            "max_stage must be positive": self.max_stage < 1,
            "success must mean that the last stage was reached without an error": self.success
            != (self.final_stage == self.max_stage and self.error is None),
            "stages are reached within the executed steps": bool(when)
            and not 0 <= when[0] <= when[-1] <= self.steps,
            "steps must lie in 0..horizon": not 0 <= self.steps <= self.horizon,
            "error must say something": self.error is not None and not self.error.strip(),
        }
        broken = [rule for rule, violated in problems.items() if violated]
        if broken:
            raise EvaluationError(
                f"Record of {self.task}, episode {self.episode}: {'; '.join(broken)}."
            )

    @property
    def progress(self) -> float:
        """Highest stage over last stage, 0..1."""
        return self.final_stage / self.max_stage

    @property
    def reason(self) -> str:
        """The last line of the error, which says what it was; empty without one."""
        return (self.error or "").strip().rpartition("\n")[2]

    @property
    def missing(self) -> str:
        """What kept the next stage from being reached, in one line; empty if that is unknown."""
        return "; ".join(self.unmet or ())

    def stage_after(self, step: int) -> int:
        """Stage after that many control steps; the last one stays once the episode is over."""
        return max((stage for when, stage in self.stage_changes if when <= step), default=0)

    def broken(self, error: BaseException, steps: int) -> EpisodeRecord:
        """The record of the episode if it crashes, so many control steps after its start."""
        if isinstance(error, PolicyTimeoutError):  # where it was stuck is unknown
            text = f"{type(error).__name__}: {error}\n"
        else:
            text = traceback_text(error)
        return replace(self, success=False, success_at_end=False, steps=steps, error=text)


class EpisodeRecorder:
    """Watches an episode, and keeps what its record needs, whether or not it ends well."""

    def __init__(self, episode: Episode, on_stage: Callable[[], None] = lambda: None) -> None:
        """Begin with an episode of which nothing is known but its place in the suite.

        Args:
            episode: The episode.
            on_stage: Called when the episode has begun, and whenever it has reached a new stage.
        """
        self._episode = episode
        self._on_stage = on_stage
        self._env: gym.Env | None = None
        self._instruction = ""
        self._layout: SampledLayout = {}
        self._stage_changes: list[tuple[int, int]] = []
        self._last: Step | None = None
        self._state_hash: str | None = None

    def on_episode_start(self, env: gym.Env, observation: Observation, info: Info) -> None:  # noqa: ARG002 - the protocol's signature
        """Note what the reset sampled."""
        self._env = env
        self._instruction = printable(info["instruction"])
        self._layout = info["layout"]
        if stage := info["stage"]:
            self._stage_changes.append((0, stage))
        env.get_wrapper_attr("explain_stages")()
        self._on_stage()

    def on_step(self, step: Step) -> None:
        """Note a stage that was newly reached."""
        self._last = step
        if (stage := step.info["stage"]) > self.stage:
            self._stage_changes.append((step.number, stage))
            self._on_stage()

    def on_episode_end(self, error: BaseException | None) -> None:
        """Note the final state."""
        if self._env is not None and error is None:
            self._state_hash = self._env.get_wrapper_attr("state_hash")()

    @property
    def steps(self) -> int:
        """Control steps so far."""
        return self._last.number if self._last else 0

    @property
    def stage(self) -> int:
        """Highest stage so far."""
        return self._stage_changes[-1][1] if self._stage_changes else 0

    def record(self, setup: Setup) -> EpisodeRecord:
        """The record of the episode so far, played with a setup."""
        task, last = self._episode.task, self._last
        return EpisodeRecord(
            suite_version=SUITE_VERSION,
            task=task.id,
            episode=self._episode.index,
            seed=self._episode.seed,
            policy_seed=self._episode.policy_seed,
            policy=setup.policy,
            policy_version=setup.metadata.version,
            config=setup.config,
            instruction=self._instruction,
            success=self.stage == task.max_stage,
            success_at_end=bool(last and last.info["success_at_end"]),
            final_stage=self.stage,
            max_stage=task.max_stage,
            unmet=last.info.get("unmet") if last else None,
            stage_changes=tuple(self._stage_changes),
            steps=self.steps,
            horizon=task.horizon,
            terminated=bool(last and last.terminated),
            truncated=bool(last and last.truncated),
            error=None,
            layout=self._layout,
            state_hash=self._state_hash,
            versions=setup.versions,
        )
