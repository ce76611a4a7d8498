"""`duobench verify`: play the joint targets of a run again, and compare what comes out."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from duobench.cli.shared.advice import find_run
from duobench.cli.shared.console import console, counted
from duobench.cli.shared.engine import load_engine

if TYPE_CHECKING:
    from rich.console import Console

    from duobench.replay.verify import Finding, Verification
    from duobench.results.records import Condition

NAMED = 3
"""Episodes that are named of those that are not verifiable for one reason."""


def verify(
    source: tyro.conf.Positional[Path], workers: int = 1, import_tasks: bool = False
) -> None:
    """Play the joint targets in the records of a run again, without its policy, and compare.

    The exit code is 1 if anything comes out differently, or if nothing could be verified.

    Args:
        source: Folder of the run, or a file that duobench bundle has written.
        workers: Processes that verify side by side.
        import_tasks: Import tasks that are not of the benchmark, which runs the code of the modules
            that the run names.
    """
    find_run(source)
    load_engine()
    from duobench.cli.shared.progress import display
    from duobench.replay.verify import verify as verify_run
    from duobench.results.bundle import open_source

    screen = console()
    opened = open_source(source)
    with display(screen, "episode") as shown:
        found = verify_run(opened, workers=workers, import_tasks=import_tasks, progress=shown.tell)
    _show(found, screen, import_tasks)
    if not found.is_verified:
        sys.exit(1)


def _show(found: Verification, screen: Console, import_tasks: bool) -> None:
    """Print what does not agree, a line each, and how many episodes have which verdict."""
    from duobench.replay.verify import Verdict
    from duobench.tasks import catalog

    name = partial(_name, found.run.conditions)
    for sentence in found.objections:
        screen.print(f"Contradicted: {sentence}")
    for finding in found.of(Verdict.CONTRADICTED):
        screen.print(f"Contradicted: {name(finding)}: {finding.reason}")
    for verdict in (Verdict.STAGES, Verdict.UNVERIFIABLE):
        for reason, findings in _by_reason(found.of(verdict)).items():
            names = ", ".join(name(finding) for finding in findings[:NAMED])
            more = f" and {len(findings) - NAMED} more" if len(findings) > NAMED else ""
            screen.print(f"{verdict.capitalize()}: {names}{more}: {reason}")
    counts = (f"{verdict} {len(found.of(verdict))}" for verdict in Verdict)
    screen.print(f"{counted(len(found.findings), 'episode')}: {', '.join(counts)}.")
    if found.missing:
        screen.print(f"The run is unfinished: no record of {counted(found.missing, 'episode')}.")
    foreign = {one.key.task for one in found.of(Verdict.UNVERIFIABLE)} - set(catalog.names())
    if foreign and not import_tasks:
        screen.print("With --import-tasks its tasks are imported; that runs the code of others.")
    screen.print("Verified." if found.is_verified else "Not verified.")


def _by_reason(findings: list[Finding]) -> dict[str, list[Finding]]:
    grouped: dict[str, list[Finding]] = {}
    for finding in findings:
        grouped.setdefault(finding.reason, []).append(finding)
    return grouped


def _name(conditions: Mapping[str, Condition], finding: Finding) -> str:
    """What an episode is called, with its condition where there are several."""
    task, condition, episode = finding.key
    shift = f", {conditions[condition].shift}" if len(conditions) > 1 else ""
    return f"{task}, episode {episode}{shift}"
