"""The paper's mixed table: trained on simulated, real or mixed data, evaluated in both worlds.

It is a table of runs, not a test: runs in simulation and on real arms are different episodes, and
their intervals say how little few rollouts tell.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from duobench.errors import EvaluationError, OtherRunError
from duobench.files import make_folder, write
from duobench.pages import render
from duobench.results.comparison.entrants import Cell, split_name
from duobench.results.comparison.text import cell_text, interval_text
from duobench.results.metrics import score
from duobench.results.records import DOMAINS, REAL, SIM
from duobench.results.run import TRAININGS
from duobench.results.source import read_source
from duobench.results.suite import TaskInfo

DOCUMENT = "mixed.json"
"""The table for programs; a folder that has it holds one."""
WORDS = {SIM: "simulation", REAL: "real arms"}
CSV_HEADER = (
    *("task", "policy", "trained_on", "evaluated_in", "episodes", "successes", "success_rate"),
    *("wilson_low", "wilson_high", "mean_final_progress"),
)
"""Columns of the table as CSV."""


@dataclass(frozen=True, kw_only=True, slots=True)
class MixedRow:
    """One training of one policy on one task."""

    task: TaskInfo
    """The task."""
    policy: str
    """Name of the policy, the same for all of its trainings; may be empty."""
    trained_on: str
    """What it was trained on."""
    cells: dict[str, Cell]
    """What it reached, by where it was evaluated."""


def read_mixed(sources: Sequence[str]) -> tuple[MixedRow, ...]:
    """Read the runs of the table.

    Args:
        sources: Folders of runs or bundles, each alone where the run says what its policy was
            trained on, or as TRAINING=FOLDER or NAME/TRAINING=FOLDER with "sim", "real" or "mixed"
            for the training.

    Returns:
        Rows task by task, policy by policy, training by training.

    Raises:
        EvaluationError: A run says nothing about the training, has no episode, or two runs belong
            into the same cell.
        FileError: A record cannot be read.
    """
    if not sources:
        raise EvaluationError("A mixed table needs a run.")
    cells: dict[tuple[str, str, str], dict[str, Cell]] = {}
    tasks: dict[str, TaskInfo] = {}
    for source in sources:
        label, path = split_name(source)
        run, records = read_source(path)
        name, _, given = label.rpartition("/")
        trained_on = given or run.trained_on
        if trained_on not in TRAININGS:
            raise EvaluationError(
                f"What the policy of {path} was trained on is {trained_on or 'not known'!r}; it is "
                f"one of {', '.join(TRAININGS)}. Name it: sim={path}, or ACT/sim={path}."
            )
        for task in run.suite.tasks:
            played = [record for record in records if record.task == task.id]
            if not played:
                raise EvaluationError(f"{path} has no finished episode of {task.id}.")
            tasks.setdefault(task.id, task)
            row = cells.setdefault((task.id, name, trained_on), {})
            if run.domain in row:
                raise EvaluationError(
                    f"{path} is a second run of {task.id}, trained on {trained_on} and evaluated "
                    f"in {WORDS[run.domain]}; name the policies: ACT/{trained_on}={path}."
                )
            total = score("", played)
            row[run.domain] = Cell(
                episodes=total.episodes,
                successes=total.successes,
                rate=total.successes / total.episodes,
                interval=total.interval,
                progress=total.mean_final_progress or 0.0,
            )
    order = sorted(cells, key=lambda key: (*map(list(tasks).index, key[:1]), key[1], _rank(key[2])))
    return tuple(
        MixedRow(
            task=tasks[task], policy=name, trained_on=trained, cells=cells[task, name, trained]
        )
        for task, name, trained in order
    )


def write_mixed(rows: Sequence[MixedRow], out: Path) -> Path:
    """Write the table as page, Markdown, CSV, LaTeX and JSON.

    Args:
        rows: What `read_mixed` gave.
        out: Folder, which is made; an earlier table in it is replaced.

    Returns:
        The page.

    Raises:
        OtherRunError: The folder holds something else.
        OutputError: It cannot be written.
    """
    if not (out / DOCUMENT).exists() and out.is_dir() and any(out.iterdir()):
        raise OtherRunError(f"{out} is not empty and holds no mixed table.")
    make_folder(out)
    page = render(
        "duobench.results",
        "mixed.html.j2",
        rows=rows,
        domains=DOMAINS,
        words=WORDS,
        cell_text=cell_text,
        interval_text=interval_text,
    )
    for name, content in (
        (DOCUMENT, _document(rows)),
        ("mixed.md", markdown(rows)),
        ("mixed.csv", _csv(rows)),
        ("mixed.tex", _latex(rows)),
        ("index.html", page),
    ):
        write(out / name, content)
    return out / "index.html"


def markdown(rows: Sequence[MixedRow]) -> str:
    """The table as Markdown."""
    lines = [
        "Success rate in percent, with mean final progress and the 95 % Wilson interval.",
        "",
        f"| task | trained on | {' | '.join(f'evaluated in {WORDS[d]}' for d in DOMAINS)} |",
        f"| --- | --- |{' ---: |' * len(DOMAINS)}",
    ]
    lines += [
        f"| {row.task.title} | {_name(row)} | {' | '.join(_text(row, d) for d in DOMAINS)} |"
        for row in rows
    ]
    return "\n".join(lines) + "\n"


def _latex(rows: Sequence[MixedRow]) -> str:
    """The table as LaTeX; it needs the package booktabs."""
    heads = " & ".join(f"Evaluated in {WORDS[domain]}" for domain in DOMAINS)
    lines = [
        rf"\begin{{tabular}}{{ll{'c' * len(DOMAINS)}}}",
        r"\toprule",
        rf"Task & Trained on & {heads} \\",
        r"\midrule",
    ]
    for row in rows:
        cells = " & ".join(_text(row, domain).replace("–", "--") for domain in DOMAINS)
        name = _name(row).replace("_", r"\_").replace("&", r"\&")
        lines.append(rf"{row.task.title} & {name} & {cells} \\")
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}"]) + "\n"


def _csv(rows: Sequence[MixedRow]) -> str:
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(CSV_HEADER)
    for row in rows:
        for domain, cell in sorted(row.cells.items()):
            low, high = cell.interval or (0.0, 1.0)
            numbers = (cell.rate, low, high, cell.progress)
            writer.writerow(
                [
                    *(row.task.id, row.policy, row.trained_on, domain),
                    *(cell.episodes, cell.successes, *(f"{number:.6f}" for number in numbers)),
                ]
            )
    return buffer.getvalue()


def _document(rows: Sequence[MixedRow]) -> str:
    content = [
        {
            "task": row.task.id,
            "policy": row.policy,
            "trained_on": row.trained_on,
            "evaluated_in": {
                domain: {
                    "episodes": cell.episodes,
                    "successes": cell.successes,
                    "success_rate": round(cell.rate, 6),
                    "wilson_95": [round(end, 6) for end in cell.interval or ()],
                    "mean_final_progress": round(cell.progress, 6),
                }
                for domain, cell in sorted(row.cells.items())
            },
        }
        for row in rows
    ]
    return json.dumps({"schema": 1, "rows": content}, indent=2, ensure_ascii=False) + "\n"


def _text(row: MixedRow, domain: str) -> str:
    cell = row.cells.get(domain)
    if cell is None or cell.interval is None:
        return "–"
    return f"{cell_text(cell)}, {interval_text(cell.interval)}, n = {cell.episodes}"


def _name(row: MixedRow) -> str:
    return f"{row.policy}, {row.trained_on}" if row.policy else row.trained_on


def _rank(trained_on: str) -> int:
    return TRAININGS.index(trained_on)
