"""Words of a record about a trial on real arms: stages that a person declares, kinds of fault."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

REACTION_S = 1.0
"""Seconds after the end of an episode within which a press is still about what was seen before it:
a person who presses at once needs 0.3 to 1 s [choice]. A later one is marked."""


@dataclass(frozen=True, kw_only=True, slots=True)
class StageLabel:
    """Label of a person who judges an episode, at one moment."""

    stage: int | None
    """The stage that is reached, as the person sees it; None takes back the latest label that
    stands."""
    step: int
    """Control steps that were executed by then."""
    time_s: float
    """Seconds since the episode began, on the rig's clock; those of its film, if it is corrected
    from that."""
    late: bool = False
    """Whether it is a stage that was said later than `REACTION_S` after the end."""


@dataclass(frozen=True, slots=True)
class StageLabels:
    """The labels of one person about one episode."""

    all: tuple[StageLabel, ...] = ()
    """Every label in the order of time, those that were taken back included."""

    @property
    def standing(self) -> list[StageLabel]:
        """Labels that were not taken back."""
        found: list[StageLabel] = []
        for label in self.all:
            if label.stage is None:
                found.pop()
            else:
                found.append(label)
        return found

    @property
    def stage(self) -> int:
        """The highest stage that stands."""
        return max((label.stage or 0 for label in self.standing), default=0)

    @property
    def is_late(self) -> bool:
        """Whether the highest stage stands by late labels alone."""
        on_time = (label.stage or 0 for label in self.standing if not label.late)
        return self.stage > max(on_time, default=0)

    def changes(self) -> tuple[tuple[int, int], ...]:
        """Pairs (control step, stage): when each newly reached stage was reached."""
        found: dict[int, int] = {}
        highest = 0
        for label in sorted(self.standing, key=lambda label: label.step):
            stage = label.stage or 0
            if stage > highest:
                found[label.step] = highest = (
                    stage  # of two at one step the higher one counts
                )
        return tuple(found.items())


class FaultKind(StrEnum):
    """Kind of a fault, which decides how a trial counts."""

    PERSON = "person"
    """A person stopped an arm: the emergency stop, a door, a button of the arm."""
    CONTACT = "contact"
    """An arm ran into something, or was about to; it counts as a failure of who led it."""
    LIMIT = "limit"
    """An arm was told to go where, or as fast as, it may not; the operator says whose doing it
    was."""
    CONTROLLER = "controller"
    """Our own software did what it should not."""
    COMMUNICATION = "communication"
    """A network, a cable, a computer, a gripper or a camera."""

    @property
    def may_count(self) -> bool:
        """Whether a trial that it ended may count against the policy."""
        return self in {FaultKind.CONTACT, FaultKind.LIMIT}

    def fault(self, text: str) -> Fault:
        """A fault of this sort, in words for people."""
        return Fault(kind=self, text=text)


@dataclass(frozen=True, kw_only=True, slots=True)
class Fault:
    """Fault that a device reports."""

    kind: FaultKind
    text: str
    """Description in words for people."""
