"""What a run is: the description that stands in its folder and that a restart must match."""

from __future__ import annotations

import json
import shlex
from dataclasses import asdict, dataclass, fields
from typing import Any

from duobench.errors import EvaluationError

RUN_SCHEMA = 1
"""Version of the description's fields."""


@dataclass(frozen=True, kw_only=True, slots=True)
class TaskInfo:
    """What records, tables and reports need to know about a task, without the task itself."""

    reference: str
    """Name under which the task was asked for: its id, or `module:ATTRIBUTE`."""
    id: str
    """Id of the task."""
    title: str
    """Name for people."""
    category: str
    """Coordination category."""
    stages: tuple[str, ...]
    """Names of the stages 1, 2, ..."""
    horizon: int
    """Control steps after which an episode is truncated."""

    @property
    def max_stage(self) -> int:
        """Number of the last stage."""
        return len(self.stages)


@dataclass(frozen=True, kw_only=True, slots=True)
class Run:
    """Everything that decides what a run's records say. The number of workers is not part of it."""

    policy: str
    """Name of the policy."""
    tasks: tuple[TaskInfo, ...]
    """The tasks, in the order of the table."""
    episodes: int
    """Episodes of each task."""
    first_episode: int
    """Index of the first one."""
    videos: int
    """How many episodes of each task, from the first on, are filmed."""
    suite_version: str
    """Version of the benchmark's episodes."""
    versions: dict[str, str]
    """Versions of the packages that scores depend on."""

    def __post_init__(self) -> None:
        """Refuse an empty or impossible run."""
        if self.episodes < 1 or self.first_episode < 0 or self.videos < 0:
            raise EvaluationError(
                "A run has at least one episode, counted from 0, and no negative number of videos; "
                f"got {self.episodes} from {self.first_episode} with {self.videos} videos."
            )
        if not self.tasks:
            raise EvaluationError("A run has at least one task, got none.")
        ids = [task.id for task in self.tasks]
        if twice := sorted({task_id for task_id in ids if ids.count(task_id) > 1}):
            raise EvaluationError(f"Named more than once: {', '.join(twice)}. Name each task once.")

    @property
    def episode_indices(self) -> range:
        """Indices of the episodes of every task."""
        return range(self.first_episode, self.first_episode + self.episodes)

    def is_filmed(self, episode: int) -> bool:
        """Whether an episode has a video."""
        return episode - self.first_episode < self.videos

    @property
    def command(self) -> str:
        """The command line that makes this run again, into a folder DIR."""
        words = ["duobench", "eval", "--policy", self.policy]
        words += ["--tasks", *(task.reference for task in self.tasks)]
        words += ["--episodes", str(self.episodes), "--first-episode", str(self.first_episode)]
        words += ["--videos", str(self.videos), "--out", "DIR"]
        return shlex.join(words)

    def to_json(self) -> str:
        """As JSON text with a final line feed."""
        document = {"schema": RUN_SCHEMA, **asdict(self)}
        return json.dumps(document, indent=2, ensure_ascii=False) + "\n"

    @staticmethod
    def from_json(text: str) -> Run:
        """From the text that `to_json` gave.

        Raises:
            EvaluationError: If it is no JSON or describes no run of this version.
        """
        try:
            document: dict[str, Any] = json.loads(text)
            if document.pop("schema", None) != RUN_SCHEMA:
                raise EvaluationError(f"Not schema {RUN_SCHEMA}, which this version reads.")
            document["tasks"] = tuple(
                TaskInfo(**{**task, "stages": tuple(task["stages"])}) for task in document["tasks"]
            )
            return Run(**document)
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise EvaluationError(f"No description of a run: {error}.") from error

    def differences(self, other: Run) -> list[str]:
        """What another run has differently, one sentence part a field."""
        found = []
        for field in fields(self):
            here, there = getattr(self, field.name), getattr(other, field.name)
            if here != there:
                name = field.name.replace("_", " ")
                found.append(f"{name}: {_short(here)} instead of {_short(there)}")
        return found


def _short(value: object) -> str:
    """A value for a message: tasks by their ids, unless only their details could tell."""
    if isinstance(value, tuple):
        return " ".join(
            f"{task.id}({task.max_stage} stages, {task.horizon} steps)" for task in value
        )
    if isinstance(value, dict):
        return ", ".join(f"{name} {version}" for name, version in value.items())
    return str(value)
