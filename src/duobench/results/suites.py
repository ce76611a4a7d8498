"""The suites by name: what they fix, so that a name stands for a protocol.

A suite has a version of its own, its revision, which is raised when anything that it fixes changes.
What an episode of a task is belongs to the benchmark: `duobench.randomness.SUITE_VERSION`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from duobench.envs.execution import ChunkExecution
from duobench.errors import check_known
from duobench.looks.catalog import DEFAULT
from duobench.results.suite import CUSTOM, Suite, find_tasks
from duobench.shifts.shift import NO_SHIFT, Shift, every_shift
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


def make_suite(  # noqa: PLR0913
    name: str | None = None,
    *,
    tasks: Sequence[str] = (),
    episodes: int | None = None,
    first_episode: int = 0,
    look: str = DEFAULT,
    execute: int | None = None,
    latency: int = 0,
    shifts: Sequence[Shift] = (),
    overtime: float = 1.0,
) -> Suite:
    """A suite by its name, or one of one's own; what is given replaces what the name stands for.

    Args:
        name: A key of `SUITES`; None for a suite of one's own.
        tasks: Task ids or import paths `module:ATTRIBUTE`; none takes all of the benchmark.
        episodes: Episodes of each task; None takes those of the name, or `DEFAULT_EPISODES`.
        first_episode: Index of the first one.
        look: Name of the look.
        execute: Actions of a chunk that are executed; None takes those of the name, or all.
        latency: Control steps from an observation to the chunk that answers it.
        shifts: What differs from the usual episodes, condition by condition; none takes those of
            the name.
        overtime: Horizons after which an episode without success ends; see `Suite`.

    Raises:
        UnknownNameError: There is no such suite, task or look.
        EvaluationError: The suite would be empty.
        OptionError: Chunks cannot be executed so.
    """
    if name is not None:
        check_known("suite", name, SUITES)
    named = None if name is None else SUITES[name]
    usual = named.episodes if named else DEFAULT_EPISODES
    return Suite(
        tasks=find_tasks(tasks),
        episodes=usual if episodes is None else episodes,
        first_episode=first_episode,
        look=look,
        shifts=tuple(shifts) or (named.shifts if named else (NO_SHIFT,)),
        overtime=overtime,
        name=named.name if named else CUSTOM,
        revision=named.revision if named else 1,
        execution=ChunkExecution(
            execute=named.execution.execute if named and execute is None else execute,
            latency=latency,
        ),
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
