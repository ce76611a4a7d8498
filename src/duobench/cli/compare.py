"""`duobench compare`: runs beside each other."""

from __future__ import annotations

from pathlib import Path

import tyro

from duobench.cli.shared.advice import OTHER_OUT, AdvisedError, advising, find_run
from duobench.cli.shared.console import say
from duobench.core.files import check_outside
from duobench.results.entrants import SCHEMES, read_named, split_name


def run(
    runs: tyro.conf.Positional[tuple[str, ...]], out: Path, mixed: bool = False
) -> None:
    """Compare runs: the paper's table, tests on the same episodes, figures, and one page.

    Args:
        runs: Folders of two or more runs (--out of duobench eval), each alone or as NAME=FOLDER to
            give it a name; FOLDER@SHIFT, such as runs/act@look-3, takes one condition. paper:ACT,
            paper:pi05 and paper:xvla show the paper's results beside them, authors:ACT,
            authors:pi05 and authors:xvla those of the authors' published checkpoints. They were
            measured elsewhere, on other tasks, and are tested against nothing.
        out: Folder of the comparison; an earlier one in it is replaced.
        mixed: Write the paper's mixed table in its place: trained on sim, real or mixed data,
            evaluated in simulation and on real arms. A run is named TRAINING=FOLDER or
            NAME/TRAINING=FOLDER, such as ACT/sim=runs/act, unless it says itself what its policy
            was trained on.
    """
    for run in runs:
        if not run.startswith(SCHEMES):
            folder = split_name(run)[1]
            find_run(folder)
            check_outside(out, folder)
    if mixed:
        _mixed(runs, out)
        return
    if _compare_shifts(runs, out):
        return
    from duobench.results.compare import compare as compare_runs, write_comparison
    from duobench.results.tables import verdict

    comparison = compare_runs(runs)
    with advising(OTHER_OUT):
        page = write_comparison(comparison, out)
    for pair in comparison.pairs:
        say(verdict(pair))
        if pair.conditions:
            say(f"  Not the policies alone differ: {'; '.join(pair.conditions)}.")
    say(f"Comparison: {page}")


def _compare_shifts(runs: tuple[str, ...], out: Path) -> bool:
    """Lay evaluations under shifts over each other, if the runs are such; whether they are."""
    from duobench.results.robustness import robustness_of, write_robustness

    read = {run: read_named(run) for run in runs if not run.startswith(SCHEMES)}
    under_shifts = [
        run
        for run, (_, parts) in read.items()
        if len({part.condition.shift for part in parts}) > 1
    ]
    if not under_shifts:
        return False
    others = [run for run in runs if run not in under_shifts]
    if others:
        raise AdvisedError(
            f"{others[0]} is not played under several shifts, as others are. Compare one of their "
            f"conditions with it, such as {under_shifts[0]}@none."
        )
    policies = [
        one for name, parts in read.values() for one in robustness_of(parts, name)
    ]
    with advising(OTHER_OUT):
        page = write_robustness(policies, out)
    say(f"Comparison: {page}")
    return True


def _mixed(runs: tuple[str, ...], out: Path) -> None:
    from duobench.results.mixed import markdown, read_mixed, write_mixed

    table = read_mixed(runs)
    with advising(OTHER_OUT):
        page = write_mixed(table, out)
    say(markdown(table).rstrip())
    say(f"Mixed table: {page}")
