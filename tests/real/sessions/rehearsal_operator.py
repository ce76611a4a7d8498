"""An operator of rehearsals who sees in the world what happened, and errs as people do."""

from __future__ import annotations

import random
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from typing import cast

from duobench.core.errors import MessageError
from duobench.core.types import CONTROL_HZ, Side
from duobench.real.sessions import messages
from duobench.real.sessions.session import Phase, Stopped
from duobench.tasks.stages.progress import Progress
from duobench.tasks.task import Task
from tests.real.sessions.operator import Stand

HELD_AFTER_S = 2.0
"""Seconds of a trial after which the operator holds the arms: before anything is lifted, which may
end it."""
ERRS = 0.05
"""Share of presses that are wrong at first."""
PATIENCE = 2000
"""Turns in which a trial has to be placed."""
IN_THE_AIR = 0.02
"""Height in metres from which on something that is let go drops."""
WRONG = "I pressed the wrong key."


@dataclass
class Meant:
    """What the operator saw of a trial, and what was done about it."""

    stage: int = 0
    holds: bool = False
    reached: dict[int, float] = field(default_factory=dict)
    """Seconds since the policy began at which each stage was reached."""
    was_held: bool = False
    has_dropped: bool = False
    """Whether a hand lost something in the air."""
    erred: int = 0


class RehearsalOperator:
    """Operates a stand as its session's view, in virtual time and therefore always alike.

    Presses come 0.3 to 1 s after a stage is reached. A share of them is wrong, is taken back, and
    put right. Trials of some numbers are held after a while.
    """

    def __init__(self, stand: Stand, task: Task, seed: int, holds_in: tuple[int, ...]) -> None:
        self.meant: dict[int, Meant] = {}
        """By the number of the trial; the last attempt counts."""
        self.said: list[str] = []
        """Everything that the session said."""
        self._stand, self._session, self._duo = stand, stand.session, stand.duo
        self._task, self._random, self._holds_in = task, random.Random(seed), holds_in
        self._progress: Progress | None = None
        self._due: list[tuple[float, messages.Message]] = []
        self._began = 0.0
        self._grips: set[Side] = set()
        self._turns = 0
        self._session.view = self
        self._duo.clock.every(1.0 / CONTROL_HZ, self._watch, "operator")

    @property
    def trial(self) -> Meant:
        trial = self._session._trial
        assert trial is not None
        return self.meant[trial.number]

    # --- as the view of the session ------------------------------------------------------------

    def publish(self) -> None:
        """Nothing is shown."""

    def moving(self) -> AbstractContextManager[object]:
        return nullcontext()

    def next(self) -> messages.Message | None:
        session, clock = self._session, self._duo.clock
        if session.is_stopped:
            raise Stopped
        if session.message:
            self.said.append(session.message)
            session.message = ""
        clock.wait_until(clock.now() + 0.1)
        if session.phase is Phase.JUDGING:
            message = self._judged()
        else:
            self._turns += 1
            assert self._turns < PATIENCE, self.said[-5:]
            message = self._prepared()
        return None if message is None or self._is_done(message) else message

    def _is_done(self, message: messages.Message) -> bool:
        """Say it when it is pressed, as pages do; whether nothing else is to be done."""
        try:
            return self._session.take(message)
        except MessageError as error:
            self.said.append(str(error))
            return True

    def _prepared(self) -> messages.Message | None:
        session, duo = self._session, self._duo
        if duo.fault is not None:
            return messages.Recover()
        if duo.hands.inactive:
            return messages.Activate()
        if holding := duo.hands.holding:
            return messages.Open(hands=holding)
        if not session.is_home:
            return messages.Home()
        if session.phase is Phase.PLACING:
            return messages.Placed()
        self._turns = 0
        trial = session._trial
        assert trial is not None
        self.meant[trial.number] = Meant(erred=getattr(self.meant.get(trial.number), "erred", 0))
        self._progress, self._due = None, []
        return messages.Start()

    def _judged(self) -> messages.Message | None:
        session = self._session
        if self._due:
            self._press()
            return None
        assert not session.reasons
        if self.said and "cut short" in self.said[-1]:
            self.said.append("")
            return messages.Invalid(reason=WRONG)
        if session.judge.labels.stage == session.judge.max_stage and session.at_end is None:
            return messages.AtEnd(holds=self.trial.holds)
        return messages.Finish()

    # --- while it plays ------------------------------------------------------------------------

    def _watch(self) -> None:
        if self._session.phase is not Phase.PLAYING:
            return
        world, now = self._duo.world, self._duo.clock.now()
        assert world is not None
        simulation = world.simulation
        with world.lock:
            simulation.contacts.update()
            if self._progress is None:
                self._progress, self._began = Progress(self._task.stages), now
                self._progress.reset(simulation, simulation.variants)
            self._progress.update(simulation)
            heights = [simulation.min_height(name) for name in simulation.props]
        grips = {side for side, each in world.grippers.items() if each.has_object}
        if not grips and self._grips and max(heights) > IN_THE_AIR:
            self.trial.has_dropped = True
        self._grips = grips
        trial, progress = self.trial, self._progress
        trial.holds = progress.final_holds
        if progress.stage > trial.stage:
            trial.stage = progress.stage
            trial.reached[progress.stage] = now - self._began
            self._plan(progress.stage, now)
        number = cast("int", self._session._trial and self._session._trial.number)
        if number in self._holds_in and now - self._began > HELD_AFTER_S and not trial.was_held:
            trial.was_held = True
            self._session.take(messages.Hold())
        self._press()

    def _plan(self, stage: int, now: float) -> None:
        """Press a stage soon; sometimes another one first."""
        after = self._due[-1][0] + 0.2 if self._due else 0.0
        at = max(after, now + self._random.uniform(0.3, 1.0))
        if self._random.random() < ERRS:
            self.trial.erred += 1
            others = [each for each in range(1, self._task.max_stage + 1) if each != stage]
            self._due.append((at, messages.Stage(stage=self._random.choice(others))))
            self._due.append((at + 0.5, messages.Undo()))
            at += 0.8
        self._due.append((at, messages.Stage(stage=stage)))

    def _press(self) -> None:
        while self._due and self._due[0][0] <= self._duo.clock.now():
            self._session.take(self._due.pop(0)[1])
