"""A judge whose stages a person declares, from any thread.

The rule is that of the paper: a stage never falls. A person may take back what was declared by
mistake; both stay in the log.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass

from duobench.errors import OptionError
from duobench.stages.progress import ProgressState


@dataclass(frozen=True, kw_only=True, slots=True)
class StageLabel:
    """One thing that a person said."""

    time_s: float
    """When, on the judge's clock."""
    step: int
    stage: int
    """The stage that was declared, or that holds again after an undo."""
    is_undo: bool = False


class HumanJudge:
    """The judge of `TaskStages` on real arms: the highest stage that a person declared.

    What is declared counts from the next control step on, so that every step has one stage.

    Args:
        max_stage: The last stage of the task.
        now: A clock in seconds, for the log.
    """

    def __init__(self, max_stage: int, now: Callable[[], float] = lambda: 0.0) -> None:
        self._max, self._now = max_stage, now
        self._lock = threading.Lock()
        self.begin()

    def begin(self) -> None:
        """Begin an episode at stage 0, with an empty log."""
        with self._lock:
            self._stages = [0]
            self._log: list[StageLabel] = []
            self._steps = 0
            self._at_end: bool | None = None
            self._judged = 0

    def judge(self) -> None:
        """Count a control step, and take over what was declared until now."""
        with self._lock:
            self._steps += 1
            self._judged = self._stages[-1]

    @property
    def stage(self) -> int:
        """The stage as of the last control step."""
        return self._judged

    @property
    def final_holds(self) -> bool:
        """Whether the task is solved right now: as declared, or where the last stage is reached."""
        at_end = self._at_end
        return self._judged == self._max if at_end is None else at_end

    @property
    def declared(self) -> int:
        """The stage that was declared, which counts from the next control step on."""
        return self._stages[-1]

    @property
    def log(self) -> tuple[StageLabel, ...]:
        """Everything that was said in this episode."""
        with self._lock:
            return tuple(self._log)

    def declare(self, stage: int) -> bool:
        """Say that a stage is reached; earlier ones may be skipped.

        Returns:
            Whether it is higher than what was declared before; otherwise nothing changes.

        Raises:
            OptionError: The task has no such stage.
        """
        if not 0 < stage <= self._max:
            raise OptionError(f"The stages are 1 to {self._max}, got {stage}.")
        with self._lock:
            if stage <= self._stages[-1]:
                return False
            self._stages.append(stage)
            self._write(stage)
            return True

    def undo(self) -> bool:
        """Take back the latest declaration; returns whether there was one."""
        with self._lock:
            if len(self._stages) == 1:
                return False
            self._stages.pop()
            self._write(self._stages[-1], is_undo=True)
            return True

    def declare_end(self, is_solved: bool | None) -> None:
        """Say whether the task is solved at the end; None leaves it to the stage."""
        self._at_end = is_solved

    def get_state(self) -> ProgressState:
        """The stage and whether the task is solved."""
        return ProgressState(stage=self.stage, final_holds=self.final_holds)

    def set_state(self, state: ProgressState) -> None:
        """Continue from a stage, with an empty log."""
        self.begin()
        with self._lock:
            if state.stage:
                self._stages.append(state.stage)
            self._judged = state.stage

    def _write(self, stage: int, *, is_undo: bool = False) -> None:
        said = StageLabel(time_s=self._now(), step=self._steps, stage=stage, is_undo=is_undo)
        self._log.append(said)
