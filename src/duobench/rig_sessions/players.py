"""The policies on the arms: one environment each, and what became of an episode."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import gymnasium as gym

from duobench.data import Recorder
from duobench.envs.config import IMAGE_SIZE, LAYOUT, EnvConfig
from duobench.envs.duo_env import TRUNCATION_REASON, ResetOptions, Start
from duobench.envs.wrapper import DuoWrapper
from duobench.errors import DuoBenchError, PolicyError
from duobench.evaluation.policies import PolicySource
from duobench.evaluation.recorder import EpisodeRecorder
from duobench.evaluation.rollout import Watcher, rollout
from duobench.hardware.devices import FaultKind
from duobench.hardware.env import FAULT_KIND
from duobench.policy import Policy
from duobench.results.limits import TimeLimits
from duobench.results.records import REAL, EpisodeRecord, Judged
from duobench.results.run import Candidate, Run
from duobench.results.suite import Suite
from duobench.rig_sessions.judging import PersonJudge
from duobench.rig_sessions.trial_plan import Plan, Trial, TrialPolicy
from duobench.sim.layout import Layout
from duobench.tasks import catalog
from duobench.versions import package_versions, record_versions

if TYPE_CHECKING:
    from duobench.evaluation.rollout import Info, Observation, Step

MakeEnv = Callable[[EnvConfig, PersonJudge, TrialPolicy], gym.Env]
"""Makes the environment of a configuration on the arms for a policy, judged by a person."""


class LaidOut(DuoWrapper):
    """Begins every episode with the layout that a person has placed."""

    layout: Layout | None = None
    """The layout of the next episode."""

    def reset(self, *, seed: int | None = None, options: ResetOptions = None) -> Start:
        """Begin an episode."""
        placed = {} if self.layout is None else {LAYOUT: self.layout}
        return self.env.reset(seed=seed, options={**(options or {}), **placed})


@dataclass(frozen=True, kw_only=True, slots=True)
class Played:
    """An episode that was played and is still to be judged."""

    recorder: EpisodeRecorder
    """What was seen of it."""
    run: Run
    """What it belongs to."""
    steps: int
    """Its control steps."""
    stopped: str = ""
    """Why the arms ended it; empty if they did not."""
    fault: FaultKind | None = None
    """What sort of fault that was, if one."""
    error: PolicyError | None = None
    """The error of the policy that ended it."""
    machinery: str = ""
    """What went wrong through no fault of the policy, so that it does not count."""
    ended_by_success: bool = False
    """Whether the press of the last stage ended it."""

    @property
    def invalid(self) -> str:
        """Why it cannot count, whatever a person says; empty if it can."""
        if self.machinery:
            return self.machinery
        if self.fault in {FaultKind.COMMUNICATION, FaultKind.DEVICE}:
            return self.stopped
        return ""

    @property
    def ending(self) -> str:
        """Why the policy plays no more, for the operator; empty if there is nothing to say."""
        if self.error is not None:
            return f"The policy failed: {str(self.error).strip().splitlines()[-1]}"
        if self.fault is not None:
            return f"{self.stopped} This counts against the policy."
        return self.stopped

    def record(
        self, judged: Judged, stage_changes: tuple[tuple[int, int], ...], *, at_end: bool
    ) -> EpisodeRecord:
        """The record, as it was judged.

        Args:
            judged: Who judged, and every press.
            stage_changes: Pairs (control step, stage) that stand.
            at_end: Whether the last stage still held at the end.
        """
        plain = self.recorder.record(self.run, record_versions(None))
        final = stage_changes[-1][1] if stage_changes else 0
        success = final == plain.max_stage
        reflex = self.fault is FaultKind.REFLEX
        record = replace(
            plain,
            stage_changes=stage_changes,
            final_stage=final,
            success=success,
            success_at_end=success and at_end,
            unmet=None,
            domain=REAL,
            rig=self.run.rig,
            judged=replace(judged, stopped=self.stopped, reflex=reflex),
        )
        return record if self.error is None else record.broken(self.error, self.steps)


class Players:
    """All policies of a plan, on the same arms."""

    def __init__(
        self,
        plan: Plan,
        sources: Sequence[PolicySource],
        make_env: MakeEnv,
        judge: PersonJudge,
        command: str = "",
    ) -> None:
        """Take the policies; environments are made when they are needed.

        Args:
            plan: What is played.
            sources: The policies in the order of the plan.
            make_env: Makes an environment on the arms.
            judge: The person who judges.
            command: The command that started it, if there is one.
        """
        self._plan, self._sources, self._make_env = plan, sources, make_env
        self._judge = judge
        self.command = command
        """The command that started it; empty if there was none."""
        self._made: dict[int, tuple[LaidOut, Policy]] = {}

    def run(self, policy: int) -> Run:
        """The description of a policy's run."""
        plan, chosen = self._plan, self._plan.policies[policy]
        metadata = chosen.metadata
        usual = catalog.get(plan.task.reference).horizon
        candidate = Candidate(
            policy=chosen.spec,
            metadata=metadata,
            config=EnvConfig(
                cameras=metadata.cameras,
                object_state=metadata.object_state,
                action_mode=metadata.action_mode,
                control_rate_hz=metadata.control_rate_hz,
                image_size=metadata.image_size or IMAGE_SIZE,
                horizon=None if plan.task.horizon == usual else plan.task.horizon,
            ),
            batching=self._sources[policy].batching,
            trained_on=chosen.trained_on,
        )
        return Run(
            candidates=(candidate,),
            suite=Suite(
                tasks=(plan.task,), episodes=plan.episodes, first_episode=plan.first_episode
            ),
            limits=TimeLimits(),
            versions=package_versions(),
            domain=REAL,
            rig=plan.rig,
        )

    def prepare(self) -> None:
        """Make every environment, so that a policy that does not fit is known before all trials.

        Raises:
            DuoBenchError: An environment cannot be made.
        """
        for policy in range(len(self._plan.policies)):
            self._prepared(policy)

    def play(self, trial: Trial, layout: Layout, watchers: Sequence[Watcher]) -> Played:
        """Play a trial.

        Args:
            trial: The trial.
            layout: How the objects lie.
            watchers: Called in this order.
        """
        env, policy = self._prepared(trial.policy)
        env.layout = layout
        episode = self._plan.episode(trial.episode)
        recorder, last = EpisodeRecorder(episode), _Last()
        error: PolicyError | None = None
        machinery = ""
        try:
            rollout(env, policy, seed=episode.seed, watchers=[recorder, last, *watchers])
        except PolicyError as caught:
            error = caught
        except DuoBenchError as caught:
            machinery = f"{type(caught).__name__}: {caught}"
        kind = last.info.get(FAULT_KIND)
        return Played(
            recorder=recorder,
            run=self.run(trial.policy),
            steps=last.number,
            stopped=str(last.info.get(TRUNCATION_REASON) or ""),
            fault=None if kind is None else FaultKind(kind),
            error=error,
            machinery=machinery,
            ended_by_success=last.terminated,
        )

    def settle(self, trial: Trial, *, counts: bool) -> None:
        """Keep the recording of a trial that counts, and forget that of one that does not."""
        env, _ = self._prepared(trial.policy)
        if isinstance(env.env, Recorder):
            env.env.finish(reason="The policy failed.")
            if counts:
                env.env.keep()
            else:
                env.env.discard()

    def _prepared(self, policy: int) -> tuple[LaidOut, Policy]:
        if policy not in self._made:
            chosen = self._plan.policies[policy]
            env = LaidOut(self._make_env(self.run(policy).candidate.config, self._judge, chosen))
            self._made[policy] = env, self._sources[policy].bind(env)
        return self._made[policy]


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


class _Last:
    """A watcher that keeps the last step."""

    def __init__(self) -> None:
        self.info: dict[str, Any] = {}
        self.number = 0
        self.terminated = False

    def on_episode_start(self, env: gym.Env, observation: Observation, info: Info) -> None:
        """Nothing was stepped yet."""

    def on_step(self, step: Step) -> None:
        """Keep a step."""
        self.info, self.number, self.terminated = step.info, step.number, step.terminated

    def on_episode_end(self, error: BaseException | None) -> None:
        """What was kept stays."""
