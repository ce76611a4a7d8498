"""A suite: the episodes of some tasks, which every policy plays in the same way."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from duobench.envs.execution import WHOLE_CHUNKS, ChunkExecution
from duobench.errors import EvaluationError
from duobench.looks import catalog as looks
from duobench.randomness import EVAL, SUITE_VERSION, episode_seed, policy_seed
from duobench.shifts.levels import latency_steps
from duobench.shifts.shift import NO_SHIFT, Shift
from duobench.tasks import catalog

CUSTOM = "custom"
"""Name of a suite that somebody put together."""


@dataclass(frozen=True, kw_only=True, slots=True)
class TaskInfo:
    """What records, tables and reports need to know about a task, without the task itself."""

    reference: str
    """Import path `module:ATTRIBUTE` of the task, or the id of one of the benchmark."""
    id: str
    """Id of the task, which is also the name of a folder."""
    title: str
    category: str
    stages: tuple[str, ...]
    """Names of the stages 1, 2, ..."""
    horizon: int
    """Control steps after which an episode is truncated."""

    def __post_init__(self) -> None:
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
    index: int
    """Index of the episode in the suite."""
    has_video: bool = False
    """Whether a video of it is made."""
    split: str = EVAL
    """Which layouts it is one of."""
    shift: Shift = NO_SHIFT
    """What differs in it from the usual episode of this index."""

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
    name: str = CUSTOM
    """Name of the suite that it is, or that it was made from; see `duobench.results.suites`."""
    revision: int = 1
    """Version of the suite of that name: of what it fixes beside the episodes."""
    execution: ChunkExecution = WHOLE_CHUNKS
    """What is executed of the chunks of a policy, and when."""
    shifts: tuple[Shift, ...] = (NO_SHIFT,)
    """What differs from the usual episodes, condition by condition; each has all episodes."""
    overtime: float = 1.0
    """Horizons after which an episode without success ends. What happens after the first one is no
    part of its result; 1 plays none of it."""

    def __post_init__(self) -> None:
        if self.episodes < 1 or self.first_episode < 0:
            raise EvaluationError(
                "A suite has at least one episode, counted from 0; got "
                f"{self.episodes} from {self.first_episode}."
            )
        if not 1.0 <= self.overtime < math.inf:
            raise EvaluationError(
                "Overtime is a number of horizons, 1 (none) or more, such as 1.5; got "
                f"{self.overtime}."
            )
        if not self.tasks:
            raise EvaluationError("A suite has at least one task, got none.")
        looks.look(self.look)
        if not self.shifts:
            raise EvaluationError("A suite is played under at least one shift, or none.")
        for what, names in (
            ("task", [task.id for task in self.tasks]),
            ("shift", [shift.name for shift in self.shifts]),
        ):
            if twice := sorted({name for name in names if names.count(name) > 1}):
                raise EvaluationError(
                    f"Named more than once: {', '.join(twice)}. Name each {what} once."
                )

    @property
    def label(self) -> str:
        """Name and version, as records have them: "custom", or such as "paper 1"."""
        return CUSTOM if self.name == CUSTOM else f"{self.name} {self.revision}"

    def execution_of(self, task_id: str, shift: Shift) -> ChunkExecution:
        """What is executed of chunks in episodes of a task, with the latency of a shift."""
        latency = self.execution.latency + latency_steps(shift, task_id)
        return replace(self.execution, latency=latency)

    @property
    def indices(self) -> range:
        """Indices of the episodes of every task."""
        return range(self.first_episode, self.first_episode + self.episodes)

    @property
    def size(self) -> int:
        """Episodes of all tasks under one shift."""
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
