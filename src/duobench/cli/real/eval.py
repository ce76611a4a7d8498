"""`duobench real eval`: policies, compared on a rig."""

from __future__ import annotations

import secrets
from contextlib import ExitStack, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from duobench.cli.shared.advice import OTHER_OUT, AdvisedError, advising
from duobench.cli.shared.console import counted, say, table
from duobench.cli.shared.options import command_line
from duobench.cli.shared.page import PageOptions
from duobench.cli.shared.process import load_engine, stopping
from duobench.cli.shared.rigs import RigOptions
from duobench.core.files import locked, taken_back
from duobench.results.scores import interval_percent, percent
from duobench.results.suite import find_tasks

if TYPE_CHECKING:
    from duobench.real.duo import FrankaDuo
    from duobench.real.sessions.trials import TrialsSession
    from duobench.real.sessions.trials_folder import TrialsFolder
    from duobench.real.sessions.trials_report import TrialsReport
    from duobench.web.server import PageServer


_PAGE = PageOptions()


def run(  # noqa: PLR0913, PLR0917 - each is an argument of the command line
    rig: tyro.conf.OmitArgPrefixes[RigOptions],
    task: str,
    policy: tyro.conf.UseAppendAction[tuple[str, ...]],
    out: Path,
    episodes: int = 15,
    blind: bool = False,
    trained_on: tyro.conf.UseAppendAction[tuple[str, ...]] = (),
    rater: str = "",
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
        rater: Pseudonym of who judges in this session; it is recorded. Without one that of who
            began, or "operator".
        first_episode: Index of the first episode; layouts follow from task and index alone.
        order_seed: Seed of the order in which policies take turns; sampled if not given.
        record: Record the trials that count into this data set too, with all cameras.
        page: Where the page is served.
    """
    command = command_line("real eval", run, locals())
    load_engine()
    from duobench.data import DataSet
    from duobench.data.dataset import DESCRIPTION
    from duobench.real.sessions.trials import TrialsSession
    from duobench.real.sessions.trials_folder import TRIALS_BEGINNINGS, TrialsFolder

    policies, (info,) = _pairs(policy, trained_on), find_tasks([task])
    new = taken_back(
        out, *TRIALS_BEGINNINGS, is_begun=lambda: bool(TrialsFolder(out).read_log())
    )
    new_data = nullcontext() if record is None else taken_back(record, DESCRIPTION)
    with advising(OTHER_OUT), new, new_data, ExitStack() as ending:
        folder, duo, server = _place(ending, rig, out, page)
        if folder.description.exists() and order_seed not in {
            None,
            folder.read_plan().order_seed,
        }:
            raise AdvisedError(
                f"{out} keeps the order it began with: leave out --order-seed."
            )
        session = TrialsSession(
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
        _tell_of_doctor(folder, rig, duo, out)
        _judge(session, folder, server, out)


def _pairs(
    policies: tuple[str, ...], trained_on: tuple[str, ...]
) -> list[tuple[str, str]]:
    """Policies with what they were trained on."""
    if trained_on and len(trained_on) != len(policies):
        raise AdvisedError(
            f"Give --trained-on once for each --policy, in their order: got {len(trained_on)} for "
            f"{len(policies)}."
        )
    return list(zip(policies, trained_on or ("",) * len(policies), strict=True))


def _place(
    ending: ExitStack, rig: RigOptions, out: Path, page: PageOptions
) -> tuple[TrialsFolder, FrankaDuo, PageServer]:
    """The folder, which is locked, the rig and the page, until `ending`."""
    from duobench.real.sessions.trials_folder import TrialsFolder

    folder, duo = TrialsFolder(out), rig.open()
    ending.callback(duo.close)
    ending.enter_context(locked(folder.path))
    server = page.serve("trials_page.html")
    ending.callback(server.close)
    return folder, duo, server


def _judge(
    session: TrialsSession, folder: TrialsFolder, server: PageServer, out: Path
) -> None:
    """Run a session until it is stopped, and say what came out."""
    from duobench.real.sessions.trials_report import write_trials_report

    if session.message:
        say(session.message)
    say(f"Open {server.url}\nCtrl-C holds the arms and ends the session.")
    with stopping(session.stop):
        session.run()
    report = write_trials_report(folder)
    files = f"Report: {out / folder.page.name}"
    session.publish(results=[each.row() for each in report.policies], files=files)
    _show_report(report)
    say(files)


def _tell_of_doctor(
    folder: TrialsFolder, rig: RigOptions, duo: FrankaDuo, out: Path
) -> None:
    from duobench.real.doctor.checks import read_checks

    found = read_checks(folder.path)
    if found is None:
        remark = "The doctor has not looked at this rig for this folder."
    elif objection := found.objection(duo.rig.hash):
        remark = f"At {found.time}, the doctor {objection}."
    else:
        return
    say(f"{remark} See: duobench real doctor --rig {rig.rig} --out {out}")


def _show_report(report: TrialsReport) -> None:
    from duobench.results.tables import PAIR_HEADS, pair_cells

    for each in report.policies:
        score = each.score
        say(
            f"{each.letter} {each.policy}: {score.successes} of {score.episodes}, "
            f"{percent(score.success_rate)} % (95 % interval "
            f"{interval_percent(score)} %)"
        )
    if report.pairs:
        pairs = table(*PAIR_HEADS)
        for pair in report.pairs:
            pairs.add_row(*pair_cells(pair))
        say(pairs)
    invalid = sum(count for _, count in report.invalid)
    if invalid:
        say(f"{counted(invalid, 'invalid trial')}, played again; the report says why.")
    if report.missing:
        say(
            f"{counted(report.missing, 'trial')} still to be played; the same command goes on."
        )
