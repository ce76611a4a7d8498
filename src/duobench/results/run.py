"""A run: a suite played by a policy.

The description of a run stands in its folder, and must match when the run is resumed.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import ClassVar

from duobench.envs.config import EnvConfig
from duobench.errors import EvaluationError
from duobench.files import differences
from duobench.policy import Batching, PolicyMetadata
from duobench.policy.registry import reads_simulation
from duobench.randomness import SUITE_VERSION
from duobench.results.limits import TimeLimits
from duobench.results.records import DOMAINS, MIXED, REAL, SIM, EpisodeRecord
from duobench.results.suite import Episode, Suite
from duobench.results.suites.shard import Shard
from duobench.shifts.shift import Shift

RUN_SCHEMA = 7
"""Version of the description's fields."""
OLDEST_RUN_SCHEMA = 3
"""The first version that can still be read: what it lacks has a default."""
TRAININGS = (SIM, REAL, MIXED)
"""What a policy may be trained on: recordings of simulated arms, of real ones, or of both."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Run:
    """Everything that decides what a run's records say. The number of workers is not part of it."""

    CHECKED_FROM: ClassVar[int] = 5
    """First schema whose files hold a checksum."""
    policy: str
    """Name of the policy."""
    suite: Suite
    """What is played."""
    videos: int
    """How many episodes of each task, from the first on, have a video."""
    limits: TimeLimits
    """How long the policy may take."""
    metadata: PolicyMetadata
    """What the policy says about itself, with its version."""
    config: EnvConfig
    """Configuration of the environments."""
    versions: dict[str, str]
    """Versions of the packages that scores depend on."""
    batching: Batching | None = None
    """How many observations the policy answers together, if that is known."""
    command: str = ""
    """The command that started it, without what another machine has elsewhere; empty if none."""
    shard: Shard | None = None
    """Which part of the suite's episodes it has; None for all."""
    domain: str = SIM
    """Where it is played: "sim" or "real"."""
    rig: str | None = None
    """SHA-256 of the rig on which it is played; None in simulation."""
    trained_on: str = ""
    """What the policy was trained on, as whoever started the run says: "sim", "real" or "mixed";
    empty if nobody said."""

    def __post_init__(self) -> None:
        """Reject what no run can be."""
        if self.videos < 0:
            raise EvaluationError(f"A number of videos is not negative, got {self.videos}.")
        if self.domain not in DOMAINS or (self.domain == REAL) != (self.rig is not None):
            raise EvaluationError(
                f"A run is played in {' or '.join(DOMAINS)}, and on real arms it names its rig; "
                f"got {self.domain!r} and {self.rig!r}."
            )
        if self.trained_on not in ("", *TRAININGS):
            raise EvaluationError(
                f"A policy is trained on {', '.join(TRAININGS)}; got {self.trained_on!r}."
            )

    @property
    def is_real(self) -> bool:
        """Whether it is played on real arms."""
        return self.domain == REAL

    @property
    def privileged(self) -> bool:
        """Whether the policy knows what a camera does not see and a real table does not tell.

        It has the numbers of the objects in its observation, or is a script that reads the
        simulation.
        """
        return self.metadata.object_state or reads_simulation(self.policy)

    @property
    def title(self) -> str:
        """Name of the policy for people, with a word if it is privileged."""
        return f"{self.policy} (privileged)" if self.privileged else self.policy

    def episodes(self) -> list[Episode]:
        """Every episode of every task, task by task."""
        return [
            Episode(
                task=task,
                index=index,
                has_video=index - self.suite.first_episode < self.videos,
                split=self.config.split,
                shift=self.suite.shift,
            )
            for place, task in enumerate(self.suite.tasks)
            for index in self.indices(place)
        ]

    def under(self, shift: Shift) -> Run:
        """The same run with another shift."""
        suite, config = replace(self.suite, shift=shift), replace(self.config, shift=shift)
        return replace(self, suite=suite, config=config)

    @property
    def size(self) -> int:
        """How many episodes it has."""
        return sum(self.counts.values())

    @property
    def counts(self) -> dict[str, int]:
        """How many episodes it has of each task, by the task's id."""
        return {task.id: len(self.indices(place)) for place, task in enumerate(self.suite.tasks)}

    def indices(self, place: int) -> range:
        """Indices of its episodes of a task, by the place of the task in the suite."""
        indices = self.suite.indices
        return indices if self.shard is None else self.shard.part(place, indices)

    def objection(self, record: EpisodeRecord, episode: Episode) -> str | None:
        """Why a record is not that of an episode of this run; None if it is."""
        expected = {
            "task": episode.task.id,
            "episode": episode.index,
            "policy": self.policy,
            "policy_version": self.metadata.version,
            "config": replace(self.config, shift=episode.shift),
            "suite_version": self.suite.version,
            "suite": self.suite.label,
            "execution": self.suite.execution_of(episode.task.id, episode.shift),
            "max_stage": episode.task.max_stage,
            "domain": self.domain,
            "rig": self.rig,
        }
        if self.suite.version == SUITE_VERSION:  # seeds of another one are not known here
            expected |= {"seed": episode.seed, "policy_seed": episode.policy_seed}
        for name, value in expected.items():
            if getattr(record, name) != value:
                return f"its {name} is {getattr(record, name)}, expected was {value}."
        return None

    def differences(self, other: Run) -> list[str]:
        """What another run has differently, field by field; its number of episodes may be lower."""
        # What another policy says about itself differs too, which says no more.
        is_same = self.policy == other.policy
        differing = differences(self._facts(is_same), other._facts(is_same))
        if self.suite.episodes < other.suite.episodes:
            differing.append(
                f"episodes {self.suite.episodes} instead of {other.suite.episodes} or more"
            )
        return differing

    def _facts(self, with_metadata: bool) -> dict[str, object]:
        """Everything but the number of episodes, by its name in words."""
        suite = self.suite
        return {
            "policy": self.policy,
            "tasks": " ".join(task.id for task in suite.tasks),
            **{f"task {task.id}": task for task in suite.tasks},
            "first episode": suite.first_episode,
            "suite version": suite.version,
            "suite": suite.label,
            "actions executed of a chunk": suite.execution.execute or "all",
            "latency": suite.execution.latency,
            "overtime": suite.overtime,
            "shard": self.shard,
            "videos": self.videos,
            **_fields("time limit", self.limits),
            **(_fields("policy's", self.metadata) if with_metadata else {}),
            "batches": self.batching,
            "domain": self.domain,
            "rig": self.rig,
            "trained on": self.trained_on,
            **_fields("environment's", self.config),
            **{f"version of {name}": value for name, value in self.versions.items()},
        }


def _fields(what: str, value: TimeLimits | PolicyMetadata | EnvConfig) -> dict[str, object]:
    return {f"{what} {field.name}": getattr(value, field.name) for field in fields(value)}
