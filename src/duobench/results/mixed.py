"""The paper's mixed table: trained on simulated, real or mixed data, evaluated in both worlds.

Policies stand side by side, with a row for all tasks together. Trainings of one policy that played
in the same world are tested against each other, in pairs where they played the same episodes. The
two worlds are not tested against each other: their episodes differ.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

from duobench.core.errors import EvaluationError
from duobench.results import tables
from duobench.results.comparison import compare_entrants
from duobench.results.entrants import (
    Cell,
    Entrant,
    RowKind,
    TableRow,
    entrant_of,
    lettered,
    read_named,
    table_rows,
)
from duobench.results.pages import (
    PAGE,
    check_free,
    json_text,
    page,
    write_files,
)
from duobench.results.pairs import Pair
from duobench.results.records import DOMAINS, REAL, SIM
from duobench.results.run import TRAININGS
from duobench.results.scores import (
    RunPart,
    Score,
    interval_percent,
    summarize,
)

DOCUMENT = "mixed.json"
"""The table for programs; a folder that has it holds one."""
MIXED_SCHEMA = 4
WHERE = {SIM: "in simulation", REAL: "on real arms"}
CSV_HEADER = (
    "task",
    "policy",
    "trained_on",
    "evaluated_in",
    "episodes",
    "successes",
    "success_rate",
    "wilson_low",
    "wilson_high",
    "mean_final_progress",
)


TEST_HEADS = ("Evaluated", "First", "Second", "Compared by", *tables.TEST_HEADS)
"""Columns of the table of tests."""


class Place(NamedTuple):
    """Place of a result in the table."""

    policy: str
    """Name of the policy, the same for all of its trainings; may be empty."""
    trained_on: str
    domain: str
    """Domain in which it was evaluated."""

    @property
    def title(self) -> str:
        """The policy with its training, in words."""
        return f"{self.policy} trained on {self.trained_on}".strip()


@dataclass(frozen=True, kw_only=True, slots=True)
class MixedTest:
    """Two trainings of a policy that played in the same world, against each other."""

    policy: str
    domain: str
    pair: Pair

    def lines(self) -> Iterator[list[str]]:
        """Rows of the table of tests, below `TEST_HEADS`."""
        for test in self.pair.tests:
            yield [
                WHERE[self.domain],
                self.pair.a.name,
                self.pair.b.name,
                tables.episodes_text(self.pair),
                *tables.test_cells(test),
            ]


@dataclass(frozen=True, kw_only=True, slots=True)
class MixedTable:
    """Trainings by the world that they played in, policy by policy."""

    rows: tuple[TableRow, ...]
    """The tasks, and all of them together."""
    entrants: dict[Place, Entrant]
    tests: tuple[MixedTest, ...]

    @property
    def policies(self) -> list[str]:
        """The policies, in the order of their columns."""
        return list(dict.fromkeys(place.policy for place in self.entrants))

    @property
    def columns(self) -> list[tuple[str, str]]:
        """Policy and world of each column."""
        return [(policy, domain) for policy in self.policies for domain in DOMAINS]

    def lines(self) -> Iterator[tuple[TableRow, str, list[Score | None]]]:
        """Line by line: what was played, what it was trained on, and the score of each column."""
        for row in self.rows:
            for trained_on in TRAININGS:
                found = [
                    self.score(row, Place(policy, trained_on, domain))
                    for policy, domain in self.columns
                ]
                if any(found):
                    yield row, trained_on, found

    def score(self, row: TableRow, place: Place) -> Score | None:
        """Score in a row; None where a task of it was not played."""
        entrant = self.entrants.get(place)
        return entrant and entrant.score(row.tasks)

    def heading(self, policy: str, domain: str) -> str:
        """Title of a column."""
        return f"{policy or 'Evaluated'} {WHERE[domain]}"


def read_mixed(sources: Sequence[str]) -> MixedTable:
    """Read what the table holds; nothing is written.

    Args:
        sources: Folders of runs or bundles, each alone where the run says what its policy was
            trained on, or as TRAINING=FOLDER or NAME/TRAINING=FOLDER with "sim", "real" or "mixed"
            for the training. Tasks of one training may come from several.
    """
    if not sources:
        raise EvaluationError("A mixed table needs a run.")
    found: dict[Place, list[RunPart]] = {}
    for source in sources:
        label, parts = read_named(source)
        name, _, given = label.rpartition("/")
        for part in parts:
            trained_on = given or part.candidate.trained_on
            if trained_on not in TRAININGS:
                raise EvaluationError(
                    f"What the policy of {source} was trained on is {trained_on or 'not known'!r}; "
                    f"it is one of {', '.join(TRAININGS)}. Name it: sim={source}, or "
                    f"ACT/sim={source}."
                )
            place = Place(name, trained_on, part.condition.domain)
            before = found.setdefault(place, [])
            for one in part.results.tasks:
                if not one.records:
                    raise EvaluationError(
                        f"{source} has no finished episode of {one.task.id}."
                    )
                if any(each.results.played(one.task.id) for each in before):
                    raise EvaluationError(
                        f"{source} is a second run of {one.task.id}, trained on {trained_on} and "
                        f"evaluated {WHERE[place.domain]}; name the policies: "
                        f"ACT/{trained_on}={source}."
                    )
            before.append(part)
    names = list(dict.fromkeys(place.policy for place in found))
    order = sorted(
        found, key=lambda p: (names.index(p.policy), TRAININGS.index(p.trained_on))
    )
    entrants = {
        place: entrant_of(_joined(found[place]), place.title) for place in order
    }
    rows = [
        row
        for row in table_rows(list(entrants.values()))
        if row.kind is not RowKind.CATEGORY
    ]
    return MixedTable(
        rows=tuple(rows), entrants=entrants, tests=tuple(_tests(entrants))
    )


def _joined(parts: Sequence[RunPart]) -> RunPart:
    """Several evaluations of one training, each on other tasks, as one."""
    first = parts[0]
    versions = {part.suite.version for part in parts}
    if len(versions) > 1:
        raise EvaluationError(
            f"{first.candidate.name} played different suites ({', '.join(sorted(versions))}), "
            "whose scores cannot be added up; take runs of one of them."
        )
    tasks = tuple(one.task for part in parts for one in part.results.tasks)
    run = replace(first.run, suite=replace(first.suite, tasks=tasks))
    records = [record for part in parts for record in part.records]
    return replace(first, run=run, results=summarize(tasks, records))


def _tests(entrants: dict[Place, Entrant]) -> Iterator[MixedTest]:
    for policy in dict.fromkeys(place.policy for place in entrants):
        for domain in DOMAINS:
            ours = [
                entrant
                for place, entrant in entrants.items()
                if (place.policy, place.domain) == (policy, domain)
            ]
            if len(ours) > 1:
                for pair in compare_entrants(lettered(ours)).pairs:
                    yield MixedTest(policy=policy, domain=domain, pair=pair)


def write_mixed(table: MixedTable, out: Path) -> Path:
    """Write the table as page, Markdown, CSV, LaTeX and JSON; an earlier one is replaced."""
    check_free(out, DOCUMENT, "mixed table")
    text = page(
        "mixed.html.j2", {}, table=table, text=_cell_text, test_heads=TEST_HEADS
    )
    contents = {
        DOCUMENT: _document(table),
        "mixed.md": markdown(table),
        "mixed.csv": _csv(table),
        "mixed.tex": _latex(table),
        PAGE: text,
    }
    return write_files(out, contents)


def _cell_text(score: Score) -> str:
    return tables.cell_text(Cell.of(score))


def markdown(table: MixedTable) -> str:
    """The table as Markdown, and that of the tests."""
    heads, rules = _heads(table), ["---", "---", *["---:"] * len(table.columns)]
    lines = [tables.md_row(cells) for cells in (heads, rules, *_cells(table))]
    what = "Success rate in percent, with mean final progress and the 95 % Wilson interval."
    if table.tests:
        lines += [
            "",
            tables.md_row(TEST_HEADS),
            tables.md_row("---" for _ in TEST_HEADS),
        ]
    for test in table.tests:
        lines += [tables.md_row(map(tables.md, line)) for line in test.lines()]
    return "\n".join([what, "", *lines]) + "\n"


def _latex(table: MixedTable) -> str:
    heads, *rows = (
        tables.tex_row(map(tables.tex, each))
        for each in (_heads(table), *_cells(table))
    )
    lines = [
        rf"\begin{{tabular}}{{ll{'c' * len(table.columns)}}}",
        r"\toprule",
        heads,
        r"\midrule",
        *rows,
        r"\bottomrule",
        r"\end{tabular}",
    ]
    return "\n".join(lines) + "\n"


def _heads(table: MixedTable) -> list[str]:
    return ["Task", "Trained on", *(table.heading(*column) for column in table.columns)]


def _cells(table: MixedTable) -> Iterable[list[str]]:
    for row, trained_on, found in table.lines():
        yield [
            row.label,
            trained_on,
            *("–" if each is None else _text(each) for each in found),
        ]


def _text(score: Score) -> str:
    return f"{_cell_text(score)}, {interval_percent(score)}, n = {score.episodes}"


def _scores(table: MixedTable) -> Iterator[tuple[str, Place, Score]]:
    """Every score of the table, with the task's id, or "all"."""
    for row in table.rows:
        name = row.tasks[0].id if row.kind is RowKind.TASK else "all"
        for place in table.entrants:
            found = table.score(row, place)
            if found is not None:
                yield name, place, found


def _csv(table: MixedTable) -> str:
    lines = [
        [
            task,
            *place,
            found.episodes,
            found.successes,
            *(
                f"{number:.6f}"
                for number in (found.success_rate or 0.0, *found.interval)
            ),
            f"{found.mean_final_progress or 0.0:.6f}",
        ]
        for task, place, found in _scores(table)
    ]
    return tables.csv_text([CSV_HEADER, *lines])


def _document(table: MixedTable) -> str:
    rows = [
        {
            "task": task,
            "policy": place.policy,
            "trained_on": place.trained_on,
            "evaluated_in": place.domain,
            **found.numbers(),
        }
        for task, place, found in _scores(table)
    ]
    tests = [
        {
            "policy": test.policy,
            "evaluated_in": test.domain,
            **tables.pair_json(test.pair),
            **{side: getattr(test.pair, side).title for side in ("a", "b")},
        }
        for test in table.tests
    ]
    overall = [row.tasks for row in table.rows if row.kind is RowKind.OVERALL]
    tasks = [task.id for each in overall for task in each]
    return json_text(
        {"schema": MIXED_SCHEMA, "all": tasks, "rows": rows, "tests": tests}
    )
