"""A leaderboard: verified bundles in their order, what a ranked one has played, and its pages.

The pages load nothing, and are the same bytes for the same bundles.
"""

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import msgspec

from duobench.core.files import make_folder, remove
from duobench.core.randomness import EVAL, SALTED
from duobench.core.versions import other_engine
from duobench.envs.config import EnvConfig
from duobench.results import figures
from duobench.results.bundle import BUNDLE_SUFFIX
from duobench.results.entrants import PAPER, WARNING, published
from duobench.results.pages import PAGE, check_free, json_text, page, part_page, write_files
from duobench.results.records import EpisodeRecord, Key
from duobench.results.run import Run
from duobench.results.salt import Round
from duobench.results.scores import Results, RunPart, group_by_condition, summarize
from duobench.results.suite import find_tasks
from duobench.tasks import catalog
from duobench.tasks.shifts.shift import NO_SHIFT
from duobench.tasks.task import Category
from duobench.world.looks.look import Look

SCHEMA = 1
DOCUMENT = "leaderboard.json"
"""The leaderboard for programs; a folder that has it holds one."""
VERDICTS = "verification"
"""Folder of what is known about bundles that were verified before."""
MOST = 5
"""Ranked policies that the figure shows; one privileged policy stands below them."""
EPISODES = 100
"""Episodes of each task that count, 0 to 99, as in the paper."""
CHOSEN_BY_POLICY = frozenset(
    {
        "cameras",
        "image_size",
        "object_state",
        "action_mode",
        "binary_gripper",
        "chunk",
        "render_mode",
        "render_size",
    }
)
"""Fields of a configuration that are a policy's own affair; all others have their defaults."""
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


@dataclass(frozen=True, kw_only=True, slots=True)
class BoardEntry:
    """A verified bundle."""

    file: str
    """Its name in the folder."""
    digest: str
    part: RunPart
    """What was played and adds up to, without the records themselves."""
    commands: tuple[str, ...]
    verdicts: Mapping[str, int]
    """How many episodes have which verdict, by the verdict."""
    repeats: str
    """How many of its episodes were begun more than once, and why, in words; empty if none was."""
    repeatability: str
    """Whether its first answers were the same, in words; empty if that is not known."""
    lacks: tuple[str, ...]
    """Why it is not ranked, one phrase each; none if it is."""
    hosted: Round | None = None
    """The round in which an organiser has played it; None if its author did."""

    @property
    def results(self) -> Results:
        """What its records add up to."""
        return self.part.results

    @property
    def page(self) -> str:
        """Its page, from the folder of the site."""
        return f"policies/{self.digest[:SHORT]}.html"

    @property
    def name(self) -> str:
        """Name of the policy, as its author gave it; of a served one its own."""
        return self.part.candidate.name[:LONGEST_NAME]

    @property
    def privileged(self) -> bool:
        """Whether its policy knew what no camera shows."""
        return self.part.candidate.privileged or self.part.candidate.config.object_state

    @property
    def standing(self) -> tuple[float, float]:
        """What entries are ranked by: success rate in the worst case, and mean final progress."""
        overall = self.results.overall
        return overall.worst_rate or 0.0, overall.mean_final_progress or 0.0


Ranked = list[tuple[int, BoardEntry]]
"""Entries after their places."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Board:
    """All bundles of a folder."""

    entries: tuple[BoardEntry, ...]
    refused: tuple[RefusedBundle, ...]
    rounds: tuple[Round, ...] = ()

    @property
    def groups(self) -> list[tuple[str, Round | None, bool, Ranked]]:
        """Title, round, whether privileged, and entries of each group, twice for each round.

        The last round comes first, and those without one, the self-reported, come last.
        """
        rounds = sorted(self.rounds, key=lambda each: each.date, reverse=True)
        return [
            (title + word, hosted, bool(word), self.ranked(privileged=bool(word), hosted=hosted))
            for hosted in (*rounds, None)
            for title in (f"Hosted, {hosted.name}" if hosted else "Self-reported",)
            for word in ("", ", privileged")
        ]

    def ranked(self, *, privileged: bool, hosted: Round | None = None) -> Ranked:
        """Entries that have played the whole suite, best first, each after its place.

        The best one has the place 1; equal standings share a place.
        """
        ours = (privileged, hosted)
        complete = sorted(
            (one for one in self.entries if not one.lacks and (one.privileged, one.hosted) == ours),
            key=lambda entry: (*(-number for number in entry.standing), entry.digest),
        )
        standings = [entry.standing for entry in complete]
        return [(1 + standings.index(entry.standing), entry) for entry in complete]

    @property
    def partial(self) -> list[BoardEntry]:
        """Entries that have played something else, by name: their numbers have no order."""
        return sorted(
            (entry for entry in self.entries if entry.lacks),
            key=lambda entry: (entry.privileged, entry.name, entry.digest),
        )


def counting(run: Run) -> set[Key]:
    """The episodes of a run that count: the first `EPISODES` of each task, without a shift if any.

    A run that was played under shifts alone has those of the first one.
    """
    conditions = run.conditions
    name = min(conditions, key=lambda each: conditions[each].shift != NO_SHIFT)
    indices = run.suite.indices[:EPISODES]
    return {Key(task.id, name, index) for task in run.suite.tasks for index in indices}


def make_entry(  # noqa: PLR0913 - what is known of a bundle
    file: str,
    digest: str,
    run: Run,
    records: Sequence[EpisodeRecord],
    verdicts: Mapping[str, int],
    unverifiable: Iterable[Key],
    *,
    noted: Container[str],
    commands: Iterable[str] = (),
    hosted: Round | None = None,
) -> BoardEntry:
    """What a verified bundle, a file with its SHA-256, adds up to; see `BoardEntry`.

    Its run is of tasks of the benchmark and one policy alone. Episodes that cannot be played again
    are unverifiable: they count as failures that reached no stage. Attempts at some episodes were
    noted, named by the paths of their keys.
    """
    failed, counts = set(unverifiable), counting(run)
    trusted = [
        record.unproven if record.key in failed else record
        for record in records
        if record.key in counts
    ]
    parts = group_by_condition(run, trusted)
    part = next((each for each in parts if each.records), parts[0])
    lacks = _deviations(run, records, SALTED if hosted else EVAL)
    unknown = sum(record.key.path not in noted for record in trusted)
    if unknown:
        lacks += (f"of {unknown:,} episodes no attempt is on record",)
    played = {task.id for task in run.suite.tasks}
    tasks = [task for task in find_tasks(()) if task.id in played]
    results = summarize(tasks, part.records)
    repeats = replace(part, results=results).repeats
    # Joint targets of many runs would fill the memory.
    results = replace(results, tasks=tuple(replace(one, records=()) for one in results.tasks))
    return BoardEntry(
        file=file,
        digest=digest,
        part=replace(part, results=results),
        commands=tuple(commands),
        verdicts=dict(verdicts),
        repeats=repeats,
        repeatability=part.repeatability,
        lacks=lacks,
        hosted=hosted,
    )


def _deviations(run: Run, records: Iterable[EpisodeRecord], split: str) -> tuple[str, ...]:
    """Why a run is not ranked, one phrase each; none if it has played the whole suite."""
    default = EnvConfig(split=split)
    found = [
        f"{name.replace('_', ' ')} {_word(value)} instead of {expected}"
        for name in (field.name for field in fields(EnvConfig))
        if name not in CHOSEN_BY_POLICY
        and (value := getattr(run.candidate.config, name)) != (expected := getattr(default, name))
    ]
    if run.suite.salt and split == EVAL:
        found.append("self-reported: whoever played it may have chosen its salt")
    if run.suite.shifts != (NO_SHIFT,):
        found.append(f"{len(run.suite.shifts)} conditions, not that without a shift alone")
    other = other_engine({"mujoco": "an unknown version", **run.versions})
    if other:
        found.append(other)
    tasks = catalog.names()
    if len(run.suite.tasks) < len(tasks):
        found.append(f"{len(run.suite.tasks)} of {len(tasks)} tasks")
    played = {(record.task, record.episode) for record in records if record.episode < EPISODES}
    expected = EPISODES * len(run.suite.tasks)
    lacking = expected - len(played)
    if lacking:
        found.append(f"{lacking:,} of {expected:,} episodes of its tasks are missing")
    return tuple(found)


def _word(value: object) -> str:
    return "of its own" if isinstance(value, Look) else str(value)


def begin_site(out: Path) -> None:
    """Make the folder of a leaderboard, or find that it is one."""
    check_free(out, DOCUMENT if (out / DOCUMENT).exists() else VERDICTS, "leaderboard")
    make_folder(out / VERDICTS)


def write_site(board: Board, out: Path) -> Path:
    """Write all pages and the JSON form into a folder, after `begin_site`; give the first page.

    Pages of bundles that are gone are removed.
    """
    pages = {entry.page: _policy_page(board, entry) for entry in board.entries}
    write_files(out, {**pages, PAGE: _front_page(board), DOCUMENT: _document(board)})
    there = out.glob("policies/*.html")
    remove(*(path for path in there if f"policies/{path.name}" not in pages))
    return out / PAGE


def _front_page(board: Board) -> str:
    plain = board.groups[::2]
    title, hosted, _, ranked = next((each for each in plain if each[-1]), plain[-1])
    shown = [(str(rank), entry) for rank, entry in ranked[:MOST]]
    shown += [("P", entry) for _, entry in board.ranked(privileged=True, hosted=hosted)[:1]]
    bars = [
        (row[0].task.title, [(word, one) for (word, _), one in zip(shown, row, strict=True)])
        for row in zip(*(entry.results.tasks for _, entry in shown), strict=True)
    ]
    make = figures.grouped_stage_bars
    return page(
        "leaderboard.html.j2",
        {"leaderboard": figures.as_svg("leaderboard", make, bars)} if shown else {},
        board=board,
        shown_title=title,
        categories=[str(category) for category in Category],
        paper=published(PAPER),
        warning=WARNING,
        shown=shown,
        number_of_tasks=len(catalog.names()),
        episodes=EPISODES,
        suffix=BUNDLE_SUFFIX,
        short=SHORT,
    )


def _policy_page(board: Board, entry: BoardEntry) -> str:
    ranked = board.ranked(privileged=entry.privileged, hosted=entry.hosted)
    return part_page(
        "leaderboard_policy.html.j2",
        figures.plots(entry.results),
        entry.part,
        entry=entry,
        rank=next((rank for rank, one in ranked if one.digest == entry.digest), None),
        expected=entry.part.suite.episodes if entry.lacks else EPISODES,
    )


def _document(board: Board) -> str:
    content = {
        "schema": SCHEMA,
        "rounds": msgspec.to_builtins(board.rounds),
        "hosted": [
            {"rank": rank, **_entry(entry)}
            for _, hosted, _, ranked in board.groups
            for rank, entry in (ranked if hosted else ())
        ],
        **{
            name: [
                {"rank": rank, **_entry(entry)}
                for rank, entry in board.ranked(privileged=privileged)
            ]
            for name, privileged in (("ranked", False), ("ranked_privileged", True))
        },
        "not_ranked": [{**_entry(entry), "because": list(entry.lacks)} for entry in board.partial],
        "refused": [{"file": one.file, "reason": one.reason} for one in board.refused],
    }
    return json_text(content)


def _entry(entry: BoardEntry) -> dict[str, Any]:
    return {
        "policy": entry.name,
        **entry.part.facts("policy_version"),
        "privileged": entry.privileged,
        **entry.part.facts("suite_version"),
        "file": entry.file,
        "sha256": entry.digest,
        "verdicts": dict(entry.verdicts),
        "attempts": entry.repeats,
        "repeatability": entry.repeatability,
        "round": entry.hosted and entry.hosted.name,
        "overall": entry.results.overall.numbers(),
        "categories": {one.label: one.numbers() for one in entry.results.categories},
        "tasks": {one.task.id: one.score.numbers() for one in entry.results.tasks},
    }
