"""A suite: the episodes of some tasks, which every policy plays in the same way.

A suite by name stands for a protocol. It has a version of its own, its revision, which is raised
when anything that it fixes changes. What an episode of a task is belongs to the benchmark:
`duobench.core.randomness.SUITE_VERSION`.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from duobench.core.errors import EvaluationError, OptionError, check_known
from duobench.core.randomness import (
    EVAL,
    SUITE_VERSION,
    episode_seed,
    policy_seed,
)
from duobench.envs.config import EnvConfig
from duobench.envs.execution import WHOLE_CHUNKS, ChunkExecution
from duobench.tasks import catalog
from duobench.tasks.shifts.levels import latency_steps
from duobench.tasks.shifts.shift import (
    AXES,
    EVERY_AXIS,
    LEVELS,
    NO_SHIFT,
    RENDERER,
    Shift,
    every_shift,
)
from duobench.world.looks import catalog as looks
from duobench.world.robot.cameras import Camera
from duobench.world.robot.frames import robot_with
from duobench.world.robot.gripper import DEFAULT_GRIPPER
from duobench.world.robot.mounts import DEFAULT_MOUNT

CUSTOM = "custom"
"""Name of a suite with options of the user's own."""
DEFAULT_EPISODES = 20
"""Episodes of each task where no suite is named."""
PAPER_EXECUTE = 30
"""Actions of a chunk that the paper executes before it asks the policy again."""
AS_THE_PAPER = ChunkExecution(execute=PAPER_EXECUTE)
"""Execution of chunks in the paper, which gives no latency."""


@dataclass(frozen=True, kw_only=True, slots=True)
class TaskInfo:
    """Facts about a task for records, tables and reports, without the task itself."""

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
            raise EvaluationError(
                f"Task {self.id!r} needs a stage and a positive horizon."
            )

    @property
    def max_stage(self) -> int:
        """Number of the last stage."""
        return len(self.stages)


@dataclass(frozen=True, kw_only=True, slots=True)
class Episode:
    """One episode to play."""

    task: TaskInfo
    index: int
    has_video: bool = False
    split: str = EVAL
    """Split of its layouts."""
    shift: Shift = NO_SHIFT
    """Shift from the usual episode of this index."""

    @property
    def seed(self) -> int:
        """Seed of the reset: a pure function of (task, suite version, split, episode)."""
        return episode_seed(self.task.id, self.index, self.split)

    @property
    def policy_seed(self) -> int:
        """Seed of the policy: a hash of that of the reset."""
        return policy_seed(self.task.id, self.seed, self.split)


MAX_EPISODES = 2**53
"""Indices of episodes are below it: every program reads such whole numbers from JSON."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Suite:
    """Suite of episodes on which a policy is evaluated."""

    tasks: tuple[TaskInfo, ...]
    episodes: int = 20
    first_episode: int = 0
    look: str = looks.DEFAULT
    """Name of the look of all episodes; see `duobench.world.looks.catalog.look`."""
    gripper: str = DEFAULT_GRIPPER
    """Gripper on the arms, as `EnvConfig` has it."""
    mount: str = DEFAULT_MOUNT
    """Mounting of the arms, as `EnvConfig` has it."""
    version: str = SUITE_VERSION
    name: str = CUSTOM
    """Name of the suite that it is, or that it was made from; see `SUITES`."""
    revision: int = 1
    """Version of the suite of that name: of what it fixes beside the episodes."""
    execution: ChunkExecution = WHOLE_CHUNKS
    """Executed part of the chunks of a policy, and its timing."""
    shifts: tuple[Shift, ...] = (NO_SHIFT,)
    """Shifts from the usual episodes, condition by condition; each has all episodes."""

    def __post_init__(self) -> None:
        if (
            self.episodes < 1
            or not 0 <= self.first_episode <= MAX_EPISODES - self.episodes
        ):
            raise EvaluationError(
                f"A suite has at least one episode, counted from 0, and ends before {MAX_EPISODES};"
                f" got {self.episodes} from {self.first_episode}."
            )
        if not self.tasks:
            raise EvaluationError("A suite has at least one task, got none.")
        looks.look(self.look)
        robot_with(self.gripper, self.mount)
        if not self.shifts:
            raise EvaluationError(
                "A suite is played under at least one shift, or none."
            )
        for what, names in (
            ("task", [task.id for task in self.tasks]),
            ("shift", [shift.name for shift in self.shifts]),
        ):
            twice = sorted({name for name in names if names.count(name) > 1})
            if twice:
                raise EvaluationError(
                    f"Named more than once: {', '.join(twice)}. Name each {what} once."
                )

    @property
    def label(self) -> str:
        """Name and version, as records have them: "custom", or such as "paper 1"."""
        return CUSTOM if self.name == CUSTOM else f"{self.name} {self.revision}"

    def execution_of(self, task_id: str, shift: Shift) -> ChunkExecution:
        """Execution of chunks in episodes of a task, with the latency of a shift."""
        latency = self.execution.latency + latency_steps(shift, task_id)
        return replace(self.execution, latency=latency)

    @property
    def indices(self) -> range:
        """Indices of the episodes of every task."""
        return range(self.first_episode, self.first_episode + self.episodes)

    @property
    def foreign(self) -> tuple[str, ...]:
        """Ids of its tasks that are not of the benchmark."""
        return tuple(task.id for task in self.tasks if task.id not in catalog.names())

    @property
    def size(self) -> int:
        """Episodes of all tasks under one shift."""
        return self.episodes * len(self.tasks)


def find_tasks(paths: Sequence[str]) -> tuple[TaskInfo, ...]:
    """Describe tasks by their ids or import paths `module:ATTRIBUTE`; none means all there are.

    Raises:
        UnknownNameError: If a task does not exist.
        ImportPathError: If its module cannot be imported.
        EvaluationError: If the task can have no records.
    """
    names = [catalog.plain(path) for path in paths or catalog.names()]
    return tuple(
        TaskInfo(
            reference=name,
            id=task.id,
            title=task.title,
            category=str(task.category),
            stages=tuple(stage.name for stage in task.stages),
            horizon=task.horizon,
        )
        for name, task in zip(names, map(catalog.get, names), strict=True)
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class NamedSuite:
    """Suite of a name: all tasks of the benchmark, from episode 0 on, in the usual look."""

    name: str
    revision: int
    purpose: str
    episodes: int
    execution: ChunkExecution = AS_THE_PAPER
    shifts: tuple[Shift, ...] = (NO_SHIFT,)


SUITES: Mapping[str, NamedSuite] = {
    suite.name: suite
    for suite in (
        NamedSuite(
            name="paper", revision=1, purpose="results to publish", episodes=100
        ),
        NamedSuite(
            name="quick",
            revision=1,
            purpose="a first look",
            episodes=10,
        ),
        NamedSuite(
            name="robust",
            revision=1,
            purpose="where a policy breaks",
            episodes=20,
            shifts=tuple(every_shift()),
        ),
    )
}
_OWN = NamedSuite(
    name=CUSTOM,
    revision=1,
    purpose="",
    episodes=DEFAULT_EPISODES,
    execution=WHOLE_CHUNKS,
)
"""Suite where none is named."""


@dataclass(frozen=True, kw_only=True, slots=True)
class SuiteChoice:
    """A suite by its name, or one of one's own; what is given replaces what the name stands for."""

    suite: str | None = None
    """paper (100 episodes of each task, 30 actions executed of a chunk), quick (10 episodes),
    robust (20 episodes under each of 41 shifts; see the page robustness); or your own."""
    tasks: tuple[str, ...] = ()
    """Task ids (see: duobench list) or module:ATTRIBUTE; all tasks if none is named."""
    episodes: int | None = None
    """Episodes of each task; without a number 20, or what the suite says."""
    first_episode: int = 0
    """Index of the first episode; seeds follow from task and index alone."""
    look: str = looks.DEFAULT
    """Look of the images that the policy sees: wood_table, dark, random:7, ... (see the page
    looks)."""
    gripper: str = DEFAULT_GRIPPER
    """Gripper on both arms, such as franka_hand, or module:ATTRIBUTE."""
    mount: str = DEFAULT_MOUNT
    """How the arms are mounted: duo, or wide, which is 200 mm further apart."""
    shift: str = NO_SHIFT.name
    """Play under one shift, such as look-3; see the page robustness."""
    axes: tuple[str, ...] = ()
    """Of the suite robust, these axes alone: look, camera, layout, physics, instruction, sensing,
    latency, all; and renderer, which is not among them and needs Vulkan."""
    levels: tuple[int, ...] = ()
    """Of the suite robust, these levels alone, 1 to 5; no shift is always played."""

    def make(self, execution: ChunkExecution = WHOLE_CHUNKS) -> Suite:
        """The suite, its chunks executed as told; without a number of actions as the name says.

        Raises:
            UnknownNameError: There is no such suite, task, look, shift or axis.
            EvaluationError: The suite would be empty.
            OptionError: Axes or levels are chosen of a suite without, or a shift of one with.
        """
        if self.suite is not None:
            check_known("suite", self.suite, SUITES)
        named = SUITES[self.suite] if self.suite is not None else _OWN
        if execution.execute is None:
            execution = replace(execution, execute=named.execution.execute)
        return Suite(
            tasks=find_tasks(self.tasks),
            episodes=named.episodes if self.episodes is None else self.episodes,
            first_episode=self.first_episode,
            look=self.look,
            gripper=self.gripper,
            mount=self.mount,
            shifts=self._shifts(named.shifts),
            name=named.name,
            revision=named.revision,
            execution=execution,
        )

    def _shifts(self, usual: tuple[Shift, ...]) -> tuple[Shift, ...]:
        """The shifts that are chosen, of those that the suite stands for."""
        chosen = Shift.parse(self.shift)
        if len(usual) == 1:
            if self.axes or self.levels:
                raise OptionError(
                    "Axes and levels are chosen of the suite robust, not of others."
                )
            return (chosen,)
        if chosen != NO_SHIFT:
            raise OptionError(
                "The suite robust has shifts of its own: choose axes and levels."
            )
        for axis in self.axes:
            check_known("axis of a shift", axis, EVERY_AXIS)
        for level in self.levels:
            Shift(axis=AXES[0], level=level)
        axes, levels = self.axes or AXES, self.levels or range(1, LEVELS + 1)
        other = tuple(every_shift((RENDERER,)))[1:]
        return tuple(
            each
            for each in usual + other
            if each == NO_SHIFT or (each.axis in axes and each.level in levels)
        )


_USUAL = EnvConfig()


def extra_sensing(config: EnvConfig) -> str:
    """What a policy sees beyond images of the robot's cameras, in words; empty for nothing."""
    own = [camera.name for camera in config.cameras if isinstance(camera, Camera)]
    extra = {
        "cameras of its own": own,
        "depth": config.depth,
        "segmentation": config.segmentation,
    }
    return ", ".join(
        f"{what} ({', '.join(names)})" for what, names in extra.items() if names
    )


def deviations(suite: Suite, config: EnvConfig = _USUAL) -> list[str]:
    """Differences from the suite of its name, one phrase each, also in what a policy sees.

    Empty for a revision that this version does not know.
    """
    named = SUITES.get(suite.name)
    if named is None or named.revision != suite.revision:
        return []
    ids = [task.id for task in suite.tasks]
    differing = {
        f"{len(ids)} of {len(catalog.names())} tasks": ids != list(catalog.names()),
        f"{suite.episodes} episodes instead of {named.episodes}": suite.episodes
        != named.episodes,
        f"episodes from number {suite.first_episode}": suite.first_episode != 0,
        f"look {suite.look}": suite.look != looks.DEFAULT,
        f"gripper {suite.gripper}": suite.gripper != DEFAULT_GRIPPER,
        f"mount {suite.mount}": suite.mount != DEFAULT_MOUNT,
        f"{suite.execution.execute or 'all'} actions executed of a chunk instead of "
        f"{named.execution.execute}": suite.execution.execute
        != named.execution.execute,
        " and ".join(map(str, suite.shifts)): not {*suite.shifts} <= {*named.shifts},
        latency_text(suite): suite.execution.latency != named.execution.latency,
        extra_sensing(config): extra_sensing(config) != "",
    }
    return [phrase for phrase, differs in differing.items() if differs]


def suite_text(suite: Suite, config: EnvConfig = _USUAL) -> str:
    """Name and version of a suite for people, with how it differs from what the name stands for."""
    if suite.name == CUSTOM:
        return CUSTOM
    differing = deviations(suite, config)
    return f"{suite.label} with {', '.join(differing)}" if differing else suite.label


def execute_text(suite: Suite) -> str:
    """Number of executed actions of a chunk, in words."""
    count = suite.execution.execute
    if count is None:
        return "all of a chunk"
    return f"{count} of a chunk at most" if count > 1 else "the first of a chunk"


def latency_text(suite: Suite) -> str:
    """Latency from an observation to its chunk, in words."""
    steps = suite.execution.latency
    if not steps:
        return "no latency"
    milliseconds = round(1000 * suite.execution.latency_s)
    return (
        f"latency of {steps} control step{'s' if steps > 1 else ''} ({milliseconds} ms)"
    )
