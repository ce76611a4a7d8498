"""`duobench verify`: the records of a run, played again."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from duobench.cli.shared.advice import find_run, offer_to_import
from duobench.cli.shared.console import counted, say, verified_table
from duobench.cli.shared.folders import tell_missing
from duobench.cli.shared.process import load_engine
from duobench.cli.shared.progress import display
from duobench.results.bundle import open_source
from duobench.results.records import Condition

if TYPE_CHECKING:
    from duobench.evaluation.replay.verification import Finding, Verification


NAMED = 3
"""Episodes that are named of those that are not verifiable for one reason."""


def run(
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
    from duobench.evaluation.replay.verification import verify as verify_run

    opened = open_source(source)
    with display("episode") as shown:
        found = verify_run(
            opened, workers=workers, import_tasks=import_tasks, progress=shown.tell
        )
    tell_missing(opened)
    _show_verification(found, import_tasks)
    if not found.is_verified:
        sys.exit(1)


def _show_verification(found: Verification, import_tasks: bool) -> None:
    from duobench.evaluation.replay.verification import Verdict

    name = partial(_episode_name, found.run.conditions)
    for sentence in found.objections:
        say(f"Contradicted: {sentence}")
    for finding in found.of(Verdict.CONTRADICTED):
        say(f"Contradicted: {name(finding)}: {finding.reason}")
    for verdict in (Verdict.STAGES, Verdict.UNVERIFIABLE):
        reasons: dict[str, list[Finding]] = {}
        for finding in found.of(verdict):
            reasons.setdefault(finding.reason, []).append(finding)
        for reason, findings in reasons.items():
            names = ", ".join(name(finding) for finding in findings[:NAMED])
            more = f" and {len(findings) - NAMED} more" if len(findings) > NAMED else ""
            say(f"{verdict.capitalize()}: {names}{more}: {reason}")
    counts = (f"{verdict} {len(found.of(verdict))}" for verdict in Verdict)
    say(f"{counted(len(found.findings), 'episode')}: {', '.join(counts)}.")
    if found.missing:
        say(f"The run is unfinished: no record of {counted(found.missing, 'episode')}.")
    if found.unnoted:
        say(f"Of {counted(found.unnoted, 'episode')} no attempt is on record.")
    if found.parts:
        say(verified_table(found.parts))
    tasks = {one.key.task for one in found.of(Verdict.UNVERIFIABLE)}
    offer_to_import(tasks, import_tasks=import_tasks)
    say("Verified." if found.is_verified else "Not verified.")


def _episode_name(conditions: Mapping[str, Condition], finding: Finding) -> str:
    """Name of an episode, with its condition where there are several."""
    task, condition, episode = finding.key
    shift = f", {conditions[condition].shift}" if len(conditions) > 1 else ""
    return f"{task}, episode {episode}{shift}"
