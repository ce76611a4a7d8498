"""A suite is what is played; a run is a suite played by a policy.

The description of a run stands in its folder, and must match when the run is resumed.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from dataclasses import dataclass, fields

import msgspec

from duobench.envs.config import EnvConfig
from duobench.errors import EvaluationError
from duobench.evaluation.limits import TimeLimits
from duobench.files import differences
from duobench.looks import catalog as looks
from duobench.policy import Batching, PolicyMetadata
from duobench.policy.serving.address import SERVED
from duobench.randomness import EVAL, SUITE_VERSION, episode_seed, policy_seed
from duobench.tasks import catalog

RUN_SCHEMA = 3
"""Version of the description's fields."""


@dataclass(frozen=True, kw_only=True, slots=True)
class TaskInfo:
    """What records, tables and reports need to know about a task, without the task itself."""

    reference: str
    """Import path `module:ATTRIBUTE` of the task, or the id of one of the benchmark."""
    id: str
    """Id of the task, which is also the name of a folder."""
    title: str
    """Name for people."""
    category: str
    """Coordination category."""
    stages: tuple[str, ...]
    """Names of the stages 1, 2, ..."""
    horizon: int
    """Control steps after which an episode is truncated."""

    def __post_init__(self) -> None:
        """Reject a task that cannot have records."""
        if not re.fullmatch(r"\w[\w.-]*", self.id):
            raise EvaluationError(
                f"Task {self.reference!r} has the id {self.id!r}. An id names a folder: letters, "
                "digits, '_', '-' and '.', beginning with a letter, a digit or '_'."
            )
        if not self.stages or self.horizon < 1:
            raise EvaluationError(f"Task {self.id!r} needs a stage and a positive horizon.")

    @property
    def max_stage(self) -> int:
        """Number of the last stage."""
        return len(self.stages)


@dataclass(frozen=True, kw_only=True, slots=True)
class Episode:
    """One episode to play."""

    task: TaskInfo
    """The task."""
    index: int
    """Index of the episode in the suite."""
    has_video: bool = False
    """Whether a video of it is made."""
    split: str = EVAL
    """Which layouts it is one of."""

    @property
    def name(self) -> str:
        """Name of its files."""
        return f"{self.index:05d}"

    @property
    def seed(self) -> int:
        """Seed of the reset: a pure function of (task, suite version, split, episode)."""
        return episode_seed(self.task.id, self.index, self.split)

    @property
    def policy_seed(self) -> int:
        """Seed of the policy: a hash of that of the reset."""
        return policy_seed(self.task.id, self.seed, self.split)


@dataclass(frozen=True, kw_only=True, slots=True)
class Suite:
    """What a policy is evaluated on."""

    tasks: tuple[TaskInfo, ...]
    """The tasks, in the order of the table."""
    episodes: int = 20
    """Episodes of each task."""
    first_episode: int = 0
    """Index of the first one."""
    look: str = looks.DEFAULT
    """Name of the look of all episodes; see `duobench.looks.catalog.look`."""
    version: str = SUITE_VERSION
    """Version of the benchmark's episodes."""

    def __post_init__(self) -> None:
        """Reject an empty or impossible suite."""
        if self.episodes < 1 or self.first_episode < 0:
            raise EvaluationError(
                "A suite has at least one episode, counted from 0; got "
                f"{self.episodes} from {self.first_episode}."
            )
        if not self.tasks:
            raise EvaluationError("A suite has at least one task, got none.")
        looks.look(self.look)
        ids = [task.id for task in self.tasks]
        if twice := sorted({task_id for task_id in ids if ids.count(task_id) > 1}):
            raise EvaluationError(f"Named more than once: {', '.join(twice)}. Name each task once.")

    @property
    def indices(self) -> range:
        """Indices of the episodes of every task."""
        return range(self.first_episode, self.first_episode + self.episodes)

    @property
    def size(self) -> int:
        """Episodes of all tasks."""
        return self.episodes * len(self.tasks)


def find_tasks(paths: Sequence[str]) -> tuple[TaskInfo, ...]:
    """Look tasks up.

    Args:
        paths: Task ids or import paths `module:ATTRIBUTE`; none means every task of the benchmark.

    Returns:
        One description a task, in the order of the import paths.

    Raises:
        UnknownNameError: If a task does not exist.
        ImportPathError: If its module cannot be imported.
        EvaluationError: If the task can have no records.
    """
    return tuple(_described(catalog.plain(path)) for path in paths or catalog.names())


def _described(path: str) -> TaskInfo:
    task = catalog.get(path)
    return TaskInfo(
        reference=path,
        id=task.id,
        title=task.title,
        category=str(task.category),
        stages=tuple(stage.name for stage in task.stages),
        horizon=task.horizon,
    )


class Setup(msgspec.Struct, tag=True, frozen=True, kw_only=True):
    """What plays: a policy, its environments, and the software under them."""

    policy: str
    """Name of the policy, as the user gave it."""
    metadata: PolicyMetadata
    """What the policy says about itself, with its version."""
    config: EnvConfig
    """Configuration of the environments that it acts in."""
    versions: dict[str, str | None]
    """What `record_versions` gave, and how the policy infers."""
    batching: Batching | None = None
    """How many observations the policy answers together, if that is known."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Run:
    """Everything that decides what a run's records say. The number of workers is not part of it."""

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

    def __post_init__(self) -> None:
        """Reject an impossible number of videos."""
        if self.videos < 0:
            raise EvaluationError(f"A number of videos is not negative, got {self.videos}.")

    def episodes(self) -> list[Episode]:
        """Every episode of every task, task by task."""
        return [
            Episode(task=task, index=index, has_video=nth < self.videos, split=self.config.split)
            for task in self.suite.tasks
            for nth, index in enumerate(self.suite.indices)
        ]

    @property
    def command(self) -> str:
        """The command line that makes this run again, into a folder DIR."""
        suite, limits = self.suite, self.limits
        words = ["duobench", "eval", "--policy", self.policy]
        words += ["--tasks", *(task.reference for task in suite.tasks)]
        words += ["--episodes", str(suite.episodes), "--first-episode", str(suite.first_episode)]
        words += ["--videos", str(self.videos)]
        if self.policy in SERVED:
            words += ["--server", "URL"]
        elif self.batching is not None:
            words += ["--batch", self.batching.mode, "--max-batch", str(self.batching.size)]
        if suite.look != looks.DEFAULT:
            words += ["--look", suite.look]
        if limits != TimeLimits():
            words += ["--act-timeout", f"{limits.act_s:g}"]
            words += ["--episode-timeout", f"{limits.episode_s:g}"]
        return shlex.join([*words, "--out", "DIR"])

    def differences(self, other: Run) -> list[str]:
        """What another run has differently, field by field; its number of episodes may be lower."""
        differing = differences(self._facts(), other._facts())
        if self.suite.episodes < other.suite.episodes:
            differing.append(
                f"episodes {self.suite.episodes} instead of {other.suite.episodes} or more"
            )
        return differing

    def _facts(self) -> dict[str, object]:
        """Everything but the number of episodes, by its name in words."""
        suite = self.suite
        return {
            "policy": self.policy,
            "tasks": " ".join(task.id for task in suite.tasks),
            **{f"task {task.id}": task for task in suite.tasks},
            "first episode": suite.first_episode,
            "suite version": suite.version,
            "videos": self.videos,
            **_fields("time limit", self.limits),
            **_fields("policy's", self.metadata),
            "batches": self.batching,
            **_fields("environment's", self.config),
            **{f"version of {name}": value for name, value in self.versions.items()},
        }


def _fields(what: str, value: TimeLimits | PolicyMetadata | EnvConfig) -> dict[str, object]:
    return {f"{what} {field.name}": getattr(value, field.name) for field in fields(value)}
