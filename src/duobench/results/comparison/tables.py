"""The paper's table in the formats that people put into a page, a spreadsheet or a paper."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence

from duobench.results.comparison.comparison import Comparison
from duobench.results.comparison.entrants import Entrant, Group
from duobench.results.comparison.paper import paper_results
from duobench.results.comparison.rows import Kind, Row, category_of, sections
from duobench.results.comparison.text import cell_text, progress_text, rate_text

_LATEX: Mapping[str, str] = {
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
CSV_HEADER = (
    *("kind", "category", "row", "key", "name", "group", "policy_version", "suite_version"),
    *("episodes", "successes", "success_rate", "wilson_low", "wilson_high"),
    *("mean_final_progress", "best_of_group", "note"),
)
"""Columns of the table as CSV, one line for each policy in each row."""


def markdown(comparison: Comparison) -> str:
    """The table as Markdown."""
    lines = ["Success rate in percent, with mean final progress (highest stage / last stage).", ""]
    for group, members in comparison.groups:
        lines.append(f"- {group}: {', '.join(f'{one.key} {_md(one.name)}' for one in members)}")
    names = [f"{_md(one.name)} ({one.group.note})" for one in comparison.entrants]
    lines += ["", _md_row(["task", *names]), _md_row(["---", *["---:"] * len(names)])]
    for category, rows in sections(comparison.rows):
        if category:
            lines.append(_md_row([f"*{_md(category)}*", *[""] * len(names)]))
        for row in rows:
            cells = [_md_cell(comparison, row, one) for one in comparison.entrants]
            label = _md(row.label) if row.kind is Kind.TASK else f"**{_md(row.label)}**"
            lines.append(_md_row([label, *cells]))
    return "\n".join([*lines, "", caption(comparison)]) + "\n"


def latex(comparison: Comparison) -> str:
    """The table as LaTeX; it needs the package booktabs."""
    columns = "l" + "c" * len(comparison.entrants)
    heads, rules, first = [], [], 2
    for group, members in comparison.groups:
        last = first + len(members) - 1
        heads.append(rf"\multicolumn{{{len(members)}}}{{c}}{{{_tex(group)}}}")
        rules.append(rf"\cmidrule(lr){{{first}-{last}}}")
        first = last + 1
    what = f"Success rate (%) with mean final progress in parentheses. {caption(comparison)}"
    lines = [
        r"\begin{table}[t]",
        r"\centering",
        rf"\caption{{{_tex(what)}}}",
        rf"\begin{{tabular}}{{{columns}}}",
        r"\toprule",
        _tex_row(["", *heads]),
        "".join(rules),
        _tex_row(["Task", *(_tex(one.name) for one in comparison.entrants)]),
        r"\midrule",
    ]
    for number, (category, rows) in enumerate(sections(comparison.rows)):
        if number:
            lines.append(r"\addlinespace" if category else r"\midrule")
        if category:
            heading = _tex(category[:1].upper() + category[1:])
            lines.append(rf"\multicolumn{{{len(columns)}}}{{l}}{{\textit{{{heading}}}}} \\")
        for row in rows:
            cells = [_tex_cell(comparison, row, one) for one in comparison.entrants]
            label = _tex(row.label)
            lines.append(
                _tex_row([label if row.kind is Kind.TASK else rf"\textbf{{{label}}}", *cells])
            )
    lines += [r"\bottomrule", r"\end{tabular}", r"\end{table}"]
    return "\n".join(lines) + "\n"


def csv_text(comparison: Comparison) -> str:
    """The table as CSV, one line for each policy in each row, with `CSV_HEADER`."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(CSV_HEADER)
    for row in comparison.rows:
        for one in comparison.entrants:
            if (cell := one.cell(row.tasks)) is None:
                continue
            low, high = cell.interval or ("", "")
            rate = f"{cell.rate:.6g}" if cell.interval else f"{cell.rate:.2f}"
            note = "" if one.run else Group.ELSEWHERE.value
            writer.writerow(
                [
                    *(row.kind, category_of(row), _name_of(row), one.key, one.name, one.group),
                    one.run.metadata.version or "" if one.run else "",
                    one.run.suite.version if one.run else "",
                    cell.episodes,
                    "" if cell.successes is None else cell.successes,
                    rate,
                    *(f"{end:.6g}" if cell.interval else "" for end in (low, high)),
                    f"{cell.progress:.6g}" if cell.interval else f"{cell.progress:.2f}",
                    int(comparison.is_best(row, one)),
                    note,
                ]
            )
    return buffer.getvalue()


def caption(comparison: Comparison) -> str:
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
        text += f" {Group.ELSEWHERE}: quoted from {paper_results().source}; nothing is tested."
    return text


def _name_of(row: Row) -> str:
    return row.tasks[0].id if row.kind is Kind.TASK else row.label


def _md_cell(comparison: Comparison, row: Row, entrant: Entrant) -> str:
    cell = entrant.cell(row.tasks)
    if cell and comparison.is_best(row, entrant):
        return f"**{rate_text(cell)}** ({progress_text(cell)})"
    return cell_text(cell)


def _md_row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _md(text: str) -> str:
    """Text that Markdown shows as it is."""
    for char in "\\`*_[]<>|":
        text = text.replace(char, f"\\{char}")
    return text


def _tex_cell(comparison: Comparison, row: Row, entrant: Entrant) -> str:
    cell = entrant.cell(row.tasks)
    if cell and comparison.is_best(row, entrant):
        return rf"\textbf{{{rate_text(cell)}}} ({progress_text(cell)})"
    return _tex(cell_text(cell))


def _tex_row(cells: Sequence[str]) -> str:
    return " & ".join(cells) + r" \\"


def _tex(text: str) -> str:
    """Text that LaTeX shows as it is."""
    return "".join(_LATEX.get(char, char) for char in text)
