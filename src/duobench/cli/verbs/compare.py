"""`duobench compare`: which of several runs is better, and who can tell."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from duobench.cli.shared.advice import AdvisedError, advising, find_run
from duobench.cli.shared.console import console
from duobench.errors import DuoBenchError, OtherRunError

if TYPE_CHECKING:
    from duobench.results.scores import RunPart


def compare(runs: tyro.conf.Positional[tuple[str, ...]], out: Path, mixed: bool = False) -> None:
    """Compare runs: the paper's table, tests on the same episodes, figures, and one page.

    Args:
        runs: Folders of two or more runs (--out of duobench eval), each alone or as NAME=FOLDER to
            give it a name; FOLDER@SHIFT, such as runs/act@look-3, takes one condition. paper:ACT,
            paper:pi05 and paper:xvla show the paper's results beside them, which were measured
            elsewhere, on other tasks, and are tested against nothing.
        out: Folder of the comparison; an earlier one in it is replaced.
        mixed: Write the paper's mixed table in its place: trained on sim, real or mixed data,
            evaluated in simulation and on real arms. A run is named TRAINING=FOLDER or
            NAME/TRAINING=FOLDER, such as ACT/sim=runs/act, unless it says itself what its policy
            was trained on.
    """
    from duobench.results.entrants import split_name
    from duobench.results.paper import SCHEME

    for run in runs:
        if not run.startswith(SCHEME):
            find_run(split_name(run)[1])
    if mixed:
        _mixed(runs, out)
        return
    if _compare_shifts(runs, out):
        return
    from duobench.results.compare import compare as compare_runs
    from duobench.results.compare import write_comparison
    from duobench.results.tables import verdict

    comparison = compare_runs(runs)
    with advising(_for_comparing):
        page = write_comparison(comparison, out)
    screen = console()
    for pair in comparison.pairs:
        screen.print(verdict(pair))
        if pair.conditions:
            screen.print(f"  Not the policies alone differ: {'; '.join(pair.conditions)}.")
    screen.print(f"Comparison: {page}")


def _compare_shifts(runs: tuple[str, ...], out: Path) -> bool:
    """Lay evaluations under shifts over each other, if the runs are such; whether they are."""
    from duobench.results.entrants import read_named
    from duobench.results.paper import SCHEME
    from duobench.results.robustness import robustness_of, write_robustness

    read = {run: read_named(run) for run in runs if not run.startswith(SCHEME)}
    under_shifts = [run for run, (_, parts) in read.items() if _has_shifts(parts)]
    if not under_shifts:
        return False
    if others := [run for run in runs if run not in under_shifts]:
        raise AdvisedError(
            f"{others[0]} is not played under several shifts, as others are. Compare one of their "
            f"conditions with it, such as {under_shifts[0]}@none."
        )
    policies = [one for name, parts in read.values() for one in robustness_of(parts, name)]
    with advising(_for_comparing):
        page = write_robustness(policies, out)
    console().print(f"Comparison: {page}")
    return True


def _has_shifts(parts: list[RunPart]) -> bool:
    return len({part.condition.shift for part in parts}) > 1


def _for_comparing(error: DuoBenchError) -> str | None:
    return "Give --out another folder." if isinstance(error, OtherRunError) else None


def _mixed(runs: tuple[str, ...], out: Path) -> None:
    """Write the mixed table, and print it."""
    from duobench.results.mixed import markdown, read_mixed, write_mixed

    rows = read_mixed(runs)
    with advising(_for_comparing):
        page = write_mixed(rows, out)
    screen = console()
    screen.print(markdown(rows).rstrip())
    screen.print(f"Mixed table: {page}")
