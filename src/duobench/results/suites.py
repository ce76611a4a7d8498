"""The suites by name: what they fix, so that a name stands for a protocol.

A suite has a version of its own, its revision, which is raised when anything that it fixes changes.
What an episode of a task is belongs to the benchmark: `duobench.randomness.SUITE_VERSION`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from duobench.envs.execution import WHOLE_CHUNKS, ChunkExecution
from duobench.errors import OptionError, check_known
from duobench.looks.catalog import DEFAULT
from duobench.results.suite import CUSTOM, Suite, find_tasks
from duobench.shifts.shift import AXES, NO_SHIFT, Shift, every_shift
from duobench.tasks import catalog

DEFAULT_EPISODES = 20
"""Episodes of each task where no suite is named."""
PAPER_EXECUTE = 30
"""Actions of a chunk that the paper executes before it asks the policy again."""
AS_THE_PAPER = ChunkExecution(execute=PAPER_EXECUTE)
"""How the paper executes chunks; it says nothing of a latency."""


@dataclass(frozen=True, kw_only=True, slots=True)
class NamedSuite:
    """What a name stands for: all tasks of the benchmark, from episode 0 on, in the usual look."""

    name: str
    revision: int
    """Version of what is said here."""
    purpose: str
    """What it is for, in a few words."""
    episodes: int
    """Episodes of each task."""
    execution: ChunkExecution = AS_THE_PAPER
    """What is executed of the chunks of a policy, and when."""
    shifts: tuple[Shift, ...] = (NO_SHIFT,)
    """What its conditions are."""


SUITES: Mapping[str, NamedSuite] = {
    suite.name: suite
    for suite in (
        NamedSuite(name="paper", revision=1, purpose="results to publish", episodes=100),
        NamedSuite(name="quick", revision=1, purpose="a first look", episodes=10),
        NamedSuite(
            name="robust",
            revision=1,
            purpose="where a policy breaks",
            episodes=20,
            shifts=tuple(every_shift()),
        ),
    )
}
"""Every suite by its name."""


@dataclass(frozen=True, kw_only=True, slots=True)
class SuiteChoice:
    """A suite by its name, or one of one's own; what is given replaces what the name stands for."""

    suite: str | None = None
    """paper (100 episodes of each task, 30 actions executed of a chunk), quick (10 episodes),
    robust (20 episodes under each of 41 shifts, see docs/robustness.md), or none for your own."""
    tasks: tuple[str, ...] = ()
    """Task ids (see: duobench list) or module:ATTRIBUTE; all tasks if none is named."""
    episodes: int | None = None
    """Episodes of each task; without a number 20, or what the suite says."""
    first_episode: int = 0
    """Index of the first episode; seeds follow from task and index alone."""
    look: str = DEFAULT
    """Look of the images that the policy sees: wood_table, dark, random:7, ... (docs/looks.md)."""
    shift: str = NO_SHIFT.name
    """Play under one shift, such as look-3; see docs/robustness.md."""
    axes: tuple[str, ...] = ()
    """Of the suite robust, these axes alone: look, camera, layout, physics, instruction, sensing,
    latency, all."""
    levels: tuple[int, ...] = ()
    """Of the suite robust, these levels alone, 1 to 5; no shift is always played."""
    overtime: float = 1.0
    """Play an episode without success on after its horizon, until it has had so many horizons in
    all, such as 1.5. Scores and records end at the horizon."""

    def make(self, execution: ChunkExecution = WHOLE_CHUNKS) -> Suite:
        """The suite.

        Args:
            execution: How chunks are executed; without a number of actions as the name says.

        Raises:
            UnknownNameError: There is no such suite, task, look, shift or axis.
            EvaluationError: The suite would be empty.
            OptionError: Axes or levels are chosen of a suite without, or a shift of one with.
        """
        if self.suite is not None:
            check_known("suite", self.suite, SUITES)
        named = None if self.suite is None else SUITES[self.suite]
        usual = named.episodes if named else DEFAULT_EPISODES
        if named and execution.execute is None:
            execution = replace(execution, execute=named.execution.execute)
        return Suite(
            tasks=find_tasks(self.tasks),
            episodes=usual if self.episodes is None else self.episodes,
            first_episode=self.first_episode,
            look=self.look,
            shifts=self._shifts(named.shifts if named else (NO_SHIFT,)),
            overtime=self.overtime,
            name=named.name if named else CUSTOM,
            revision=named.revision if named else 1,
            execution=execution,
        )

    def _shifts(self, usual: tuple[Shift, ...]) -> tuple[Shift, ...]:
        """The shifts that are chosen, of those that the suite stands for."""
        chosen = Shift.parse(self.shift)
        if len(usual) == 1:
            if self.axes or self.levels:
                raise OptionError("Axes and levels are chosen of the suite robust, not of others.")
            return (chosen,)
        if chosen != NO_SHIFT:
            raise OptionError("The suite robust has shifts of its own: choose axes and levels.")
        for axis in self.axes:
            check_known("axis of a shift", axis, AXES)
        for level in self.levels:
            Shift(axis=AXES[0], level=level)
        return tuple(
            each
            for each in usual
            if each == NO_SHIFT
            or (
                (not self.axes or each.axis in self.axes)
                and (not self.levels or each.level in self.levels)
            )
        )


def deviations(suite: Suite) -> list[str]:
    """In what a suite with a name is not what the name stands for, one phrase each.

    Of a revision that this version does not know nothing is said.
    """
    named = SUITES.get(suite.name)
    if named is None or named.revision != suite.revision:
        return []
    ids = [task.id for task in suite.tasks]
    differing = {
        f"{len(ids)} of {len(catalog.names())} tasks": ids != list(catalog.names()),
        f"{suite.episodes} episodes instead of {named.episodes}": suite.episodes != named.episodes,
        f"episodes from number {suite.first_episode}": suite.first_episode != 0,
        f"look {suite.look}": suite.look != DEFAULT,
        f"{suite.execution.execute or 'all'} actions executed of a chunk instead of "
        f"{named.execution.execute}": suite.execution.execute != named.execution.execute,
        " and ".join(map(str, suite.shifts)): not {*suite.shifts} <= {*named.shifts},
        latency_text(suite): suite.execution.latency != named.execution.latency,
    }
    return [phrase for phrase, differs in differing.items() if differs]


def suite_text(suite: Suite) -> str:
    """Name and version of a suite for people, with how it differs from what the name stands for."""
    if suite.name == CUSTOM:
        return CUSTOM
    differing = deviations(suite)
    return f"{suite.label} with {', '.join(differing)}" if differing else suite.label


def execute_text(suite: Suite) -> str:
    """How many actions of a chunk are executed, in words."""
    count = suite.execution.execute
    if count is None:
        return "all of a chunk"
    return f"{count} of a chunk at most" if count > 1 else "the first of a chunk"


def latency_text(suite: Suite) -> str:
    """From an observation to the chunk that answers it, in words."""
    steps = suite.execution.latency
    if not steps:
        return "no latency"
    milliseconds = round(1000 * suite.execution.latency_s)
    return f"latency of {steps} control step{'s' if steps > 1 else ''} ({milliseconds} ms)"
