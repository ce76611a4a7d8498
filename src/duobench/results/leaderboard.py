"""A leaderboard: verified bundles in their order, what a ranked one has played, and its pages.

The pages load nothing, and are the same bytes for the same bundles.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

from markupsafe import Markup
from matplotlib.figure import Figure

from duobench.envs.config import EnvConfig
from duobench.errors import escaped
from duobench.files import make_folder, write, writing
from duobench.looks.look import Look
from duobench.pages import render
from duobench.results import figures, scores
from duobench.results.bundle import BUNDLE_SUFFIX
from duobench.results.pages import PAGE, check_free, identity
from duobench.results.paper import WARNING, paper_results
from duobench.results.records import EpisodeRecord, Key
from duobench.results.run import Run
from duobench.results.scores import Results, RunPart, Score, group_by_condition, summarize
from duobench.results.suite import find_tasks
from duobench.shifts.shift import NO_SHIFT
from duobench.tasks import catalog
from duobench.tasks.task import Category

SCHEMA = 1
"""Version of the fields of the JSON form."""
DOCUMENT = "leaderboard.json"
"""The leaderboard for programs; a folder that has it holds one."""
VERDICTS = "verification"
"""Folder of what is known about bundles that were verified before."""
MOST = 5
"""Ranked policies that the figure shows; one privileged policy stands below them."""
_POLICIES = "policies"
EPISODES = 100
"""Episodes of each task that count, 0 to 99, as in the paper."""
CHOSEN_BY_POLICY = frozenset(
    {
        *("cameras", "image_size", "object_state", "action_mode", "binary_gripper", "chunk"),
        *("render_mode", "render_size"),
    }
)
"""Fields of a configuration that make no episode easier or harder for the others to compare with.

What a policy sees and how it acts is its own affair. All other fields have their defaults.
"""
LONGEST_NAME = 120
"""Characters of a policy's name that are shown."""
SHORT = 12
"""Digits of a bundle's SHA-256 that name its page."""


@dataclass(frozen=True, kw_only=True, slots=True)
class RefusedBundle:
    """A bundle that is not shown as a result."""

    file: str
    """Its name in the folder."""
    reason: str
    """Why, in one line."""


@dataclass(frozen=True, kw_only=True, slots=True)
class BoardEntry:
    """A verified bundle."""

    file: str
    """Its name in the folder."""
    digest: str
    part: RunPart
    """What was played, without records."""
    results: Results
    """What its records add up to, without the records themselves."""
    commands: tuple[str, ...]
    """The commands that played it."""
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
        return escaped(self.part.candidate.policy)[:LONGEST_NAME]

    @property
    def privileged(self) -> bool:
        """Whether its policy knew what no camera shows."""
        return self.part.candidate.privileged or self.part.candidate.config.object_state

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
    entry: BoardEntry


@dataclass(frozen=True, kw_only=True, slots=True)
class Board:
    """All bundles of a folder."""

    entries: tuple[BoardEntry, ...]
    """Those that were verified."""
    refused: tuple[RefusedBundle, ...]

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
    def partial(self) -> list[BoardEntry]:
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
    unverifiable: Iterable[Key],
    commands: Iterable[str] = (),
) -> BoardEntry:
    """What a verified bundle adds up to.

    Args:
        file: Name of the bundle.
        digest: Its SHA-256.
        run: Its run, of tasks of the benchmark and one policy alone.
        records: Its records.
        verdicts: How many episodes have which verdict.
        unverifiable: Names of episodes that cannot be played again. They count as
            failures that reached no stage.
        commands: The commands that played it.
    """
    nothing = set(unverifiable)
    trusted = [
        replace(record, final_stage=0, stage_changes=(), success=False, success_at_end=False)
        if record.key in nothing
        else record
        for record in records
    ]
    parts = group_by_condition(run, trusted)
    part = next((each for each in parts if each.condition.shift == NO_SHIFT), parts[0])
    lacks = deviations(run, records)
    played = {task.id for task in run.suite.tasks}
    tasks = [task for task in find_tasks(()) if task.id in played]
    results = summarize(tasks, part.records if lacks else counted(part.records))
    results = replace(results, tasks=tuple(replace(one, records=()) for one in results.tasks))
    return BoardEntry(
        file=file,
        digest=digest,
        part=replace(part, results=results),
        results=results,  # joint targets of many runs would fill the memory
        commands=tuple(commands),
        verdicts=dict(verdicts),
        lacks=lacks,
    )


def _sorted(entries: Sequence[BoardEntry]) -> list[BoardEntry]:
    return sorted(entries, key=lambda entry: (*(-part for part in entry.standing), entry.digest))


def counted(records: Iterable[EpisodeRecord]) -> list[EpisodeRecord]:
    """The records of episodes that a ranked run is made of."""
    return [record for record in records if record.episode < EPISODES]


def deviations(run: Run, records: Iterable[EpisodeRecord]) -> tuple[str, ...]:
    """Why a run is not ranked, one phrase each; none if it has played the whole suite.

    Args:
        run: The run.
        records: Its records.
    """
    default = EnvConfig()
    found = [
        f"{name.replace('_', ' ')} {_word(value)} instead of {expected}"
        for name in (field.name for field in fields(EnvConfig))
        if name not in CHOSEN_BY_POLICY
        and (value := getattr(run.candidate.config, name)) != (expected := getattr(default, name))
    ]
    if run.suite.shifts != (NO_SHIFT,):
        found.append(f"{len(run.suite.shifts)} conditions, not that without a shift alone")
    tasks = catalog.names()
    played = {(record.task, record.episode) for record in counted(records)}
    if len(run.suite.tasks) < len(tasks):
        found.append(f"{len(run.suite.tasks)} of {len(tasks)} tasks")
    missing = {task.id: EPISODES for task in run.suite.tasks}
    for task, _ in played:
        missing[task] -= 1
    if lacking := sum(missing.values()):
        found.append(
            f"{lacking:,} of {EPISODES * len(missing):,} episodes of its tasks are missing"
        )
    return tuple(found)


def _word(value: object) -> str:
    return "of its own" if isinstance(value, Look) else str(value)


def shown(board: Board) -> list[tuple[str, BoardEntry]]:
    """The policies of the figure, each with the word that stands beside its bars."""
    best = [(str(one.rank), one.entry) for one in board.ranked(privileged=False)[:MOST]]
    privileged = [("P", one.entry) for one in board.ranked(privileged=True)[:1]]
    return best + privileged


def _stages(entries: Sequence[tuple[str, BoardEntry]]) -> Figure:
    tasks = entries[0][1].results.tasks
    return figures.grouped_stage_bars(
        [
            (one.task.title, [(word, entry.results.tasks[number]) for word, entry in entries])
            for number, one in enumerate(tasks)
        ]
    )


def begin_site(out: Path) -> None:
    """Make the folder of a leaderboard, or find that it is one."""
    check_free(out, DOCUMENT if (out / DOCUMENT).exists() else VERDICTS, "leaderboard")
    make_folder(out / VERDICTS)


def write_site(board: Board, out: Path) -> Path:
    """Write all pages and the JSON form; pages of bundles that are gone are removed.

    Args:
        board: What to show.
        out: The folder, after `begin_site`.

    Returns:
        The first page.
    """
    pages = {entry.page: _policy_page(board, entry) for entry in board.entries}
    for name, text in pages.items():
        write(out / name, text)
    write(out / PAGE, _front_page(board))
    write(out / DOCUMENT, board_json(board))
    for path in (out / _POLICIES).glob("*.html"):
        if f"{_POLICIES}/{path.name}" not in pages:
            with writing(path):
                path.unlink()
    return out / PAGE


def _front_page(board: Board) -> str:
    entries = shown(board)
    svg = figures.as_svg("leaderboard", partial(_stages, entries)) if entries else ""
    return render(
        "duobench.results",
        "leaderboard.html.j2",
        board=board,
        groups=(
            ("Policies", board.ranked(privileged=False)),
            ("Privileged policies", board.ranked(privileged=True)),
        ),
        categories=[str(category) for category in Category],
        paper=paper_results(),
        warning=WARNING,
        shown=entries,
        stages=Markup(figures.for_page(svg)) if svg else "",
        number_of_tasks=len(catalog.names()),
        episodes=EPISODES,
        suffix=BUNDLE_SUFFIX,
        short=SHORT,
        scores=scores,
    )


def _policy_page(board: Board, entry: BoardEntry) -> str:
    results: Results = entry.results
    svgs = {name: figures.plot(name, results) for name in figures.FIGURES}
    places = {
        one.entry.digest: one.rank
        for privileged in (False, True)
        for one in board.ranked(privileged=privileged)
    }
    return render(
        "duobench.results",
        "leaderboard_policy.html.j2",
        entry=entry,
        part=entry.part,
        run=entry.part.run,
        rank=places.get(entry.digest),
        results=results,
        identity=identity(entry.part),
        svgs={name: Markup(figures.for_page(svg)) for name, svg in svgs.items()},
        expected=entry.part.suite.episodes if entry.lacks else EPISODES,
        control_rate_hz=1.0,
        figures=figures,
        scores=scores,
    )


def board_json(board: Board) -> str:
    """The leaderboard as JSON text."""
    content = {
        "schema": SCHEMA,
        **{
            name: [
                {"rank": one.rank, **_entry(one.entry)}
                for one in board.ranked(privileged=privileged)
            ]
            for name, privileged in (("ranked", False), ("ranked_privileged", True))
        },
        "not_ranked": [{**_entry(entry), "because": list(entry.lacks)} for entry in board.partial],
        "refused": [{"file": one.file, "reason": one.reason} for one in board.refused],
    }
    return json.dumps(content, indent=2, ensure_ascii=False) + "\n"


def _entry(entry: BoardEntry) -> dict[str, Any]:
    return {
        "policy": entry.name,
        "policy_version": entry.part.candidate.metadata.version,
        "privileged": entry.privileged,
        "suite_version": entry.part.suite.version,
        "file": entry.file,
        "sha256": entry.digest,
        "verdicts": dict(entry.verdicts),
        "overall": entry.results.overall.numbers(),
        "categories": {one.label: one.numbers() for one in entry.results.categories},
        "tasks": {one.task.id: one.score.numbers() for one in entry.results.tasks},
    }
