"""Two days of an operator on the rehearsal, with everything that goes wrong on them.

The first morning begins with grippers that were off overnight; its trials end with a board in both
hands, with a gripper without power, and with the emergency stop. On the second one the arms are
swapped, the rig was measured again, and the page freezes while the arms go home.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from duobench.core.errors import BackendError
from duobench.core.randomness import EVAL, episode_seed
from duobench.core.types import SIDES, Side
from duobench.real.clock import SystemClock
from duobench.real.rig import Rig
from duobench.real.sessions import messages
from duobench.real.sessions.session import Phase
from duobench.real.sessions.trials_folder import LogEntry, LogKind
from duobench.real.sessions.trials_report import write_trials_report
from duobench.real.supervisor import State
from duobench.results.labels import FaultKind
from duobench.results.suite import find_tasks
from duobench.tasks import catalog
from duobench.world.robot.mounts import HOME_JOINTS
from tests.real.rigs import joints, new_rig, put, quick_rig
from tests.real.sessions import rehearsed
from tests.real.sessions.operator import Operator, Stand, operated, records
from tests.real.sessions.rehearsal_operator import RehearsalOperator
from tests.real.sessions.test_rehearsal import AFTER
from tests.web.pages import wait_until

TASK = "ball_maze"
EPISODES = 4
NO_POWER, STOPPED = 1, 2
"""Trials in whose first attempt a gripper loses its power, and a person presses the button."""
FIRST_DAY = 3
"""Trials of the first day."""
REASON = "A hand came too near."
MOST_APART = 0.005
"""How far in metres hands that hold one board may move apart before a person opened them."""


class Day(RehearsalOperator):
    """Does what a person does who does not know what the rig will refuse."""

    def __init__(self, stand: Stand, *, last: int, is_first: bool) -> None:
        super().__init__(stand, catalog.get(TASK), seed=3, holds_in=())
        self.refusals: list[str] = []
        """What the session said to what it did not do."""
        self.apart = 0.0
        """Most that the hands moved apart from the end of a trial until they were opened."""
        self._tries = [messages.Home(), messages.Placed(), messages.Start()] if is_first else []
        self._last, self._held_at, self._events = last, 0.0, set[tuple[int, int]]()
        self._power_back = 0.0

    def _tool_distance(self) -> float:
        world = self._duo.world
        assert world is not None
        with world.lock:
            left, right = (world.simulation.site_pose(f"{side}/tcp").translation for side in SIDES)
        return float(np.linalg.norm(left - right))

    def _prepared(self) -> messages.Message | None:
        session, duo = self._session, self._duo
        trial = session._trial
        assert trial is not None
        if trial.number == self._last:
            session.stop()
            return None
        if self._tries:  # nobody has told the operator of the grippers
            if self.said:
                self.refusals.append(self.said.pop())
            return self._tries.pop(0)
        if self.said:
            self.refusals.append(self.said.pop())
        if (holding := duo.hands.holding) and duo.fault is None:
            if not self._held_at:
                self._held_at = self._tool_distance()
                return messages.Home()  # as after every other trial
            self.apart = max(self.apart, abs(self._tool_distance() - self._held_at))
            self._held_at = 0.0
            return messages.Open(hands=holding)
        if duo.hands.inactive and duo.fault is None and not self._power_back:
            return messages.Activate()
        return super()._prepared()

    def _judged(self) -> messages.Message | None:
        session = self._session
        if session.reasons:
            if "cannot count" not in "".join(self.said[-1:]):
                self.said.append("cannot count")
                return messages.Finish()
            return messages.Invalid(reason=REASON)
        return super()._judged()

    def _watch(self) -> None:
        super()._watch()
        session, world = self._session, self._duo.world
        assert world is not None
        now = self._duo.clock.now()
        if self._power_back and now > self._power_back:
            world.grippers[Side.RIGHT].has_power = True
            self._power_back = 0.0
        if session.phase is not Phase.PLAYING or now - self._began < 4.0:
            if world.is_stopped and session.phase is Phase.PLACING:
                world.release_stop()
            return
        trial = session._trial
        assert trial is not None
        event = trial.number, session._attempt
        if event in self._events:
            return
        self._events.add(event)
        if event == (NO_POWER, 1):
            world.grippers[Side.RIGHT].has_power = False
            self._power_back = now + 3.0
        elif event == (STOPPED, 1):
            world.press_stop()


def stand_at(path: Path, rig: Rig) -> Stand:
    (info,) = find_tasks([TASK])
    seeds = [episode_seed(TASK, number, EVAL) for number in range(EPISODES)]
    horizon = rehearsed.learn(TASK, seeds) + AFTER
    return Stand(
        path,
        rehearsed.POLICIES[:1],
        rig=rig,
        task=replace(info, horizon=horizon),
        episodes=EPISODES,
        silence_s=1e9,
    )


def entries(stand: Stand, kind: LogKind) -> list[LogEntry]:
    return [entry for entry in stand.folder.read_log() if entry.kind is kind]


@pytest.mark.long
def test_two_days(tmp_path: Path) -> None:
    path, rig = tmp_path / "trials", quick_rig()

    # The first day.
    stand = stand_at(path, rig)
    with stand.ending:
        day = Day(stand, last=FIRST_DAY, is_first=True)
        assert not stand.session.run()
    refused = "\n".join(day.refusals)
    assert refused.count("Both grippers are not active") >= 2, "neither home nor start"
    assert "Both hands hold something" in refused
    assert day.apart <= MOST_APART
    found = records(stand.folder)["A"]
    assert [record.episode for record in found] == [0, 1, 2]
    assert found[0].success
    lost, stopped = entries(stand, LogKind.INVALID)
    assert (lost.trial, lost.yes) == (NO_POWER, True), "by itself"
    assert "right gripper" in lost.text
    told = stopped.trial, stopped.fault, stopped.text
    assert told == (STOPPED, FaultKind.PERSON, REASON), "it was asked"
    assert all(record.judged and not record.judged.fault for record in found)

    # The second morning: somebody has plugged the cables in again, the wrong way.
    swapped = replace(rig, arms={side: rig.arms[side.other] for side in SIDES})
    duo = new_rig(swapped)
    world = duo.world
    assert world is not None
    before = [world.arms[side].joints.copy() for side in SIDES]
    with pytest.raises(BackendError, match="The arms are swapped"):
        duo.start()
    assert np.array_equal([world.arms[side].joints for side in SIDES], before)
    duo.close()

    # The right way again, and a gripper's ends were measured anew: the evaluation goes on.
    hand = replace(rig.grippers[Side.LEFT], open_count=4)
    again = replace(rig, grippers={**rig.grippers, Side.LEFT: hand})
    stand = stand_at(path, again)
    with stand.ending:
        day = Day(stand, last=EPISODES, is_first=False)
        assert stand.session.run()
    found = records(stand.folder)["A"]
    assert [record.rig for record in found] == [rig.hash] * FIRST_DAY + [again.hash]
    report = write_trials_report(stand.folder)
    assert report.rigs.startswith("2 measurements")
    assert report.policies[0].score.episodes == EPISODES
    page = stand.folder.page.read_text(encoding="utf-8")
    assert REASON in page
    assert str(FaultKind.PERSON) in page


def test_a_page_that_freezes_while_the_arms_go_home_holds_them(tmp_path: Path) -> None:
    """In real time: the last sign is that the arms shall go home."""
    stand = Stand(tmp_path / "trials", rehearsed.POLICIES[:1], clock=SystemClock(), silence_s=2.0)
    held: list[str] = []
    put(stand.duo, HOME_JOINTS + np.array([0.8, 0, 0, 0, 0, 0, 0]))

    def script(operator: Operator) -> None:
        operator.phase("placing")
        operator.say("home")
        operator.phase("moving")
        wait_until(lambda: stand.duo.supervisor.state is not State.HOMING and stand.duo.held)
        held.append(stand.duo.held or "")
        stand.session.stop()

    with stand.ending, operated(stand, script) as failures:
        assert not stand.session.run()
    assert failures == []
    (reason,) = held
    found = re.fullmatch(r"The operator's page gave no sign for ([\d.]+) s\.", reason)
    assert found, reason
    assert 2.0 <= float(found[1]) < 4.0, "2.1 on a machine that has time"
    assert np.abs(joints(stand.duo) - HOME_JOINTS).max() > 0.1, "it was still on the way"
