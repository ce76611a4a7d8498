"""The paper's mixed table: trained on simulated, real or mixed data, evaluated in both worlds.

It is a table of runs, not a test: runs in simulation and on real arms are different episodes, and
their intervals say how little few rollouts tell.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from duobench.errors import EvaluationError
from duobench.results import tables
from duobench.results.entrants import Cell, read_named
from duobench.results.pages import PAGE, check_free, json_text, page, write_files
from duobench.results.records import DOMAINS, REAL, SIM
from duobench.results.run import TRAININGS
from duobench.results.scores import Score, interval_percent
from duobench.results.suite import TaskInfo

DOCUMENT = "mixed.json"
"""The table for programs; a folder that has it holds one."""
WORDS = {SIM: "simulation", REAL: "real arms"}
CSV_HEADER = (
    *("task", "policy", "trained_on", "evaluated_in", "episodes", "successes", "success_rate"),
    *("wilson_low", "wilson_high", "mean_final_progress"),
)


@dataclass(frozen=True, kw_only=True, slots=True)
class MixedRow:
    """One training of one policy on one task."""

    task: TaskInfo
    policy: str
    """Name of the policy, the same for all of its trainings; may be empty."""
    trained_on: str
    scores: dict[str, Score]
    """What it reached, by where it was evaluated."""


def read_mixed(sources: Sequence[str]) -> tuple[MixedRow, ...]:
    """Read the rows of the table, task by task, policy by policy, training by training.

    Args:
        sources: Folders of runs or bundles, each alone where the run says what its policy was
            trained on, or as TRAINING=FOLDER or NAME/TRAINING=FOLDER with "sim", "real" or "mixed"
            for the training.
    """
    if not sources:
        raise EvaluationError("A mixed table needs a run.")
    found: dict[tuple[str, str, str], MixedRow] = {}
    tasks: dict[str, TaskInfo] = {}
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
            domain = part.condition.domain
            for one in part.results.tasks:
                if not one.records:
                    raise EvaluationError(f"{source} has no finished episode of {one.task.id}.")
                task = tasks.setdefault(one.task.id, one.task)
                new = MixedRow(task=task, policy=name, trained_on=trained_on, scores={})
                scores = found.setdefault((task.id, name, trained_on), new).scores
                if domain in scores:
                    raise EvaluationError(
                        f"{source} is a second run of {task.id}, trained on {trained_on} and "
                        f"evaluated in {WORDS[domain]}; name the policies: "
                        f"ACT/{trained_on}={source}."
                    )
                scores[domain] = one.score
    ids = list(tasks)
    order = sorted(found, key=lambda key: (ids.index(key[0]), key[1], TRAININGS.index(key[2])))
    return tuple(found[key] for key in order)


def write_mixed(rows: Sequence[MixedRow], out: Path) -> Path:
    """Write the table as page, Markdown, CSV, LaTeX and JSON; an earlier one is replaced."""
    check_free(out, DOCUMENT, "mixed table")
    text = page("mixed.html.j2", {}, rows=rows, domains=DOMAINS, words=WORDS, text=_cell_text)
    contents = {
        DOCUMENT: _document(rows),
        "mixed.md": markdown(rows),
        "mixed.csv": _csv(rows),
        "mixed.tex": _latex(rows),
        PAGE: text,
    }
    return write_files(out, contents)


def _cell_text(score: Score) -> str:
    return tables.cell_text(Cell.of(score))


def markdown(rows: Sequence[MixedRow]) -> str:
    """The table as Markdown."""
    heads = ["task", "trained on", *(f"evaluated in {WORDS[domain]}" for domain in DOMAINS)]
    rules = ["---", "---", *["---:"] * len(DOMAINS)]
    lines = [tables.md_row(cells) for cells in (heads, rules, *map(_cells, rows))]
    what = "Success rate in percent, with mean final progress and the 95 % Wilson interval."
    return "\n".join([what, "", *lines]) + "\n"


def _latex(rows: Sequence[MixedRow]) -> str:
    heads = ["Task", "Trained on", *(f"Evaluated in {WORDS[domain]}" for domain in DOMAINS)]
    lines = [
        rf"\begin{{tabular}}{{ll{'c' * len(DOMAINS)}}}",
        r"\toprule",
        tables.tex_row(heads),
        r"\midrule",
        *(tables.tex_row(map(tables.tex, _cells(row))) for row in rows),
        r"\bottomrule",
        r"\end{tabular}",
    ]
    return "\n".join(lines) + "\n"


def _cells(row: MixedRow) -> list[str]:
    name = f"{row.policy}, {row.trained_on}" if row.policy else row.trained_on
    found = (row.scores.get(domain) for domain in DOMAINS)
    return [row.task.title, name, *("–" if score is None else _text(score) for score in found)]


def _text(score: Score) -> str:
    return f"{_cell_text(score)}, {interval_percent(score)}, n = {score.episodes}"


def _csv(rows: Sequence[MixedRow]) -> str:
    lines = [
        [
            *(row.task.id, row.policy, row.trained_on, domain, score.episodes, score.successes),
            *(f"{number:.6f}" for number in (score.success_rate or 0.0, *score.interval)),
            f"{score.mean_final_progress or 0.0:.6f}",
        ]
        for row in rows
        for domain, score in sorted(row.scores.items())
    ]
    return tables.csv_text([CSV_HEADER, *lines])


def _document(rows: Sequence[MixedRow]) -> str:
    content = [
        {
            "task": row.task.id,
            "policy": row.policy,
            "trained_on": row.trained_on,
            "evaluated_in": {
                domain: score.numbers() for domain, score in sorted(row.scores.items())
            },
        }
        for row in rows
    ]
    return json_text({"schema": 2, "rows": content})
