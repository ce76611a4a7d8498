"""Takes: recordings as a person looks at them again, with what was said about them."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from duobench.core.types import CONTROL_HZ
from duobench.data import EpisodeInfo, Recording
from duobench.data.reviews import Reviews
from duobench.results.attempts import FAILURE, SUCCESS

CUT, TRIMMED = "cut", "success trimmed away"
"""Ends of a recording in words, beside success and failure."""
UNUSED = "not to be used"


@dataclass(frozen=True, kw_only=True, slots=True)
class Take:
    """A recording, as it stands after all that was said about it."""

    task: str
    operator: str
    """Those who acted: pseudonyms of people, names of policies, or the kind of actor."""
    device: str
    led_s: float
    """Seconds in which the world ran, as the page of a session counts them."""
    stage: int
    max_stage: int
    end: str
    """How it ended: success, failure, cut, or a success whose row is not among those that are
    used."""
    kept: bool
    exported: bool
    """Whether exports take it by default: a person's without success they leave out."""
    reason: str = ""
    """Why it is not kept."""
    note: str = ""
    rows: tuple[int, int] | None = None
    """First and last row that are used; None is all of them."""
    by: str = ""
    at: str = ""
    """Who said the newest thing that stands, and when; empty where nothing stands."""

    def __str__(self) -> str:
        """The take in a line."""
        stage = f"stage {self.stage} of {self.max_stage}"
        end = f"{self.operator}: {self.end}, {stage}"
        return end if self.kept else f"{end}, {UNUSED}"


@dataclass(frozen=True, kw_only=True, slots=True)
class Recorded:
    """What the file of a recording says, which never changes."""

    path: Path
    info: EpisodeInfo
    length: int
    """Number of its actions."""

    @staticmethod
    def read(path: Path) -> "Recorded":
        """Read a file; a `DataError` if it cannot be read."""
        return Recorded(
            path=path,
            info=Recording.read_info(path),
            length=Recording.read_length(path),
        )

    def take(self, reviews: Reviews) -> Take:
        """The take after what was said about it."""
        judgement = reviews.of(self.path)
        info = judgement.judged(self.info)
        outcome = info.outcome
        is_kept = outcome is not None and outcome.kept
        end = FAILURE
        if outcome is None or outcome.cut:
            end = CUT
        elif outcome.success:
            end = SUCCESS
        elif self.info.outcome is not None and self.info.outcome.success:
            end = TRIMMED
        return Take(
            task=info.task,
            operator=_words(actor.name or str(actor.kind) for actor in info.actors),
            device=_words(actor.device or "" for actor in info.actors),
            led_s=round(self.length / CONTROL_HZ, 1),
            stage=0 if outcome is None else outcome.stage,
            max_stage=0 if outcome is None else outcome.max_stage,
            end=end,
            kept=is_kept,
            exported=is_kept and not info.is_led_failure,
            reason="" if outcome is None else outcome.reason or "",
            note=judgement.note,
            rows=None if judgement.rows == (0, self.length) else judgement.rows,
            by=judgement.by,
            at=judgement.at,
        )


def _words(words: Iterable[str]) -> str:
    """Words that are there, each once."""
    return ", ".join(dict.fromkeys(filter(None, words)))
