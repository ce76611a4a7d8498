"""Tables: numbers as text, and the paper's table for a page, a spreadsheet, a paper, a program."""

import csv
import io
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from duobench.results.entrants import (
    Cell,
    Entrant,
    Group,
    RowKind,
    TableRow,
    sections,
    sources_of,
)
from duobench.results.pages import json_text
from duobench.results.pairs import Pair, RunComparison, Test
from duobench.results.scores import percent, progress_text
from duobench.results.statistics import LEVEL

COMPARISON_SCHEMA = 4
MINUS = "\N{MINUS SIGN}"
_SMALLEST = 0.001  # p-values below are not told apart
_LATEX = str.maketrans(
    {
        **{char: f"\\{char}" for char in "&%$#_{}"},
        "\\": r"\textbackslash{}",
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        "<": r"\textless{}",
        ">": r"\textgreater{}",
        "π": r"$\pi$",
        "–": "--",
        "“": "``",
        "”": "''",
    }
)
_MARKDOWN = str.maketrans({char: f"\\{char}" for char in "\\`*_[]<>|"})
CSV_HEADER = (
    "kind",
    "category",
    "row",
    "key",
    "name",
    "group",
    "policy_version",
    "suite_version",
    "episodes",
    "successes",
    "success_rate",
    "wilson_low",
    "wilson_high",
    "mean_final_progress",
    "best_of_group",
    "verified",
    "verification",
    "note",
)
"""Columns of the table as CSV, one line for each policy in each row."""


def cell_rate(cell: Cell) -> str:
    """Success rate as per cent; a rate of the paper has no digit more than it has there."""
    return percent(cell.rate, digits=0 if cell.interval is None else 1)


def cell_text(cell: Cell | None, bold: str = "{}") -> str:
    """A cell of the paper's table, `44.0 (0.63)`; a dash for None."""
    if cell is None:
        return "–"
    return f"{bold.format(cell_rate(cell))} ({progress_text(cell.progress)})"


def points_text(difference: float) -> str:
    """A difference of rates in percentage points, with its sign."""
    return signed(100 * difference, 1)


def points_interval_text(interval: tuple[float, float]) -> str:
    """An interval of a difference in percentage points."""
    return " to ".join(map(points_text, interval))


def signed(value: float, digits: int) -> str:
    """A number with its sign, a real minus; what rounds to 0 has none."""
    text = f"{value:+.{digits}f}"
    return text.replace("-", MINUS) if float(text) else text[1:]


def p_text(p: float | None) -> str:
    """P-value with three digits; a dash for None."""
    if p is None:
        return "–"
    return f"< {_SMALLEST}" if p < _SMALLEST else f"{p:.3f}"


def listed(names: Sequence[str]) -> str:
    """Names in a row of words."""
    *first, last = names
    return f"{', '.join(first)} and {last}" if first else last


def episodes_text(pair: Pair) -> str:
    """Compared episodes of a pair, or the reason why none are."""
    if pair.obstacle:
        return pair.obstacle
    if pair.is_same:
        return "same records"
    return "same episodes" if pair.paired else "different episodes"


PAIR_HEADS = (
    "First",
    "Second",
    "Compared by",
    "Tasks won",
    "Difference / points",
    "95 % interval / points",
    "p",
    "Episodes that would tell",
    "Other differences",
)
"""Columns of the table of pairs; the numbers are of all tasks together, or of the only one."""


def pair_cells(pair: Pair) -> list[str]:
    """Cells of a pair in the table of pairs."""
    whole = pair.whole
    tasks = len(pair.of(RowKind.TASK))
    return [
        pair.a.name,
        pair.b.name,
        episodes_text(pair),
        f"{_two(pair.won)} of {tasks}" if pair.paired else "–",
        points_text(whole.difference) if whole else "–",
        points_interval_text(whole.interval) if whole else "–",
        p_text(whole.adjusted if whole else None),
        count_text(whole.more_episodes if whole else None),
        "; ".join(pair.conditions) or "–",
    ]


TEST_HEADS = (
    "Task",
    "Episodes",
    "Successes",
    "Only one solved",
    "Difference / points",
    "95 % interval / points",
    "p, Holm",
    "Episodes that would tell",
    "Progress, difference",
)
"""Columns of the table of tests; two numbers are those of the first and of the second run."""


def test_cells(test: Test) -> list[str]:
    """A row of the table of tests."""
    return [
        test.row.label,
        _two(test.episodes),
        _two(test.successes),
        _two(test.only) if test.only else "–",
        points_text(test.difference),
        points_interval_text(test.interval),
        p_text(test.adjusted),
        count_text(test.more_episodes),
        signed(test.progress, 2),
    ]


def count_text(number: int | None) -> str:
    """Number of episodes; a dash for None."""
    return "–" if number is None else f"{number:,}"


def _two(numbers: tuple[int, int]) -> str:
    return f"{numbers[0]:,} / {numbers[1]:,}"


def markdown(comparison: RunComparison) -> str:
    """The table as Markdown."""
    lines = [
        "Success rate in percent, with mean final progress (highest stage / last stage).",
        "",
    ]
    for group, members in comparison.groups:
        lines.append(
            f"- {group}: {', '.join(f'{one.key} {md(one.name)}' for one in members)}"
        )
    names = [f"{md(one.name)} ({one.group.note})" for one in comparison.entrants]
    lines += ["", md_row(["task", *names]), md_row(["---", *["---:"] * len(names)])]
    for category, rows in sections(comparison.rows):
        if category:
            lines.append(md_row([f"*{md(category)}*", *[""] * len(names)]))
        lines += [md_row(_cells(comparison, row, md, "**{}**")) for row in rows]
    lines.append(md_row(_verified(comparison, "–")))
    return "\n".join([*lines, "", caption(comparison)]) + "\n"


def latex(comparison: RunComparison) -> str:
    """The table as LaTeX; it needs the package booktabs."""
    columns = "l" + "c" * len(comparison.entrants)
    heads: list[str] = []
    rules: list[str] = []
    first = 2
    for group, members in comparison.groups:
        last = first + len(members) - 1
        heads.append(rf"\multicolumn{{{len(members)}}}{{c}}{{{tex(group)}}}")
        rules.append(rf"\cmidrule(lr){{{first}-{last}}}")
        first = last + 1
    what = f"Success rate (%) with mean final progress in parentheses. {caption(comparison)}"
    lines = [
        r"\begin{table}[t]",
        r"\centering",
        rf"\caption{{{tex(what)}}}",
        rf"\begin{{tabular}}{{{columns}}}",
        r"\toprule",
        tex_row(["", *heads]),
        "".join(rules),
        tex_row(["Task", *(tex(one.name) for one in comparison.entrants)]),
        r"\midrule",
    ]
    for number, (category, rows) in enumerate(sections(comparison.rows)):
        if number:
            lines.append(r"\addlinespace" if category else r"\midrule")
        if category:
            heading = tex(category[:1].upper() + category[1:])
            lines.append(
                rf"\multicolumn{{{len(columns)}}}{{l}}{{\textit{{{heading}}}}} \\"
            )
        lines += [
            tex_row(_cells(comparison, row, tex, r"\textbf{{{}}}")) for row in rows
        ]
    lines += [r"\midrule", tex_row(_verified(comparison, "--"))]
    lines += [r"\bottomrule", r"\end{tabular}", r"\end{table}"]
    return "\n".join(lines) + "\n"


def _cells(
    comparison: RunComparison, row: TableRow, escape: Callable[[str], str], bold: str
) -> list[str]:
    """The cells of a row: what stands for several tasks, and rates of the best, are bold."""
    label = escape(row.label)
    cells = [label if row.kind is RowKind.TASK else bold.format(label)]
    for one in comparison.entrants:
        cell = one.cell(row.tasks)
        style = bold if cell and comparison.is_best(row, one) else "{}"
        cells.append(cell_text(cell, style) if cell else escape("–"))
    return cells


def _verified(comparison: RunComparison, dash: str) -> list[str]:
    """Return the cells of the last row: whether the records of each policy were verified."""
    found = [one.check.verified if one.part else dash for one in comparison.entrants]
    return ["Verified", *found]


def csv_rows(comparison: RunComparison) -> list[list[object]]:
    """The table for a spreadsheet, one line for each policy in each row, below `CSV_HEADER`."""
    lines: list[list[object]] = [[*CSV_HEADER]]
    for row in comparison.rows:
        name = row.tasks[0].id if row.kind is RowKind.TASK else row.label
        for one in comparison.entrants:
            cell = one.cell(row.tasks)
            if cell is None:
                continue
            part, digits = one.part, ".6g" if cell.interval else ".2f"
            interval = (
                [f"{end:.6g}" for end in cell.interval] if cell.interval else ["", ""]
            )
            lines.append(
                [
                    row.kind,
                    row.category,
                    name,
                    one.key,
                    one.name,
                    one.group,
                    part.candidate.metadata.version or "" if part else "",
                    part.suite.version if part else "",
                    cell.episodes,
                    "" if cell.successes is None else cell.successes,
                    f"{cell.rate:{digits}}",
                    *interval,
                    "" if cell.progress is None else f"{cell.progress:{digits}}",
                    int(comparison.is_best(row, one)),
                    one.check.verified if part else "",
                    one.check.details,
                    "" if part else Group.ELSEWHERE.value,
                ]
            )
    return lines


def csv_text(lines: Iterable[Iterable[object]]) -> str:
    """Lines of a table as CSV."""
    buffer = io.StringIO()
    csv.writer(buffer, lineterminator="\n").writerows(lines)
    return buffer.getvalue()


def caption(comparison: RunComparison) -> str:
    """Caption: the meaning of bold, and entrants that are not compared."""
    text = (
        "Bold: better than every other policy of its group, by tests at 5 % after Holm's "
        "adjustment over the tasks."
    )
    if any(row.label.endswith(("common)", "common tasks")) for row in comparison.rows):
        text += " Rows over several tasks cover those that every run has."
    groups = [group for group, _ in comparison.groups]
    if Group.PRIVILEGED in groups:
        text += " Privileged policies know where the objects are from the simulation."
    if Group.ELSEWHERE in groups:
        quoted = listed(sources_of(comparison.entrants))
        text += f" {Group.ELSEWHERE}: quoted from {quoted}; nothing is tested."
    return text


def md(text: str) -> str:
    """Text that Markdown shows as it is."""
    return text.translate(_MARKDOWN)


def md_row(cells: Iterable[str]) -> str:
    """A row of Markdown."""
    return f"| {' | '.join(cells)} |"


def tex(text: str) -> str:
    """Text that LaTeX shows as it is."""
    return text.translate(_LATEX)


def tex_row(cells: Iterable[str]) -> str:
    """A row of LaTeX."""
    return " & ".join(cells) + r" \\"


def comparison_json(comparison: RunComparison) -> str:
    """The comparison as JSON text, numbers with six digits."""
    content = {
        "schema": COMPARISON_SCHEMA,
        "level": round(LEVEL, 6),
        "policies": {one.key: _entrant(one) for one in comparison.entrants},
        "rows": [
            {
                **_row(row),
                "results": {
                    one.key: _cell(cell, comparison.is_best(row, one))
                    for one in comparison.entrants
                    if (cell := one.cell(row.tasks))
                },
            }
            for row in comparison.rows
        ],
        "pairs": [pair_json(pair) for pair in comparison.pairs],
    }
    return json_text(content)


_FACTS = (
    "policy",
    "policy_name",
    "policy_version",
    "privileged",
    "repeatable",
    "domain",
    "trained_on",
    "suite_version",
    "look",
    "robot",
    "shift",
    "first_episode",
    "expected_episodes",
    "suite",
    "execute",
    "latency",
    "versions",
)


def _entrant(one: Entrant) -> dict[str, Any]:
    named = {"name": one.name, "group": one.group.value}
    if one.part is None:
        return named
    check = {"verified": one.check.verified, "verification": one.check.details}
    return named | one.part.facts(*_FACTS) | check


def _row(row: TableRow) -> dict[str, Any]:
    return {
        "kind": row.kind.value,
        "label": row.label,
        "tasks": [task.id for task in row.tasks],
    }


def _cell(cell: Cell, is_best: bool) -> dict[str, Any]:
    return {
        "episodes": cell.episodes,
        "successes": cell.successes,
        "success_rate": _short(cell.rate),
        "wilson_95": cell.interval and [_short(end) for end in cell.interval],
        "mean_final_progress": None if cell.progress is None else _short(cell.progress),
        "best_of_group": is_best,
    }


def pair_json(pair: Pair) -> dict[str, Any]:
    """Results of tests of two runs, for programs."""
    return {
        "a": pair.a.key,
        "b": pair.b.key,
        "paired": pair.paired,
        "crosses_groups": pair.crosses_groups,
        "not_tested_because": pair.obstacle,
        "episodes_left_out": pair.left_out,
        "same_records": pair.is_same,
        "conditions_that_differ": list(pair.conditions),
        "tests": [_test(test, pair.paired) for test in pair.tests],
    }


def _test(test: Test, paired: bool) -> dict[str, Any]:
    return {
        **_row(test.row),
        "test": "McNemar, exact" if paired else None,
        "episodes": list(test.episodes),
        "successes": list(test.successes),
        "only_one_solved": test.only and list(test.only),
        "difference": _short(test.difference),
        "interval_95": [_short(end) for end in test.interval],
        "interval": "Tango" if paired else "Newcombe",
        "p": None if test.p is None else _short(test.p),
        "p_holm": None if test.adjusted is None else _short(test.adjusted),
        "better": {1: "a", -1: "b", 0: None}[test.better],
        "episodes_that_would_tell": test.more_episodes,
        "progress_difference": _short(test.progress),
    }


def _short(value: float) -> float:
    """A number with six digits, for files."""
    return float(f"{value:.6g}")
