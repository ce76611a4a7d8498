"""What is done with a run that was played: report, compare, verify, bundle, leaderboard."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from duobench.cli.shared.advice import (
    OTHER_OUT,
    OTHER_RUN,
    AdvisedError,
    advising,
    find_run,
    offer_to_import,
    relative,
)
from duobench.cli.shared.console import counted, results_table, say, verified_table
from duobench.cli.shared.process import load_engine
from duobench.cli.shared.progress import display
from duobench.core.files import check_outside, digest_of
from duobench.results.attempts import repeats_text
from duobench.results.bundle import BUNDLE_SUFFIX, open_source, write_bundle
from duobench.results.entrants import SCHEMES, read_named, split_name
from duobench.results.folder import RunFolder, RunReader
from duobench.results.records import Condition
from duobench.results.salt import read_salt
from duobench.results.scores import RunPart, interval_percent, percent, rate_text
from duobench.tasks.shifts.shift import NO_SHIFT

if TYPE_CHECKING:
    from duobench.data.processes import Progress
    from duobench.evaluation.replay.render import RenderResult
    from duobench.evaluation.replay.verify import Finding, Verification
    from duobench.results.leaderboard import BoardEntry


def report(
    source: tyro.conf.Positional[Path],
    out: Path | None = None,
    videos: tuple[str, ...] = (),
    replays: tuple[str, ...] = (),
    import_tasks: bool = False,
) -> None:
    """Compute table, figures and page from the records of a run.

    The exit code is 1 if a video or a replay that was asked for cannot be made.

    Args:
        source: What was given to --out of duobench eval, whose run need not be finished, or a file
            that duobench bundle has written.
        out: Folder of the report of a bundle; that of a run lies in the run's own folder.
        videos: Make videos of these finished episodes first, from what was sent in them: failures,
            all, or TASK:EPISODE such as bin_sort:3, one or several. One that is there stays.
        replays: Show these finished episodes in 3D on the page: as for --videos, but failures and
            all choose 20 at most, of all tasks and last stages.
        import_tasks: For videos and replays, import tasks that are not of the benchmark. This runs
            the code of the modules that the run names.
    """
    find_run(source)
    from duobench.results.report import missing_shards, read_parts, write_report

    reader = open_source(source)
    if isinstance(reader, RunFolder) != (out is None):
        raise AdvisedError(
            f"{source} is a bundle: say with --out where its report shall be."
            if out is None
            else "--out is for the report of a bundle; that of a run lies in the run's own folder."
        )
    folder = RunFolder(out or source)
    parts = read_parts(reader)
    _tell_missing(reader)
    if len(parts) == 1:
        # First, so that the table of a folder can be had by who may only read it.
        say(results_table(parts[0]))
    elsewhere = None if isinstance(reader, RunFolder) else reader
    write_report(folder, elsewhere)
    impossible = 0
    if videos or replays:
        impossible = _make_chosen(folder, parts, videos, replays, import_tasks)
        write_report(folder, elsewhere)
    missing = missing_shards(folder, parts[0].run)
    if missing:
        say(missing)
    say(f"Report: {relative(folder.page)}")
    if impossible:
        sys.exit(1)


def _tell_missing(reader: RunReader) -> None:
    """Say what was played and is missing now; a folder of trials that do not go on is refused."""
    from duobench.real.sessions.trials_folder import TrialsFolder

    trials, run = TrialsFolder(reader.path.parent), reader.read_run()
    is_of_trials = run.is_real and trials.run.path == reader.path and trials.description.exists()
    missing = trials.compared() if is_of_trials else reader.removed(run)
    if missing:
        say(missing)


def _make_chosen(
    folder: RunFolder,
    parts: Sequence[RunPart],
    videos: Sequence[str],
    replays: Sequence[str],
    import_tasks: bool,
) -> int:
    """Make videos and replays of the episodes that words choose; how many cannot be made."""
    load_engine()
    from duobench.evaluation.replay.render import REPLAY, VIDEO, choose, choose_few, make_missing

    run, records = parts[0].run, [record for part in parts for record in part.records]
    impossible = 0
    for what, words, pick in ((VIDEO, videos, choose), (REPLAY, replays, choose_few)):
        if words:
            chosen = pick(run, records, words)
            if not chosen:
                say(f"No {what} is made: {' '.join(words)} chooses none of the episodes.")
                continue
            todo = partial(make_missing, folder, run, chosen, what, import_tasks=import_tasks)
            impossible += _make(what, todo, import_tasks)
    return impossible


def _make(what: str, make: Callable[..., RenderResult], import_tasks: bool) -> int:
    with display(what) as shown:
        found = make(progress=shown.tell)
    for record, reason in found.impossible:
        shift = record.condition.shift
        under = "" if shift == NO_SHIFT else f", {shift}"
        say(f"No {what} of {record.task}, episode {record.episode}{under}: {reason}")
    offer_to_import({record.task for record, _ in found.impossible}, import_tasks=import_tasks)
    there = f", {len(found.there)} there before" if found.there else ""
    say(f"{counted(len(found.made), what)} made{there}")
    return len(found.impossible)


def compare(runs: tyro.conf.Positional[tuple[str, ...]], out: Path, mixed: bool = False) -> None:
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
        run for run, (_, parts) in read.items() if len({part.condition.shift for part in parts}) > 1
    ]
    if not under_shifts:
        return False
    others = [run for run in runs if run not in under_shifts]
    if others:
        raise AdvisedError(
            f"{others[0]} is not played under several shifts, as others are. Compare one of their "
            f"conditions with it, such as {under_shifts[0]}@none."
        )
    policies = [one for name, parts in read.values() for one in robustness_of(parts, name)]
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


def verify(
    source: tyro.conf.Positional[Path],
    workers: int = 1,
    import_tasks: bool = False,
    salt: Path | None = None,
) -> None:
    """Play the joint targets in the records of a run again, without its policy, and compare.

    The exit code is 1 if anything comes out differently, or if nothing could be verified.

    Args:
        source: Folder of the run, or a file that duobench bundle has written.
        workers: Processes that verify side by side.
        import_tasks: Import tasks that are not of the benchmark, which runs the code of the modules
            that the run names.
        salt: File with the salt that the seeds of the run must follow from.
    """
    find_run(source)
    load_engine()
    import duobench.results.report  # noqa: F401 - it draws at the end; what keeps it is told now
    from duobench.evaluation.replay.verify import verify as verify_run

    opened = open_source(source)
    opened.salt = None if salt is None else read_salt(salt)
    with display("episode") as shown:
        found = verify_run(opened, workers=workers, import_tasks=import_tasks, progress=shown.tell)
    if found.run.suite.salt and salt is None:
        say(
            "The seeds are not verified: they follow from a salt that is not given (--salt), and "
            "may have been chosen by whoever played the run."
        )
    _tell_missing(opened)
    _show_verification(found, import_tasks)
    if not found.is_verified:
        sys.exit(1)


def _show_verification(found: Verification, import_tasks: bool) -> None:
    from duobench.evaluation.replay.verify import Verdict

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
    pages = found.compared_in_numbers
    if pages:
        say(f"Of other software, or without its journals, so in numbers alone: {', '.join(pages)}.")
    if found.parts:
        say(verified_table(found.parts))
    tasks = {one.key.task for one in found.of(Verdict.UNVERIFIABLE)}
    offer_to_import(tasks, import_tasks=import_tasks)
    say("Verified." if found.is_verified else "Not verified.")


def _episode_name(conditions: Mapping[str, Condition], finding: Finding) -> str:
    """What an episode is called, with its condition where there are several."""
    task, condition, episode = finding.key
    shift = f", {conditions[condition].shift}" if len(conditions) > 1 else ""
    return f"{task}, episode {episode}{shift}"


def bundle(folder: tyro.conf.Positional[Path], out: Path | None = None) -> None:
    """Write a run and its records into one file for publication, without videos and timing.

    Args:
        folder: What was given to --out of duobench eval; the run need not be finished.
        out: The file. Default: NAME.duobench.zip beside the folder NAME.
    """
    find_run(folder)
    if folder.is_file():
        raise AdvisedError(
            f"{folder} is a file, which holds no evaluation; give the folder of a run."
        )
    reader = RunFolder(folder)
    whole = reader.path.resolve()  # which has a name, also where `.` was given
    path = out or relative(whole.with_name(f"{whole.name}{BUNDLE_SUFFIX}"))
    check_outside(path, reader.path)
    _tell_missing(reader)
    manifest = write_bundle(reader, path)
    if manifest.missing:
        say(f"The run is unfinished: no record of {counted(manifest.missing, 'episode')}.")
    repeats = repeats_text(ends[:-1] for ends in manifest.attempts.values())
    if repeats:
        say(repeats)
    say(f"Bundle: {path}, {counted(len(manifest.parts) - 1, 'record')}")
    say(f"SHA-256: {digest_of(path)}")


def leaderboard(folder: tyro.conf.Positional[Path], out: Path, workers: int = 1) -> None:
    """Verify the bundles in a folder and build a leaderboard of them: pages that load nothing.

    A bundle that does not verify is listed with the reason and not ranked. What was verified before
    is not played again.

    Args:
        folder: Folder with files that duobench bundle has written, NAME.duobench.zip.
        out: Folder of the leaderboard; an earlier one in it is replaced.
        workers: Processes that verify side by side.
    """
    if not folder.is_dir():
        raise AdvisedError(f"There is no folder {folder}. duobench bundle RUN makes a bundle.")
    load_engine()
    from duobench.evaluation.replay.leaderboard import make_leaderboard

    shown = ExitStack()

    def started(name: str) -> Progress:
        shown.close()  # what is shown of the bundle before
        say(f"Verifying {name}")
        return shown.enter_context(display("episode")).tell

    with shown, advising(OTHER_RUN):
        board, page = make_leaderboard(folder, out, workers=workers, started=started)
    for title, _, _, ranked in board.groups:
        for rank, entry in ranked:
            say(f"{title} {rank}: {_result(entry)}")
    for entry in board.partial:
        say(f"Not ranked: {_result(entry)}; {'; '.join(entry.lacks)}")
    for refused in board.refused:
        say(f"Refused: {refused.file}: {refused.reason}")
    say(f"Leaderboard: {page}, {counted(len(board.entries), 'policy run')}")


def _result(entry: BoardEntry) -> str:
    overall = entry.results.overall
    rate, interval = rate_text(overall), interval_percent(overall)
    worst = f", worst case {percent(overall.worst_rate)} %" if overall.repeated else ""
    of = counted(overall.episodes, "episode")
    return f"{entry.name}, success {rate} % ({interval}) of {of}{worst}"
