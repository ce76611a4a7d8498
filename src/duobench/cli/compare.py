"""`duobench compare`: runs beside each other."""

from __future__ import annotations

import sys
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from duobench.cli.shared.advice import (
    OTHER_OUT,
    AdvisedError,
    advising,
    find_run,
)
from duobench.cli.shared.console import say, table
from duobench.cli.shared.process import load_engine
from duobench.cli.shared.progress import display
from duobench.core.files import check_outside
from duobench.results.bundle import open_source
from duobench.results.entrants import SCHEMES, read_named, split_name

if TYPE_CHECKING:
    from duobench.results.entrants import Checker, ReplayCheck
    from duobench.results.records import Key


def run(
    runs: tyro.conf.Positional[tuple[str, ...]],
    out: Path,
    mixed: bool = False,
    verify: bool = False,
    workers: int = 1,
    import_tasks: bool = False,
) -> None:
    """Compare runs: the paper's table, tests on the same episodes, figures, and one page.

    With --verify the exit code is 1 if a run is not verified.

    Args:
        runs: Folders of two or more runs (--out of duobench eval) or bundles, each alone or as
            NAME=FOLDER to give it a name; FOLDER@SHIFT, such as runs/act@look-3, takes one
            condition. paper:ACT, paper:pi05 and paper:xvla show the paper's results beside them,
            authors:ACT, authors:pi05 and authors:xvla those of the authors' published checkpoints.
            They were measured elsewhere, on other tasks, and are tested against nothing.
        out: Folder of the comparison; an earlier one in it is replaced.
        mixed: Write the paper's mixed table in its place: trained on sim, real or mixed data,
            evaluated in simulation and on real arms. A run is named TRAINING=FOLDER or
            NAME/TRAINING=FOLDER, such as ACT/sim=runs/act, unless it says itself what its policy
            was trained on.
        verify: Play the joint targets of the runs again first, as duobench verify does; a column
            says what came out.
        workers: Processes that verify side by side.
        import_tasks: To verify, import tasks that are not of the benchmark, which runs the code of
            the modules that the runs name.
    """
    for run in runs:
        if not run.startswith(SCHEMES):
            folder = split_name(run)[1]
            find_run(folder)
            check_outside(out, folder)
    if mixed:
        _refuse_to_verify(verify)
        _mixed(runs, out)
        return
    if _compare_shifts(runs, out, verify):
        return
    from duobench.results.comparison import compare as compare_runs, write_comparison
    from duobench.results.tables import PAIR_HEADS, pair_cells

    checker = _checker(workers, import_tasks) if verify else None
    comparison = compare_runs(runs, checker)
    with advising(OTHER_OUT):
        page = write_comparison(comparison, out)
    pairs = table(*PAIR_HEADS)
    for pair in comparison.pairs:
        pairs.add_row(*pair_cells(pair))
    if comparison.pairs:
        say(pairs)
    checked = [one for one in comparison.entrants if one.part and verify]
    for one in checked:
        say(f"Verified, {one.name}: {one.check.verified} ({one.check.details})")
    say(f"Comparison: {page}")
    if any(one.check.verified == "no" for one in checked):
        sys.exit(1)


def _checker(workers: int, import_tasks: bool) -> Checker:
    """Return what verifies the records of a run or bundle."""
    load_engine()
    from duobench.evaluation.replay.verification import checks, verify as verify_run

    def check(path: Path, keys: Collection[Key]) -> Mapping[str, ReplayCheck]:
        with display("episode") as shown:
            found = verify_run(
                open_source(path),
                wanted=set(keys),
                workers=workers,
                import_tasks=import_tasks,
                progress=shown.tell,
            )
        return checks(found)

    return check


def _refuse_to_verify(verify: bool) -> None:
    if verify:
        raise AdvisedError(
            "--verify is for the comparison of single conditions; duobench verify RUN verifies any."
        )


def _compare_shifts(
    runs: tuple[str, ...],
    out: Path,
    verify: bool,
) -> bool:
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
    _refuse_to_verify(verify)
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


NAMED = 3
"""Episodes that are named of those that are not verifiable for one reason."""
