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
from duobench.results.statistics import LEVEL

COMPARISON_SCHEMA = 3
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
    "note",
)
"""Columns of the table as CSV, one line for each policy in each row."""


def rate_text(cell: Cell) -> str:
    """Success rate in percent: of a run with one digit, of the paper as it stands there."""
    return f"{100 * cell.rate:.0f}" if cell.interval is None else f"{100 * cell.rate:.1f}"


def progress_text(cell: Cell) -> str:
    """Mean final progress with two digits; a dash where it is not known."""
    return "–" if cell.progress is None else f"{cell.progress:.2f}"


def cell_text(cell: Cell | None, bold: str = "{}") -> str:
    """A cell of the paper's table, `44.0 (0.63)`; a dash where there is none."""
    return f"{bold.format(rate_text(cell))} ({progress_text(cell)})" if cell else "–"


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


def p_text(p: float) -> str:
    """A p-value with three digits."""
    return f"< {_SMALLEST}" if p < _SMALLEST else f"{p:.3f}"


def about(number: int) -> str:
    """A rough number: two digits of it, rounded up, with commas."""
    size = 10 ** max(0, len(str(number)) - 2)
    return f"{-(-number // size) * size:,}"


def listed(names: Sequence[str]) -> str:
    """Names in a row of words."""
    *first, last = names
    return f"{', '.join(first)} and {last}" if first else last


def verdict(pair: Pair) -> str:
    """What the tests say about two runs, in a sentence."""
    a, b = pair.a.name, pair.b.name
    if pair.obstacle:
        return f"{a} and {b} are not compared. {pair.obstacle}"
    if pair.is_same:
        return (
            f"{a} and {b} have the same records: one run, a copy of it, or the same played again."
        )
    tests = pair.of(RowKind.TASK)
    # Of another group, better is not the word: it knows what the other one has to see.
    beats = "solves more than" if pair.crosses_groups else "is better than"
    found: list[str] = []
    for better, who, other in ((1, a, b), (-1, b, a)):
        won = [test.row.label for test in tests if test.better == better]
        if won:
            found.append(f"{who} {beats} {other} in {_share(won, tests)}")
    if not found:
        found.append(f"{a} and {b} cannot be told apart in {_share([], tests)}")
    overall = pair.of(RowKind.OVERALL)
    more = (overall or tests)[0].more_episodes if len(tests) == 1 or overall else None
    of = " of all tasks together" if overall else ""
    would = f"; about {about(more)} more episodes{of} would tell, another look" if more else ""
    numbers = f": {numbers_text(tests[0])}" if len(tests) == 1 else ""
    return f"{'; '.join(found)}{numbers}{would}."


def wins(pair: Pair) -> str:
    """In how many tasks either run of a pair solves more, by their letters; or nothing."""
    if pair.obstacle:
        return "not compared"
    if pair.is_same:
        return "the same records"
    tests = pair.of(RowKind.TASK)
    won = {pair.a.key: 1, pair.b.key: -1}
    counts = {key: sum(test.better == better for test in tests) for key, better in won.items()}
    found = [f"{key} in {count}" for key, count in counts.items() if count]
    return f"{', '.join(found)} of {len(tests)}" if found else ""


def any_time(pair: Pair) -> str:
    """What holds of two runs on the same episodes at every look, in a sentence."""
    tests = pair.of(RowKind.TASK)
    claimed = [test.row.label for test in tests if test.is_any_time]
    where = f"a difference in {listed(claimed)}" if claimed else "no difference"
    return f"If this is not the first look, the any-time p-value counts: it claims {where}."


def _share(won: Sequence[str], tests: Sequence[Test]) -> str:
    if len(tests) == 1:
        return tests[0].row.label
    if not won:
        return f"any of {len(tests)} tasks after Holm"
    return f"{len(won)} of {len(tests)} tasks after Holm ({listed(won)})"


def numbers_text(test: Test) -> str:
    """The numbers of a test of success, in words."""
    (ours, theirs), (n, m) = test.successes, test.episodes
    counts = f"{ours} of {n:,} episodes against {theirs} of {m:,}"
    interval = points_interval_text(test.interval)
    p = f"p = {p_text(test.p)}".replace("= <", "<")
    return f"{counts}, {points_text(test.difference)} points (95 % {interval}, {p})"


def markdown(comparison: RunComparison) -> str:
    """The table as Markdown."""
    lines = ["Success rate in percent, with mean final progress (highest stage / last stage).", ""]
    for group, members in comparison.groups:
        lines.append(f"- {group}: {', '.join(f'{one.key} {_md(one.name)}' for one in members)}")
    names = [f"{_md(one.name)} ({one.group.note})" for one in comparison.entrants]
    lines += ["", md_row(["task", *names]), md_row(["---", *["---:"] * len(names)])]
    for category, rows in sections(comparison.rows):
        if category:
            lines.append(md_row([f"*{_md(category)}*", *[""] * len(names)]))
        lines += [md_row(_cells(comparison, row, _md, "**{}**")) for row in rows]
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
            lines.append(rf"\multicolumn{{{len(columns)}}}{{l}}{{\textit{{{heading}}}}} \\")
        lines += [tex_row(_cells(comparison, row, tex, r"\textbf{{{}}}")) for row in rows]
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
            interval = [f"{end:.6g}" for end in cell.interval] if cell.interval else ["", ""]
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
    """What bold means, and what is not compared."""
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


def _md(text: str) -> str:
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
    return named | one.part.facts(*_FACTS) if one.part else named


def _row(row: TableRow) -> dict[str, Any]:
    return {"kind": row.kind.value, "label": row.label, "tasks": [task.id for task in row.tasks]}


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
    """What tests say about two runs, for programs."""
    return {
        "a": pair.a.key,
        "b": pair.b.key,
        "paired": pair.paired,
        "crosses_groups": pair.crosses_groups,
        "not_tested_because": pair.obstacle,
        "episodes_left_out": pair.left_out,
        "same_records": pair.is_same,
        "conditions_that_differ": list(pair.conditions),
        "verdict": verdict(pair),
        "tests": [_test(test, pair.paired) for test in pair.tests],
    }


def _test(test: Test, paired: bool) -> dict[str, Any]:
    return {
        **_row(test.row),
        "test": "McNemar, exact" if paired else "Barnard",
        "episodes": list(test.episodes),
        "successes": list(test.successes),
        "only_one_solved": test.only and list(test.only),
        "difference": _short(test.difference),
        "interval_95": [_short(end) for end in test.interval],
        "interval": "Tango" if paired else "Newcombe",
        "cohen_h": _short(test.effect),
        "p": _short(test.p),
        "p_holm": _short(test.adjusted),
        "p_any_time": _short(test.any_time) if paired else None,
        "p_any_time_holm": _short(test.any_time_adjusted) if paired else None,
        "any_time_episodes": test.any_time_episodes if paired else None,
        "progress_difference": _short(test.progress),
        "progress_p": _short(test.progress_p),
        "progress_p_holm": _short(test.progress_adjusted),
        "better": {1: "a", -1: "b", 0: None}[test.better],
        "more_episodes": test.more_episodes,
    }


def _short(value: float) -> float:
    """A number with six digits, for files."""
    return float(f"{value:.6g}")
