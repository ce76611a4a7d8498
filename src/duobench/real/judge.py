"""A judge whose stages a person declares, from any thread.

The rule is that of the paper: the highest stage that was declared counts, and no other word makes
it fall. What was declared by mistake is taken back; both stay in the log.
"""

import threading
from collections.abc import Callable

from duobench.core.errors import OptionError
from duobench.core.types import CONTROL_HZ
from duobench.results.labels import REACTION_S, StageLabel, StageLabels
from duobench.tasks.stages.progress import ProgressState


class HumanJudge:
    """Judge on real arms in place of `TaskStages`: the highest stage that a person declared.

    What is declared counts from the next control step on, so that every step has one stage. Labels
    have times of the clock `now`, in seconds.
    """

    def __init__(self, max_stage: int, now: Callable[[], float] = lambda: 0.0) -> None:
        self.max_stage = max_stage
        """The last stage of the task."""
        self._now = now
        self._lock = (
            threading.Lock()
        )  # one word after the other; no control step waits for it
        self.begin()

    def begin(self) -> None:
        """Begin an episode at stage 0, without labels."""
        with self._lock:
            self.labels = StageLabels()
            """Everything that was declared in this episode, also since the last control step."""
            self.steps = 0
            """Control steps of this episode so far."""
            self.stage = 0
            """The stage as of the last control step."""
            self._start = self._now()
            self._end: float | None = None

    def end(self) -> None:
        """The episode is over: what is declared from now on may be late."""
        self._end = self.time_s

    @property
    def is_over(self) -> bool:
        """Whether the episode is over and the next one has not begun."""
        return self._end is not None

    def judge(self) -> None:
        """Count a control step, and take over what was declared until now."""
        self.steps += 1
        self.stage = self.labels.stage

    @property
    def final_holds(self) -> bool:
        """Whether the last stage is reached; whether it still holds is asked after the end."""
        return self.stage == self.max_stage

    @property
    def time_s(self) -> float:
        """Seconds since the episode began."""
        return max(0.0, self._now() - self._start)

    def declare(
        self,
        stage: int | None,
        film_s: float | None = None,
        note: Callable[[StageLabel], None] = lambda _label: None,
    ) -> StageLabel:
        """Say that a stage is reached, or with None take the latest label back.

        Earlier stages may be skipped. It was reached now, or at `film_s` seconds of the episode's
        film; what is said after the end counts at the last step, and may be `late`. `note` writes
        the label down before its effect is shown.
        """
        with self._lock:
            if stage is None and not self.labels.standing:
                raise OptionError("There is no press to take back.")
            if stage is not None and not 0 < stage <= self.max_stage:
                raise OptionError(f"The stages are 1 to {self.max_stage}, got {stage}.")
            time_s = self.time_s
            step = self.steps
            end = self._end
            if film_s is not None:
                time_s, step, end = (
                    film_s,
                    min(round(film_s * CONTROL_HZ), step),
                    step / CONTROL_HZ,
                )
            late = stage is not None and end is not None and time_s > end + REACTION_S
            label = StageLabel(
                stage=stage, step=step, time_s=round(time_s, 3), late=late
            )
            note(label)
            self.labels = StageLabels((*self.labels.all, label))
        return label

    def get_state(self) -> ProgressState:
        """The stage and whether it is the last one."""
        return ProgressState(stage=self.stage, final_holds=self.final_holds)

    def set_state(self, state: ProgressState) -> None:
        """Continue from a stage, as if it had just been declared."""
        self.begin()
        if state.stage:
            self.declare(state.stage)
        self.stage = state.stage
