"""What moves real arms: `duobench real home`, `record` and `eval`."""

from __future__ import annotations

import secrets
import sys
from contextlib import ExitStack, closing, nullcontext
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import tyro

from duobench.cli.real.rigs import KeyTerminal, RigOptions, hold_and_say
from duobench.cli.shared.advice import OTHER_OUT, Advice, AdvisedError, advising
from duobench.cli.shared.console import counted, say
from duobench.cli.shared.options import command_line
from duobench.cli.shared.page import PageOptions
from duobench.cli.shared.process import load_engine, stopping
from duobench.core.errors import BackendError
from duobench.core.files import locked, taken_back
from duobench.core.types import Side
from duobench.results.scores import interval_percent, percent
from duobench.results.suite import find_tasks

if TYPE_CHECKING:
    from duobench.real.duo import FrankaDuo
    from duobench.real.sessions.trials import TrialsSession
    from duobench.real.sessions.trials_folder import TrialsFolder
    from duobench.real.sessions.trials_report import TrialsReport
    from duobench.web.server import PageServer


_PAGE = PageOptions()
GRIPPERS: Advice = {BackendError: "Hands are opened by duobench real grippers --open left right."}
WORD = "home"
"""What the operator types to confirm."""


def real() -> None:
    """Lead, record and evaluate on real arms; not yet tried on an arm."""


def home(rig: str, check: bool = False, fast: bool = False, with_object: bool = False) -> None:
    """Bring both arms home at a tenth of their speed, on a way that the guard found free.

    It says where the arms are and which way they will go, and moves nothing before you typed
    `home`. Ctrl-C brings them to rest. The only emergency stop is that of the hardware.

    Args:
        rig: The rig's file, rig.json, or a rig without hardware: simulated, or rehearsal.
        check: Only connect, and say where the arms are and which way they would go.
        fast: Do not wait for the clock, which only rigs without hardware can do.
        with_object: Carry home what one hand holds, where it is let go.
    """
    with closing(RigOptions(rig=rig, fast=fast).open()) as duo:
        duo.start()
        here = duo.read().joints
        assert duo.guard is not None
        nearest = duo.guard.nearest(here, within=1.0)
        way = duo.path_home()
        fault = duo.health()
        say(f"Rig {duo.rig.name}, {duo.rig.hash[:12]}: {fault or 'everything answers.'}")
        say(f"Nearest to each other: {nearest or 'nothing within a metre.'}")
        turns = [np.abs(b - a).max() for a, b in pairwise([here, *way])]
        say(
            f"The way home has {len(way)} straight part(s); joints turn by up to "
            f"{', '.join(f'{turn:.2f}' for turn in turns)} rad. Then the grippers open."
        )
        if check:
            return
        _activate(duo)
        if duo.fault is not None:
            _confirm(f"{duo.held} Is it set right, so that it may be cleared?", "recover")
            duo.supervisor.recover()
        with advising(GRIPPERS):
            duo.hands.check_free(with_object=with_object)
        _confirm("Is nobody within reach, and is somebody at the emergency stop?", WORD)
        duo.supervisor.confirm()
        with stopping(lambda: duo.hold("Ctrl-C.")):
            duo.home(with_object=with_object)
        say("Both arms are home.")


def grippers(
    rig: str,
    activate: bool = False,
    open: tuple[Side, ...] = (),
    fast: bool = False,
) -> None:
    """Say how the grippers are; activate them or open hands once you have typed the word.

    A gripper that was switched off has forgotten its activation, and moves nowhere before it is
    activated: its fingers close and open. Open hands after an episode that ended with something in
    them. The arms stay where they are; Ctrl-C stops the fingers.

    Args:
        rig: The rig's file, rig.json, or "simulated" for a rig without hardware.
        activate: Activate those that are not active, or have a fault.
        open: Open these hands: left, right, or both names.
        fast: Do not wait for the clock, which only simulated drivers can do.
    """
    with closing(RigOptions(rig=rig, fast=fast).open()) as duo:
        duo.start()
        if activate:
            _activate(duo)
        if open:
            _confirm(f"Is what is held ({' and '.join(open)}) kept from falling?", "open")
            with stopping(lambda: duo.hold("Ctrl-C.")):
                duo.hands.open(open)
        for side, reading in duo.gripper_readings().items():
            state = "active" if reading.is_active else "not active"
            holds = ", holds something" if reading.has_object else ""
            fault = "" if reading.fault is None else f"; {reading.fault.text}"
            say(f"The {side} gripper: {state}, opening {reading.opening:.2f}{holds}{fault}")


def _activate(duo: FrankaDuo) -> None:
    """Activate grippers that are not active or well, once the operator has said so."""
    asleep = duo.hands.to_activate
    if asleep:
        which = " and ".join(asleep)
        _confirm(
            f"To be activated: {which}. Is nothing between the fingers? They move.", "activate"
        )
        with stopping(lambda: duo.hold("Ctrl-C.")):
            duo.hands.activate()


def _confirm(question: str, word: str) -> None:
    say(f"{question}\nType {word} and Enter; anything else ends this.")
    if sys.stdin.readline().strip() != word:
        raise AdvisedError("Nothing was moved.")


def record(  # noqa: PLR0913, PLR0917 - each is an argument of the command line
    policy: str,
    rig: tyro.conf.OmitArgPrefixes[RigOptions],
    task: str,
    out: Path,
    episodes: int = 10,
    tempo: float = 0.5,
    instruction: str = "",
    horizon: int | None = None,
    after_success: float = 1.0,
) -> None:
    """Record what a policy does on real arms, with an operator at this terminal.

    The operator sends the arms home, places the objects, watches, says with a key how far it came,
    and keeps or discards each episode; nothing moves without a key. Cameras are recorded as videos
    beside the episodes. The same command goes on with a data set until it has as many episodes.
    Not yet tried on an arm.

    Args:
        policy: A policy that sees images, as duobench eval takes it, or the file of a recorded
            episode, whose commands are sent again.
        rig: The rig, and how it is driven.
        task: Id of a task (see: duobench list) or module:ATTRIBUTE.
        out: Folder of the data set.
        episodes: How many episodes of the task to keep, those that are there counted.
        tempo: Part of its speed with which a recorded episode is played.
        instruction: What the policy is told; the task's own words if not given.
        horizon: Control steps of an episode at most; the task's own if not given.
        after_success: Seconds that an episode goes on after success.
    """
    load_engine()
    from duobench.data import DataSet
    from duobench.data.dataset import DESCRIPTION
    from duobench.real.sessions.recording import RigRecording, find_policy

    with taken_back(out, DESCRIPTION), ExitStack() as ending:
        source = find_policy(policy, tempo)
        duo = rig.open()
        data = DataSet.open(out, how=f"duobench real record --policy {policy}")
        terminal = ending.enter_context(closing(KeyTerminal()))
        session = RigRecording(
            duo,
            task,
            data,
            source,
            terminal,
            episodes=episodes,
            instruction=instruction,
            horizon=horizon,
            after_success=after_success,
        )
        ending.callback(session.close)
        with stopping(partial(hold_and_say, duo)) as terminal.on_answer:
            kept = session.run()
    say(f"{counted(kept, 'episode')} of {task} in {out}")


def evaluate(  # noqa: PLR0913, PLR0917 - each is an argument of the command line
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
        order_seed: Decides the order in which policies take turns; without it nobody knows it.
        record: Record the trials that count into this data set too, with all cameras.
        page: Where the page is served.
    """
    command = command_line("real eval", evaluate, locals())
    load_engine()
    from duobench.data import DataSet
    from duobench.data.dataset import DESCRIPTION
    from duobench.real.sessions.trials import TrialsSession
    from duobench.real.sessions.trials_folder import TRIALS_BEGINNINGS, TrialsFolder

    policies, (info,) = _pairs(policy, trained_on), find_tasks([task])
    new = taken_back(out, *TRIALS_BEGINNINGS, is_begun=lambda: bool(TrialsFolder(out).read_log()))
    new_data = nullcontext() if record is None else taken_back(record, DESCRIPTION)
    with advising(OTHER_OUT), new, new_data, ExitStack() as ending:
        folder, duo, server = _place(ending, rig, out, page)
        if folder.description.exists() and order_seed not in {None, folder.read_plan().order_seed}:
            raise AdvisedError(f"{out} keeps the order it began with: leave out --order-seed.")
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


def _pairs(policies: tuple[str, ...], trained_on: tuple[str, ...]) -> list[tuple[str, str]]:
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


def _judge(session: TrialsSession, folder: TrialsFolder, server: PageServer, out: Path) -> None:
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


def _tell_of_doctor(folder: TrialsFolder, rig: RigOptions, duo: FrankaDuo, out: Path) -> None:
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
    for each in report.policies:
        score = each.score
        say(
            f"{each.letter} {each.policy}: {score.successes} of {score.episodes}, "
            f"{percent(score.success_rate)} % (95 % interval "
            f"{interval_percent(score)} %)"
        )
    for verdict in report.verdicts:
        say(verdict)
    invalid = sum(count for _, count in report.invalid)
    if invalid:
        say(f"{counted(invalid, 'invalid trial')}, played again; the report says why.")
    if report.missing:
        say(f"{counted(report.missing, 'trial')} still to be played; the same command goes on.")
