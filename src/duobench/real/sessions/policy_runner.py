"""A policy on the arms, one episode at a time, and how an episode ended."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast
from urllib.parse import parse_qs

import gymnasium as gym

from duobench.core.errors import DuoBenchError, PolicyError
from duobench.data import Actor, DataSet, Recorder
from duobench.data.rig import RigRecorder
from duobench.envs.duo_env import (
    TRUNCATION_REASON,
    DuoWrapper,
    ResetOptions,
    Start,
    base_of,
)
from duobench.evaluation.policies import (
    PolicyChoice,
    PolicySource,
    find_source,
    parse_choice,
)
from duobench.evaluation.rollouts import Step, Watcher, rollout
from duobench.policy.interruptible import InterruptiblePolicy
from duobench.policy.registry import PolicyKind
from duobench.real.clock import VirtualClock
from duobench.real.duo import FrankaDuo
from duobench.real.env import FAULT_KIND, WAITS, RealEnv
from duobench.results.labels import FaultKind, StageLabels
from duobench.results.records import REAL
from duobench.results.run import TimeLimits
from duobench.results.suite import TaskInfo


class FixedLayout(DuoWrapper):
    """Begins every episode with the layout that a person has placed."""

    options: Mapping[str, Any] = {}
    """Options of the next reset; they go before those that it is given."""

    def reset(self, *, seed: int | None = None, options: ResetOptions = None) -> Start:
        """Begin an episode."""
        return self.env.reset(seed=seed, options={**(options or {}), **self.options})


def find_rig_policy(name: str, tasks: tuple[TaskInfo, ...] = ()) -> PolicySource:
    """A policy that can play on real arms; one with domain ids is told that it does.

    Args:
        name: Its name, as `PolicyChoice` takes it; `NAME@URL` for one that is served.
        tasks: What it is to do, as far as that is known.
    """
    choice = parse_choice(name)
    if choice.server is None:
        choice = PolicyChoice(name=as_real(name))
    if choice.kind.is_scripted:
        raise PolicyError(
            f"{name} reads the simulation, which real arms do not have; name a policy that sees "
            "images, or, to record, the file of a recorded episode."
        )
    return find_source(choice, tasks, TimeLimits())


def as_real(name: str) -> str:
    """Name of a policy that gets real arms as its domain, unless the name says where it plays."""
    _, has_query, query = name.partition("?")
    if not name.startswith(f"{PolicyKind.LEROBOT}:") or parse_qs(query).get("domain"):
        return name
    return f"{name}{'&' if has_query else '?'}domain={REAL}"


def make_rig_recorder(
    env: gym.Env,
    duo: FrankaDuo,
    data: DataSet | str | Path,
    actor: Actor,
    **options: Any,
) -> Recorder:
    """A `Recorder` with all cameras of a rig, in which every episode waits for a decision."""
    rig = RigRecorder(duo, waits=isinstance(duo.clock, VirtualClock))
    return Recorder(
        env,
        data,
        actor,
        is_reviewed=True,
        rig=rig,
        **options,
    )


REASONS = {
    FaultKind.PERSON: (
        "The operator stopped the arms to protect people, objects or arms.",
        "The operator stopped the arms by mistake.",
        "A door or a guard of the cell was opened.",
    ),
    FaultKind.CONTROLLER: (
        "Nothing was to be seen: the controller stopped by itself.",
        "An arm shook or jumped before it stopped.",
    ),
}
"""Answers to the question why the arms stopped, by the kinds of fault that never count against a
policy."""
_MEANINGS = {
    FaultKind.PERSON: "A person did that, so it never counts against the policy: say why, and the "
    "trial comes again.",
    FaultKind.CONTROLLER: "Our own controller did that, so it never counts against the policy: say "
    "what you saw, and the trial comes again.",
    FaultKind.LIMIT: "If that was the policy's doing, it counts; otherwise say why it is invalid.",
    FaultKind.CONTACT: "This counts against the policy.",
}


@dataclass(frozen=True, kw_only=True, slots=True)
class PlayedEpisode:
    """An episode that was played, and is still to be decided."""

    steps: int
    stopped: str = ""
    """Reason why the arms ended it; empty if they did not."""
    fault: FaultKind | None = None
    """Kind of that fault, if it was one."""
    error: PolicyError | None = None
    """The error of the policy that ended it."""
    failure: DuoBenchError | None = None
    """Error that is no fault of the policy, so that the episode does not count."""
    waits: int = 0
    """Number of times that the arms rested for a late image."""
    ended_by_success: bool = False
    """Whether the press of the last stage ended it."""
    has_begun: bool = True
    """Whether a command of the policy found arms that could follow it, or the policy failed."""

    @property
    def invalid(self) -> str:
        """Reason why it cannot count, however it is judged; empty if it can."""
        if self.failure is not None and not self.reasons:
            return f"{type(self.failure).__name__}: {self.failure}"
        is_cable = self.fault is FaultKind.COMMUNICATION and not self.ended_by_success
        return self.stopped if is_cable else ""

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reasons to choose from where the episode cannot count; empty if it may."""
        return (
            ()
            if self.fault is None or self.ended_by_success
            else REASONS.get(self.fault, ())
        )

    @property
    def ending(self) -> str:
        """Reason why the policy stopped, for the operator; may be empty."""
        if self.error is not None:
            return f"The policy failed: {str(self.error).strip().splitlines()[-1]}"
        if self.fault is None or self.ended_by_success:
            return self.stopped
        return f"{self.stopped} {_MEANINGS.get(self.fault, '')}".strip()


class PolicyRunner:
    """One policy on the arms, in an environment that is recorded or not."""

    def __init__(self, env: DuoWrapper, source: PolicySource) -> None:
        self.env = FixedLayout(env)
        self._duo = cast("RealEnv", base_of(env)).rig
        self.policy = source.bind(self.env)
        self.asked = InterruptiblePolicy(self.policy)
        """The same, as episodes ask it."""

    def play(
        self,
        seed: int,
        options: Mapping[str, Any],
        watchers: Sequence[Watcher] = (),
    ) -> PlayedEpisode:
        """Play an episode, with options of the reset, the layout among them."""
        self.env.options = options
        ending, before = _LastStep(), self._duo.followed
        error = failure = None
        try:
            rollout(
                self.env,
                self.asked,
                seed=seed,
                watchers=[ending, *watchers],
            )
        except PolicyError as caught:
            error = caught
        except DuoBenchError as caught:
            failure = caught
        kind, stopped = ending.info.get(FAULT_KIND), ending.info.get(TRUNCATION_REASON)
        return PlayedEpisode(
            steps=ending.number,
            stopped=str(stopped or ""),
            fault=None if kind is None else FaultKind(kind),
            error=error,
            failure=failure,
            waits=int(ending.info.get(WAITS, 0)),
            ended_by_success=ending.terminated,
            has_begun=error is not None or self._duo.followed > before,
        )

    def keep(self, labels: StageLabels, *, holds: bool) -> None:
        """Keep the recording of an episode that counts, as it was judged; see `correct`."""
        recorder = self.env.env
        if isinstance(recorder, Recorder):
            recorder.finish(reason="The policy failed.")
            recorder.correct(labels.changes(), holds=holds)
            recorder.keep()

    def forget(self) -> None:
        """Forget the recording of one that does not."""
        recorder = self.env.env
        if isinstance(recorder, Recorder):
            recorder.discard()


class _LastStep(Watcher):
    """A watcher that keeps what the last step said."""

    def __init__(self) -> None:
        self.info: Mapping[str, Any] = {}
        self.number = 0
        self.terminated = False

    def on_step(self, step: Step) -> None:
        self.info = step.info
        self.number = step.number
        self.terminated = step.terminated
