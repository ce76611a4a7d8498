"""A run: a suite played by one or several policies, described once for all that write its records.

How much of it is played may grow, and writers are many: each writes the same description and
plays a shard, within the same time limits.
"""

import math
import re
from collections.abc import Iterator
from dataclasses import (
    dataclass,
    field,
    fields,
    replace,
)
from typing import Any, ClassVar, Self

import msgspec

from duobench.core.errors import EvaluationError, escaped
from duobench.core.files import checksum, differences
from duobench.core.randomness import SUITE_VERSION
from duobench.envs.config import IMAGE_SIZE, EnvConfig
from duobench.policy import Batching, PolicyMetadata
from duobench.policy.policy import robot_note
from duobench.policy.registry import reads_simulation
from duobench.policy.serving.address import MAX_S, SERVED
from duobench.results.records import (
    DOMAINS,
    MIXED,
    REAL,
    SIM,
    Condition,
    Key,
    Record,
    Software,
)
from duobench.results.suite import Episode, Suite
from duobench.tasks.shifts.shift import (
    EVERY_AXIS,
    NO_SHIFT,
    Shift,
    every_shift,
)

MAX_SHARDS = 10_000


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    order=True,
)
class Shard:
    """Part of a run: its number from 1 to the count of all parts.

    Together all parts are the run, also if episodes are added. They are dealt out one by one, a
    task beginning where the one before began plus one, so that every part has some of each task,
    and an episode never moves to another part.
    """

    count: int
    number: int

    def __post_init__(self) -> None:
        if not 1 <= self.count <= MAX_SHARDS:
            raise EvaluationError(
                f"A run has 1 to {MAX_SHARDS} shards, got {self.count}."
            )
        if not 1 <= self.number <= self.count:
            raise EvaluationError(
                f"Shards count from 1: of {self.count} there are 1 to {self.count}, got "
                f"{self.number}."
            )

    @classmethod
    def parse(cls, text: str, between: str = "/") -> "Shard":
        """A shard from text such as "3/16", the third of sixteen, or "3-of-16"."""
        found = re.fullmatch(rf"([0-9]{{1,9}}){between}([0-9]{{1,9}})", text)
        if not found:
            raise EvaluationError(
                f"A shard is NUMBER/COUNT, such as 1/4 for the first of four; got {text!r}."
            )
        return cls(number=int(found[1]), count=int(found[2]))

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"

    @property
    def writer(self) -> str:
        """Name of its writer, such as "3-of-16"."""
        return f"{self.number}-of-{self.count}"

    @property
    def is_whole(self) -> bool:
        """Whether it is all of a run."""
        return self.count == 1

    def part(self, task: int, episodes: range) -> range:
        """Episodes of a task in this shard; the task is given by its place in the run, from 0."""
        # Episode i of task t is in the shard whose number is (t + i) modulo the count, plus 1.
        first = (self.number - 1 - task - episodes.start) % self.count
        return range(episodes.start + first, episodes.stop, self.count)

    def overlaps(self, other: "Shard") -> bool:
        """Whether an episode may be in both."""
        return (self.number - other.number) % math.gcd(self.count, other.count) == 0


WHOLE = Shard(number=1, count=1)


_ENDLESS_S = (
    1e9  # a limit in seconds that is as good as none, for JSON knows no infinity
)


@dataclass(frozen=True, kw_only=True, slots=True)
class TimeLimits:
    """How long a policy may take; making it, with all its weights, has no limit."""

    act_timeout: float = 120.0
    """Seconds for one reset or one chunk of actions: minutes, for a first may compile a model."""
    episode_timeout: float = 1800.0
    """Seconds for an episode, looked at whenever the policy acts."""

    def __post_init__(self) -> None:
        if not (self.act_timeout > 0 and self.episode_timeout > 0):
            raise EvaluationError(
                f"Time limits are positive, got {self.act_timeout} s for an answer and "
                f"{self.episode_timeout} s for an episode."
            )
        object.__setattr__(self, "act_timeout", min(self.act_timeout, _ENDLESS_S))
        object.__setattr__(
            self, "episode_timeout", min(self.episode_timeout, _ENDLESS_S)
        )

    @property
    def served_s(self) -> float:
        """Seconds for one answer of a served policy; sockets know no endless time."""
        return min(self.act_timeout, MAX_S)


@dataclass(frozen=True, kw_only=True, slots=True)
class Resuming:
    """Treatment of an existing run, and of episodes that cannot be played."""

    retry_broken: bool = False
    """Play the episodes again that failed with an error in an earlier call."""
    fresh: bool = False
    """Remove any run in the folder and begin anew; of the same run, remove only what this shard has
    left. A run of which every finished episode failed with an error gives way to a
    changed policy too."""
    unplayed_count_as_failures: bool = False
    """Count episodes in which a process dies each of three times as failures, but never where
    their task fails; without this they stay unplayed, which is an error."""


RUN_SCHEMA = 12
_SHOWN = 8  # characters of a hash in a sentence
TRAININGS = (SIM, REAL, MIXED)
"""Data that a policy may be trained on: recordings of simulated arms, of real ones, or of both."""


def needed_options(policy: PolicyMetadata) -> dict[str, Any]:
    """Options that a policy needs of its environments: fields of `EnvConfig` by their names."""
    return {
        "cameras": policy.cameras,
        "depth": policy.depth,
        "segmentation": policy.segmentation,
        "object_state": policy.object_state,
        "action_mode": policy.action_mode,
        "image_size": policy.image_size or IMAGE_SIZE,
        "image_sizes": policy.image_sizes,
    }


@dataclass(frozen=True, kw_only=True, slots=True)
class Candidate:
    """A policy that is evaluated."""

    policy: str
    """Its name, as the user gave it."""
    metadata: PolicyMetadata
    config: EnvConfig
    """Configuration of its environments, without a shift."""
    batching: Batching | None = None
    """Observations in a batch, if known."""
    trained_on: str = ""
    """Data that it was trained on, "sim", "real" or "mixed"; empty if that is not known."""

    def __post_init__(self) -> None:
        if self.trained_on not in ("", *TRAININGS):
            raise EvaluationError(
                f"A policy is trained on {', '.join(TRAININGS)}; got {self.trained_on!r}."
            )
        if self.config.shift != NO_SHIFT:
            raise EvaluationError(
                f"Shifts are those of the suite; got {self.config.shift}."
            )

    @property
    def privileged(self) -> bool:
        """Whether it knows what no camera sees: what objects are where, or the simulation."""
        metadata = self.metadata
        sees_parts = metadata.object_state or bool(metadata.segmentation)
        return sees_parts or reads_simulation(self.policy)

    @property
    def robot_note(self) -> str:
        """A sentence if it learned with another gripper or mount than it plays with."""
        return robot_note(self.metadata, self.config)

    @property
    def name(self) -> str:
        """Its name for people: as the user gave it, and of a served one its own, if it has one."""
        is_served = self.policy in SERVED and self.metadata.name
        return escaped(self.metadata.name if is_served else self.policy)

    @property
    def title(self) -> str:
        """Its name for people, with a word if it is privileged."""
        return f"{self.name} (privileged)" if self.privileged else self.name


@dataclass(frozen=True, kw_only=True, slots=True)
class Run:
    """Everything that decides what a run's records say. The number of workers is not part of it."""

    CHECKED_FROM: ClassVar[int] = RUN_SCHEMA
    candidates: tuple[Candidate, ...]
    """The policies; each plays the same episodes."""
    suite: Suite
    limits: TimeLimits
    versions: dict[str, str]
    """Versions of the packages that scores depend on."""
    sources: dict[str, str] = field(default_factory=dict)
    """SHA-256 of each part of the source that decides the bits, by its name."""
    package: str = ""
    """SHA-256 of all source of the benchmark, as it was last; it may change while a run goes on."""
    domain: str = SIM
    rig: str | None = None
    """SHA-256 of what is chosen about the rig on which it is played, see `Rig.chosen`; None in
    simulation. What was measured about it may change while the run goes on: records name that."""

    def __post_init__(self) -> None:
        if self.domain not in DOMAINS or (self.domain == REAL) != (
            self.rig is not None
        ):
            raise EvaluationError(
                f"A run is played in {' or '.join(DOMAINS)}, and on real arms it names its rig; "
                f"got {self.domain!r} and {self.rig!r}."
            )
        if not self.candidates:
            raise EvaluationError("A run has at least one policy.")
        if len(self.conditions) < len(self.candidates) * len(self.suite.shifts):
            raise EvaluationError("Two policies of a run have the same name.")

    @property
    def is_real(self) -> bool:
        """Whether it is played on real arms."""
        return self.domain == REAL

    @property
    def hash(self) -> str:
        """SHA-256 of what decides: all but how many episodes and under which shifts."""
        suite = replace(self.suite, episodes=1, shifts=(NO_SHIFT,))
        return checksum(msgspec.to_builtins(replace(self, suite=suite, package="")))

    @property
    def software(self) -> Software:
        """Version of the benchmark's source that plays it, as in records."""
        decisive = checksum(self.sources) if self.sources else ""
        return Software(decisive=decisive, package=self.package)

    @property
    def candidate(self) -> Candidate:
        """Its policy, where it has one alone."""
        (candidate,) = self.candidates
        return candidate

    def of(self, policy: str) -> Candidate:
        """One of its policies by name."""
        for candidate in self.candidates:
            if candidate.policy == policy:
                return candidate
        raise EvaluationError(f"The run has no policy {policy!r}.")

    @property
    def conditions(self) -> dict[str, Condition]:
        """Its conditions by name: policy by policy, shift by shift."""
        each = (
            self._condition(candidate, shift)
            for candidate in self.candidates
            for shift in self.suite.shifts
        )
        return {condition.name: condition for condition in each}

    def _condition(self, candidate: Candidate, shift: Shift) -> Condition:
        return Condition.of(
            candidate.policy, self.domain, replace(candidate.config, shift=shift)
        )

    def key(self, episode: Episode, policy: str = "") -> Key:
        """Key of an episode that a policy plays, by default the only one."""
        candidate = self.of(policy) if policy else self.candidate
        condition = self._condition(candidate, episode.shift)
        return Key(episode.task.id, condition.name, episode.index)

    def episodes(self, shard: Shard = WHOLE, videos: int = 0) -> list[Episode]:
        """Every episode that each of its policies plays, task by task and shift by shift.

        Of each task and shift, the first ones have so many videos.
        """
        return [
            Episode(
                task=task,
                index=index,
                has_video=index - self.suite.first_episode < videos,
                split=self.candidates[0].config.split,
                shift=shift,
            )
            for place, task in enumerate(self.suite.tasks)
            for shift in self.suite.shifts
            for index in shard.part(place, self.suite.indices)
        ]

    def episode_keys(self, shard: Shard = WHOLE) -> Iterator[Key]:
        """Keys of its episodes: condition by condition, task by task."""
        for name in self.conditions:
            for place, task in enumerate(self.suite.tasks):
                for index in shard.part(place, self.suite.indices):
                    yield Key(task.id, name, index)

    def counts(self, shard: Shard = WHOLE) -> dict[str, int]:
        """Number of episodes of each task, by its id, under all conditions."""
        conditions = len(self.candidates) * len(self.suite.shifts)
        return {
            task.id: conditions * len(shard.part(place, self.suite.indices))
            for place, task in enumerate(self.suite.tasks)
        }

    @property
    def size(self) -> int:
        """Number of episodes under all conditions."""
        return sum(self.counts().values())

    def objection(self, record: Record, episode: Episode) -> str | None:
        """Reason why a record does not belong to this run; None if it does."""
        names = [candidate.policy for candidate in self.candidates]
        if record.policy not in names:
            return f"its policy is {record.policy}, expected was {', '.join(names)}."
        candidate = self.of(record.policy)
        expected: dict[str, object] = {
            "task": episode.task.id,
            "episode": episode.index,
            "policy_version": candidate.metadata.version,
            "config": replace(candidate.config, shift=episode.shift),
            "suite_version": self.suite.version,
            "suite": self.suite.label,
            "execution": self.suite.execution_of(episode.task.id, episode.shift),
            "max_stage": episode.task.max_stage,
            "domain": self.domain,
        }
        if record.software.decisive != self.software.decisive:
            return "it was played by another source of the benchmark than the run."
        if (
            self.suite.version == SUITE_VERSION
        ):  # seeds of another one are not known here
            expected |= {"seed": episode.seed, "policy_seed": episode.policy_seed}
        for name, value in expected.items():
            if getattr(record, name) != value:
                return f"its {name} is {getattr(record, name)}, expected was {value}."
        return None

    def differences(self, other: Self) -> list[str]:
        """Differences of another run, field by field; it may have less to play."""
        # What another policy says about itself differs too, which says no more.
        ours, theirs = (
            [each.policy for each in run.candidates] for run in (self, other)
        )
        is_same = ours == theirs
        differing = differences(self._facts(is_same), other._facts(is_same))
        now, before = self.suite.episodes, other.suite.episodes
        return differing + [f"episodes {now} instead of {before} or more"] * (
            now < before
        )

    def with_shifts_of(self, other: Self) -> Self:
        """The same run with the shifts of another one too."""
        both = {*self.suite.shifts, *other.suite.shifts}
        order = tuple(shift for shift in every_shift(EVERY_AXIS) if shift in both)
        return replace(self, suite=replace(self.suite, shifts=order))

    def _facts(self, with_candidates: bool) -> dict[str, object]:
        suite = self.suite
        facts: dict[str, object] = {
            "policy": ", ".join(candidate.policy for candidate in self.candidates),
            "tasks": " ".join(task.id for task in suite.tasks),
            **{f"task {task.id}": task for task in suite.tasks},
            "first episode": suite.first_episode,
            "suite version": suite.version,
            "suite": suite.label,
            "look": suite.look,
            "gripper": suite.gripper,
            "mount": suite.mount,
            "actions executed of a chunk": suite.execution.execute or "all",
            "latency": suite.execution.latency,
            **_fields("time limit", self.limits),
            "domain": self.domain,
            "rig": self.rig,
            **{f"version of {name}": value for name, value in self.versions.items()},
            **{
                f"source of {name}": value[:_SHOWN]
                for name, value in self.sources.items()
            },
        }
        for candidate in self.candidates if with_candidates else ():
            of = "" if len(self.candidates) == 1 else f"of {candidate.policy} "
            facts |= _fields(f"{of}policy's", candidate.metadata)
            facts |= _fields(f"{of}environment's", candidate.config)
            facts |= {
                f"{of}batches": candidate.batching,
                f"{of}trained on": candidate.trained_on,
            }
        return facts


def _fields(
    what: str, value: TimeLimits | PolicyMetadata | EnvConfig
) -> dict[str, object]:
    return {
        f"{what} {field.name}": getattr(value, field.name) for field in fields(value)
    }
