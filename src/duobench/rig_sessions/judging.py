"""What a person says about a running episode: stages by the paper's rule, with undo.

A stage never falls by another press: the highest one that was pressed counts. Undo takes the latest
press back that stands, and both stay in the log.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable

from duobench.errors import MessageError
from duobench.results.records import Press
from duobench.stages.progress import ProgressState
from duobench.types import CONTROL_HZ


class Presses:
    """The presses of one person about one episode, in the order of time."""

    def __init__(self, max_stage: int, presses: Iterable[Press] = ()) -> None:
        """Begin with what was pressed already.

        Args:
            max_stage: The task's last stage.
            presses: Earlier presses, in the order of time.
        """
        self._max_stage = max_stage
        self._all: list[Press] = []
        self._standing: list[Press] = []
        for press in presses:
            self.add(press)

    def add(self, press: Press) -> None:
        """Take a press, or take one back.

        Raises:
            MessageError: There is no such stage, or nothing to take back.
        """
        if press.stage is None:
            if not self._standing:
                raise MessageError("There is no press to take back.")
            self._standing.pop()
        elif 1 <= press.stage <= self._max_stage:
            self._standing.append(press)
        else:
            raise MessageError(f"The stages are 1 to {self._max_stage}, got {press.stage}.")
        self._all.append(press)

    @property
    def all(self) -> tuple[Press, ...]:
        """Every press, those that were taken back included."""
        return tuple(self._all)

    @property
    def stage(self) -> int:
        """The highest stage that stands."""
        return max((press.stage or 0 for press in self._standing), default=0)

    def changes(self) -> tuple[tuple[int, int], ...]:
        """Pairs (control step, stage): when each newly reached stage was reached."""
        found: dict[int, int] = {}
        highest = 0
        for press in sorted(self._standing, key=lambda press: press.step):
            if (stage := press.stage or 0) > highest:
                found[press.step] = highest = stage  # of two at one step the higher one counts
        return tuple(found.items())


class PersonJudge:
    """A person who judges an episode from another thread; a judge for `TaskStages`."""

    def __init__(self, max_stage: int) -> None:
        """Begin without an episode.

        Args:
            max_stage: The task's last stage.
        """
        self._max_stage = max_stage
        self._pressing = threading.Lock()  # one press after the other
        self._lock = threading.Lock()  # never held for long: a control step may wait for it
        self._presses = Presses(max_stage)
        self._steps = 0

    def begin(self) -> None:
        """An episode has begun."""
        with self._lock:
            self._presses, self._steps = Presses(self._max_stage), 0

    def judge(self) -> None:
        """A control step is over."""
        with self._lock:
            self._steps += 1

    def press(
        self,
        stage: int | None,
        time_s: float,
        note: Callable[[Press], None] = lambda _press: None,
        *,
        is_of_film: bool = False,
    ) -> Press:
        """Say that a stage is reached, or take the latest press back.

        Args:
            stage: The stage; None takes back.
            time_s: Seconds since the episode began.
            note: Writes the press down before anybody sees its effect.
            is_of_film: Whether the time is that of the film, which decides the control step.

        Raises:
            MessageError: There is no such stage, or nothing to take back; nothing is noted.
        """
        with self._pressing:
            step = min(round(time_s * CONTROL_HZ), self._steps) if is_of_film else self._steps
            press = Press(stage=stage, step=step, time_s=round(time_s, 3))
            before = self.presses
            after = Presses(self._max_stage, (*before.all, press))
            note(press)
            with self._lock:
                self._presses = after
        return press

    @property
    def presses(self) -> Presses:
        """What was pressed about this episode."""
        with self._lock:
            return Presses(self._max_stage, self._presses.all)

    @property
    def steps(self) -> int:
        """Control steps of this episode so far."""
        return self._steps

    @property
    def stage(self) -> int:
        """The highest stage that stands."""
        return self._presses.stage

    @property
    def final_holds(self) -> bool:
        """Whether the last stage is reached; whether it still holds is asked after the end."""
        return self.stage == self._max_stage

    def get_state(self) -> ProgressState:
        """The stage; nobody can say what a person remembers."""
        return ProgressState(stage=self.stage, final_holds=self.final_holds)

    def set_state(self, state: ProgressState) -> None:
        """Continue from a stage, as if it had just been pressed."""
        self.begin()
        if state.stage:
            self.press(state.stage, 0.0)
