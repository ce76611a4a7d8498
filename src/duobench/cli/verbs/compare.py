"""`duobench compare`: which of several runs is better, and who can tell."""

from __future__ import annotations

from pathlib import Path

import tyro

from duobench.cli.shared.advice import AdvisedError, advising, conditions_of, find_runs
from duobench.cli.shared.console import console
from duobench.errors import DuoBenchError, OtherRunError


def compare(runs: tyro.conf.Positional[tuple[str, ...]], out: Path, mixed: bool = False) -> None:
    """Compare runs: the paper's table, tests on the same episodes, figures, and one page.

    Args:
        runs: Folders of two or more runs (--out of duobench eval), each alone or as NAME=FOLDER to
            give it a name; of a run in shards, the folder that they lie in. paper:ACT, paper:pi05
            and paper:xvla show the paper's results beside them, which were measured elsewhere, on
            other tasks, and are tested against nothing.
        out: Folder of the comparison; an earlier one in it is replaced.
        mixed: Write the paper's mixed table in its place: trained on sim, real or mixed data,
            evaluated in simulation and on real arms. A run is named TRAINING=FOLDER or
            NAME/TRAINING=FOLDER, such as ACT/sim=runs/act, unless it says itself what its policy
            was trained on.
    """
    from duobench.results.comparison.entrants import split_name
    from duobench.results.comparison.paper import SCHEME

    for run in runs:
        path = split_name(run)[1]
        if not run.startswith(SCHEME):
            find_runs([path])
    if mixed:
        _mixed(runs, out)
        return
    if _compare_conditions(runs, out):
        return
    from duobench.results.compare import compare as compare_runs
    from duobench.results.compare import write_comparison
    from duobench.results.comparison import words

    comparison = compare_runs(runs)
    with advising(_for_comparing):
        page = write_comparison(comparison, out)
    screen = console()
    for pair in comparison.pairs:
        screen.print(f"{pair.a.name} against {pair.b.name}:")
        for line in (*words.caution(pair), words.verdict(pair), words.overall(pair)):
            if line:
                screen.print(f"  {line}")
    screen.print(f"Comparison: {page}")


def _compare_conditions(runs: tuple[str, ...], out: Path) -> bool:
    """Lay evaluations under shifts over each other, if the runs are such; whether they are."""
    from duobench.results.comparison.entrants import split_name
    from duobench.results.robustness.conditions import read_robustness
    from duobench.results.robustness.report import write_robustness

    named = [split_name(run) for run in runs]
    found = [bool(conditions_of(path)) for _, path in named]
    if not any(found):
        return False
    if not all(found):
        other = named[found.index(False)][1]
        raise AdvisedError(
            f"{other} is no folder of the suite robust, as others are. Compare one of their "
            f"conditions with it, such as {named[found.index(True)][1] / 'none'}."
        )
    with advising(_for_comparing):
        page = write_robustness([read_robustness(path, name) for name, path in named], out)
    console().print(f"Comparison: {page}")
    return True


def _for_comparing(error: DuoBenchError) -> str | None:
    return "Give --out another folder." if isinstance(error, OtherRunError) else None


def _mixed(runs: tuple[str, ...], out: Path) -> None:
    """Write the mixed table, and print it."""
    from duobench.results.comparison.mixed import markdown, read_mixed, write_mixed

    rows = read_mixed(runs)
    with advising(_for_comparing):
        page = write_mixed(rows, out)
    screen = console()
    screen.print(markdown(rows).rstrip())
    screen.print(f"Mixed table: {page}")
