"""`duobench real eval`: evaluate policies on real arms, with an operator who judges."""

from __future__ import annotations

import secrets
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from duobench.cli.real.rigs import RigOptions
from duobench.cli.shared.advice import AdvisedError, advising
from duobench.cli.shared.console import console, counted
from duobench.cli.shared.engine import load_engine
from duobench.cli.shared.interrupt import stopping
from duobench.cli.shared.options import command_line
from duobench.cli.shared.page import PageOptions
from duobench.errors import DuoBenchError, LockedError, OtherRunError

if TYPE_CHECKING:
    from rich.console import Console

    from duobench.hardware.doctor.checks import Report
    from duobench.rig_sessions.trials_report import TrialsReport

_PAGE = PageOptions()


def evaluate(  # noqa: PLR0913, PLR0917 - each is an argument of the command line
    rig: tyro.conf.OmitArgPrefixes[RigOptions],
    task: str,
    policy: tyro.conf.UseAppendAction[tuple[str, ...]],
    out: Path,
    episodes: int = 15,
    blind: bool = False,
    trained_on: tyro.conf.UseAppendAction[tuple[str, ...]] = (),
    rater: str = "operator",
    first_episode: int = 0,
    order_seed: int | None = None,
    record: Path | None = None,
    page: tyro.conf.OmitArgPrefixes[PageOptions] = _PAGE,
) -> None:
    """Evaluate policies on real arms: an operator places the objects and judges, on one page.

    Open the printed address and follow the page. All policies play the same layouts and take turns.
    Every press is on the disk at once: the same command goes on where it was stopped, also with
    more episodes. At the end each policy has a report as in simulation, and they are compared. Not
    yet tried on an arm.

    Args:
        rig: The rig, and how it is driven.
        task: Id of a task (see: duobench list) or module:ATTRIBUTE.
        policy: A policy that sees images, as duobench eval takes it, or NAME@ws://HOST:PORT for one
            that is served; give it once for each policy.
        out: Folder of the evaluation.
        episodes: Episodes of each policy; the paper has 15.
        blind: Hide the names of the policies on the page until all trials are played.
        trained_on: What the policies were trained on, in their order: sim, real or mixed.
        rater: Pseudonym of who judges; it is recorded.
        first_episode: Index of the first episode; layouts follow from task and index alone.
        order_seed: Decides the order in which policies take turns; without it nobody knows it.
        record: Record the trials that count into this data set too, with all cameras.
        page: Where the page is served.
    """
    command = command_line("real eval", evaluate, locals())
    load_engine()
    from duobench.data import DataSet
    from duobench.files import locked
    from duobench.results.suite import find_tasks
    from duobench.rig_sessions.trials import open_session
    from duobench.rig_sessions.trials_folder import TrialsFolder
    from duobench.rig_sessions.trials_report import write_trials_report

    if trained_on and len(trained_on) != len(policy):
        raise AdvisedError(
            f"Give --trained-on once for each --policy, in their order: got {len(trained_on)} for "
            f"{len(policy)}."
        )
    policies = list(zip(policy, trained_on or ("",) * len(policy), strict=True))
    (info,) = find_tasks([task])
    folder, screen = TrialsFolder(out), console()
    with ExitStack() as ending:
        ending.enter_context(advising(_advice))
        duo = rig.open()
        ending.callback(duo.close)
        ending.enter_context(locked(folder.path))
        server = page.serve("trials_page.html")
        ending.callback(server.close)
        session = open_session(
            folder,
            duo,
            info,
            policies,
            server,
            ending,
            rater=rater,
            episodes=episodes,
            first_episode=first_episode,
            order_seed=secrets.randbelow(2**31) if order_seed is None else order_seed,
            blind=blind,
            data=None if record is None else DataSet.open(record),
            command=command,
        )
        if remark := _remark(folder.read_doctor(), duo.rig.hash):
            screen.print(f"{remark} See: duobench real doctor --rig {rig.rig} --out {out}")
        screen.print(f"Open {server.url}\nCtrl-C holds the arms and ends the session.")
        with stopping(session.stop):
            session.run()
        report = write_trials_report(folder)
        written = out / folder.page.name
        results = [each.row() for each in report.policies]
        session.publish(results=results, files=f"Report: {written}")
        _show(report, screen)
        screen.print(f"Report: {written}")


def _remark(found: Report | None, rig_hash: str) -> str:
    """What there is to say about the doctor's findings before a session; empty if all is well."""
    if found is None:
        return "The doctor has not looked at this rig for this folder."
    objection = found.objection(rig_hash)
    return f"At {found.time}, the doctor {objection}." if objection else ""


def _show(report: TrialsReport, screen: Console) -> None:
    """Print what came out, a line for each policy."""
    from duobench.results import scores

    for each in report.policies:
        score = each.score
        screen.print(
            f"{each.letter} {each.policy}: {score.successes} of {score.episodes}, "
            f"{scores.percent(score.success_rate)} % (95 % interval "
            f"{scores.interval_percent(score)} %)"
        )
    for verdict in report.verdicts:
        screen.print(verdict)
    invalid = sum(count for _, count in report.invalid)
    if invalid:
        screen.print(f"{counted(invalid, 'invalid trial')}, played again; the report says why.")
    if report.missing:
        screen.print(
            f"{counted(report.missing, 'trial')} still to be played; the same command goes on."
        )


def _advice(error: DuoBenchError) -> str | None:
    return "Give --out another folder." if isinstance(error, OtherRunError | LockedError) else None
