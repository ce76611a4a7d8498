"""Episodes that operators have led, by task, operator and device.

They come from recordings and from the log of attempts. Those that were discarded count too, so that
shares of successes are those of all that was begun.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from statistics import mean, median

from duobench.core.types import CONTROL_HZ
from duobench.data.attempts import SKIPPED, Attempt
from duobench.data.recording import Recording
from duobench.data.schema import PEOPLE

UNKNOWN = "unknown"
"""Device of an episode that does not say it."""


@dataclass(frozen=True, kw_only=True, slots=True)
class LedEpisode:
    """Episode that an operator has begun, kept or not."""

    task: str
    operator: str
    """Kind and pseudonym of who led first."""
    device: str
    success: bool
    stage: int
    """Highest stage that was reached."""
    led_s: float | None
    """Seconds in which the world ran until success, or until the end; None if they are not
    known."""

    @property
    def key(self) -> tuple[str, str, str]:
        """Task, operator and device."""
        return self.task, self.operator, self.device

    @staticmethod
    def of(recording: Recording) -> "LedEpisode | None":
        """The episode of a recording; None if a policy began it."""
        info = recording.info
        if info.actor.kind not in PEOPLE:
            return None
        outcome = info.outcome
        return LedEpisode(
            task=info.task,
            operator=info.actor.words,
            device=info.actor.device or UNKNOWN,
            success=outcome is not None and outcome.success,
            stage=0 if outcome is None else outcome.stage,
            led_s=recording.steps / CONTROL_HZ,
        )


@dataclass(frozen=True, kw_only=True, slots=True)
class Leading:
    """Sum of the episodes of one task that one operator has led with one device."""

    task: str
    operator: str
    device: str
    begun: int
    successes: int
    stage: float
    """Highest stage that was reached, in the mean."""
    led_s: float | None
    """Median of the led seconds until success; None without a recorded success."""


def episodes_without_file(
    attempts: Iterable[Attempt], names: set[str]
) -> list[LedEpisode]:
    """Return episodes of attempts that have no file, by the names of those that have."""
    return [
        LedEpisode(
            task=each.task,
            operator=each.actor.words,
            device=each.actor.device or UNKNOWN,
            success=each.success,
            stage=each.stage,
            led_s=None,
        )
        for each in attempts
        if each.actor is not None
        and each.error != SKIPPED
        and f"{each.episode:05d}" not in names
    ]


def add_up(episodes: Sequence[LedEpisode]) -> tuple[Leading, ...]:
    """Add episodes up, in the order of their tasks, operators and devices."""
    keys = sorted({each.key for each in episodes})
    return tuple(_added([each for each in episodes if each.key == key]) for key in keys)


def _added(episodes: Sequence[LedEpisode]) -> Leading:
    """Add up episodes of one task, operator and device."""
    first = episodes[0]
    seconds = [
        each.led_s for each in episodes if each.success and each.led_s is not None
    ]
    return Leading(
        task=first.task,
        operator=first.operator,
        device=first.device,
        begun=len(episodes),
        successes=sum(each.success for each in episodes),
        stage=mean(each.stage for each in episodes),
        led_s=median(seconds) if seconds else None,
    )
