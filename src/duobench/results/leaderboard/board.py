"""What a leaderboard shows: entries in their order, and bundles that were refused."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from duobench.errors import escaped
from duobench.results.leaderboard.protocol import counted, deviations
from duobench.results.metrics import Results, Score, summarize
from duobench.results.records import EpisodeRecord
from duobench.results.run import Run
from duobench.results.suite import find_tasks

LONGEST_NAME = 120
"""Characters of a policy's name that are shown."""
SHORT = 12
"""Digits of a bundle's SHA-256 that name its page."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Refused:
    """A bundle that is not shown as a result."""

    file: str
    """Its name in the folder."""
    reason: str
    """Why, in one line."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Entry:
    """A verified bundle."""

    file: str
    """Its name in the folder."""
    digest: str
    """Its SHA-256."""
    run: Run
    """What was played."""
    results: Results
    """What its records add up to, without the records themselves."""
    verdicts: Mapping[str, int]
    """How many episodes have which verdict, by the verdict."""
    lacks: tuple[str, ...]
    """Why it is not ranked, one phrase each; none if it is."""

    @property
    def page(self) -> str:
        """Its page, from the folder of the site."""
        return f"policies/{self.digest[:SHORT]}.html"

    @property
    def name(self) -> str:
        """Name of the policy, as its author gave it."""
        return escaped(self.run.policy)[:LONGEST_NAME]

    @property
    def privileged(self) -> bool:
        """Whether its policy knew what no camera shows."""
        return self.run.privileged or self.run.config.object_state

    @property
    def standing(self) -> tuple[float, float]:
        """Success rate and mean final progress, by which entries are ranked."""
        overall = self.results.overall
        return overall.success_rate or 0.0, overall.mean_final_progress or 0.0

    def category(self, label: str) -> Score | None:
        """What it reached in a category; None where it played none of its tasks."""
        found = (one for one in self.results.categories if one.label == label and one.episodes)
        return next(found, None)


@dataclass(frozen=True, kw_only=True, slots=True)
class Ranked:
    """An entry and its place."""

    rank: int
    """1 for the best; equal standings share a place."""
    entry: Entry
    """The entry."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Board:
    """All bundles of a folder."""

    entries: tuple[Entry, ...]
    """Those that were verified."""
    refused: tuple[Refused, ...]
    """The others."""

    def ranked(self, *, privileged: bool) -> list[Ranked]:
        """Entries that have played the whole suite, best first."""
        complete = [
            entry
            for entry in _sorted(self.entries)
            if not entry.lacks and entry.privileged == privileged
        ]
        standings = [entry.standing for entry in complete]
        return [Ranked(rank=1 + standings.index(entry.standing), entry=entry) for entry in complete]

    @property
    def partial(self) -> list[Entry]:
        """Entries that have played something else, by name: their numbers have no order."""
        return sorted(
            (entry for entry in self.entries if entry.lacks),
            key=lambda entry: (entry.privileged, entry.name, entry.digest),
        )


def make_entry(
    file: str,
    digest: str,
    run: Run,
    records: Sequence[EpisodeRecord],
    verdicts: Mapping[str, int],
    unverifiable: Sequence[tuple[str, int]],
) -> Entry:
    """What a verified bundle adds up to.

    Args:
        file: Name of the bundle.
        digest: Its SHA-256.
        run: Its run, of tasks of the benchmark alone.
        records: Its records.
        verdicts: How many episodes have which verdict.
        unverifiable: Tasks and indices of episodes that cannot be played again. They count as
            failures that reached no stage.
    """
    nothing = set(unverifiable)
    trusted = [
        replace(record, final_stage=0, stage_changes=(), success=False, success_at_end=False)
        if (record.task, record.episode) in nothing
        else record
        for record in records
    ]
    lacks = deviations(run, records)
    played = {task.id for task in run.suite.tasks}
    tasks = [task for task in find_tasks(()) if task.id in played]
    results = summarize(tasks, trusted if lacks else counted(trusted))
    return Entry(
        file=file,
        digest=digest,
        run=run,
        results=replace(
            results, tasks=tuple(replace(one, records=()) for one in results.tasks)
        ),  # joint targets of many runs would fill the memory
        verdicts=dict(verdicts),
        lacks=lacks,
    )


def _sorted(entries: Sequence[Entry]) -> list[Entry]:
    return sorted(entries, key=lambda entry: (*(-part for part in entry.standing), entry.digest))
