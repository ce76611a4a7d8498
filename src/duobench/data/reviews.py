"""A second look at recordings: a log beside them, of what people said about them later.

A file of a recording is never touched: what its log says is applied where it is read. A line of the
log says one thing about one recording, and who said it when. It holds for the recording that it
names by its checksum, not for another one that later has the same name.
"""

import codecs
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import lru_cache
from itertools import chain
from pathlib import Path
from typing import Annotated

import msgspec

from duobench.core.errors import DataError, FileError
from duobench.core.files import append_line
from duobench.data.recording import Recording
from duobench.data.schema import EpisodeInfo, Outcome

REVIEWS = "reviews.jsonl"
"""Name of the log in the folder of a data set."""
DISCARDED = "Discarded at a second look."
"""Reason why an episode is not kept, before a note."""
MAX_TEXT = 500
"""Characters of a note, and of who says it."""
_Row = Annotated[int, msgspec.Meta(ge=0)]
_Text = Annotated[str, msgspec.Meta(max_length=MAX_TEXT)]


class Review(
    msgspec.Struct,
    frozen=True,
    kw_only=True,
    omit_defaults=True,
    forbid_unknown_fields=True,
):
    """One line: what somebody said about a recording; what is None or empty stays as it was."""

    episode: str
    """Its task and name, `bin_sort/00003`."""
    facts: str
    """Its checksum; see `Recording.read_checksum`."""
    at: str
    """When it was said, in UTC."""
    by: _Text = ""
    """Pseudonym of who said it."""
    kept: bool | None = None
    """Whether it is meant to be used."""
    note: _Text | None = None
    rows: tuple[_Row, _Row] | None = None
    """First and last row that are used, of those that it has; what lies before and after is not."""
    undo: bool = False
    """Whether it takes back the newest line about the recording that stands."""

    def __post_init__(self) -> None:
        says = [each is not None for each in (self.kept, self.note, self.rows)]
        if self.undo == any(says):
            raise ValueError(
                "one line keeps, discards, notes or trims, or takes the last one back"
            )
        if self.rows is not None and self.rows[0] >= self.rows[1]:
            raise ValueError(f"the first row is before the last one, not {self.rows}")


@dataclass(frozen=True, kw_only=True, slots=True)
class Judgement:
    """What stands about a recording after all that was said about it later."""

    kept: bool | None = None
    """Whether it is meant to be used; None is as it was recorded."""
    note: str = ""
    rows: tuple[int, int] | None = None
    """First and last row that are used; None is all of them."""
    by: str = ""
    at: str = ""
    """Who said the newest thing that stands, and when; empty where nothing stands."""

    @staticmethod
    def of(reviews: Iterable[Review]) -> "Judgement":
        """What stands after some lines about one recording, in their order."""
        standing: list[Review] = []
        for review in reviews:
            if not review.undo:
                standing.append(review)
            elif standing:
                standing.pop()
        found = Judgement()
        for review in standing:
            found = Judgement(
                kept=found.kept if review.kept is None else review.kept,
                note=found.note if review.note is None else review.note,
                rows=found.rows if review.rows is None else review.rows,
                by=review.by,
                at=review.at,
            )
        return found

    def says(
        self,
        *,
        kept: bool | None = None,
        note: str | None = None,
        rows: tuple[int, int] | None = None,
        undo: bool = False,
        by: str = "",  # noqa: ARG002 - it is no matter
    ) -> bool:
        """Whether it would be the same after a line with these words; see `Reviews.add`."""
        said = {"kept": kept, "note": note, "rows": rows}
        news = [name for name, value in said.items() if value is not None]
        return not undo and all(getattr(self, name) == said[name] for name in news)

    def judged(self, info: EpisodeInfo) -> EpisodeInfo:
        """The facts about an episode with this judgement in its outcome.

        A success whose row was trimmed away is none.
        """
        outcome = info.outcome
        if outcome is None:
            return info
        if self.kept is not None:
            reason = None if self.kept else f"{DISCARDED} {self.note}".strip()
            outcome = replace(
                outcome,
                kept=self.kept,
                reason=reason,
            )
        return replace(info, outcome=self._trimmed(outcome))

    def _trimmed(self, outcome: Outcome) -> Outcome:
        """An outcome without a success whose row is not among those that are used."""
        step = outcome.success_step
        if self.rows is None or step is None or self.rows[0] < step <= self.rows[1]:
            return outcome
        return replace(
            outcome,
            success=False,
            success_step=None,
        )


class Reviews:
    """The log of a data set, as it was when it was read last.

    Any number of processes may write into it. Half a line of one that was killed is left out, as
    is every line that cannot be read.

    Args:
        folder: Folder of the data set; it need not have a log.

    Raises:
        FileError: The log cannot be read.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / REVIEWS
        self.unreadable: dict[int, str] = {}
        """Lines that cannot be read, by their numbers from 1 on, and why."""
        self.reviews: list[Review] = []
        """All other lines, the oldest first."""
        self._of: dict[str, list[Review]] = {}
        self._seen: tuple[int, int] | None = None
        self.refresh()

    def refresh(self) -> bool:
        """Read it again if it has changed; whether it has."""
        try:
            status = self.path.stat()
            seen = (status.st_size, status.st_mtime_ns)
            if seen == self._seen:
                return False
            text = self.path.read_bytes()
        except FileNotFoundError:
            seen, text = None, b""
        except OSError as error:
            raise FileError(f"Cannot read {self.path}: {error.strerror}.") from error
        self._seen = seen
        self.unreadable, self.reviews, self._of = {}, [], {}
        text = text.removeprefix(codecs.BOM_UTF8)  # some editors begin with it
        for number, line in enumerate(text.splitlines(), start=1):
            if not line.strip():
                continue
            try:
                review = msgspec.json.decode(line, type=Review)
            except (msgspec.MsgspecError, UnicodeError, RecursionError) as error:
                self.unreadable[number] = f"{error}"
            else:
                self.reviews.append(review)
                self._of.setdefault(review.episode, []).append(review)
        return True

    def about(self, episode: Path) -> list[Review]:
        """Lines about the recording in a file, the oldest first.

        Raises:
            DataError: The file cannot be read.
        """
        found = self._of.get(name_of(episode), [])
        if not found:
            return []
        try:
            changed_ns = episode.stat().st_mtime_ns
        except OSError as error:
            raise DataError(f"Cannot read {episode}: {error.strerror}.") from error
        facts = _checksum(episode, changed_ns)
        return [review for review in found if review.facts == facts]

    def of(self, episode: Path) -> Judgement:
        """What stands about the recording in a file; see `about`."""
        return Judgement.of(self.about(episode))

    def read_info(self, episode: Path) -> EpisodeInfo:
        """Facts about the episode in a file, as it was judged last; see `Recording.read_info`."""
        return self.of(episode).judged(Recording.read_info(episode))

    def add(
        self,
        episode: Path,
        *,
        by: str = "",
        kept: bool | None = None,
        note: str | None = None,
        rows: tuple[int, int] | None = None,
        undo: bool = False,
    ) -> Review:
        """Write a line about the recording in a file; what is None stays as it was.

        Args:
            episode: The file.
            by: Pseudonym of who says it.
            kept: Whether it is meant to be used.
            note: What else there is to say; empty for nothing any more.
            rows: First and last row that are used.
            undo: Take back the newest line that stands, and say nothing else.

        Raises:
            DataError: It says nothing, or what cannot be; or the file cannot be read.
            OutputError: The log cannot be written.
        """
        length = Recording.read_length(episode)
        if rows is not None and rows[1] > length:
            raise DataError(f"The rows of {episode} are 0 to {length}, got {rows}.")
        said = {
            "episode": name_of(episode),
            "facts": Recording.read_checksum(episode),
            "at": datetime.now(UTC).isoformat(timespec="milliseconds"),
            "by": by,
            "kept": kept,
            "note": note,
            "rows": rows,
            "undo": undo,
        }
        try:
            review = msgspec.convert(said, Review)
            msgspec.json.encode(review)
        except (msgspec.ValidationError, UnicodeEncodeError) as error:
            text = f"This cannot be said about {episode}: {error}".rstrip(".")
            raise DataError(f"{text}.") from error
        if undo and self.of(episode) == Judgement():
            raise DataError(f"Nothing was said about {name_of(episode)} that stands.")
        self.append([review])
        return review

    def append(self, reviews: Iterable[Review]) -> None:
        """Write lines, such as those of another log."""
        for review in reviews:
            append_line(self.path, msgspec.json.encode(review))
        self.refresh()

    def take_over(self, copies: Iterable[tuple[Path, Path]]) -> None:
        """Take over what other logs say about files that were copied here.

        Args:
            copies: The file in its data set, and its place here, which may have another name.
        """
        logs: dict[Path, Reviews] = {}
        said: dict[str, list[list[Review]]] = {}
        for path, place in copies:
            folder = path.parents[2]
            if folder not in logs:
                logs[folder] = Reviews(folder)
            said.setdefault(name_of(place), []).append(logs[folder].about(path))
        known = set(self.reviews)
        for name, of_copies in said.items():
            lines = joined(of_copies, name)
            self.append(line for line in lines if line not in known)


def joined(logs: Iterable[Sequence[Review]], name: str = "") -> list[Review]:
    """Join what several logs say about copies of one recording, each line once.

    Lines of a log stay together and in their order, whatever their clocks say: one that takes back
    is about the one before it. The log that was written last has the last word.

    Args:
        logs: The lines of each.
        name: Name of the recording from now on.
    """
    written = [lines for lines in logs if lines]
    written.sort(key=lambda lines: max(line.at for line in lines))
    named = [msgspec.structs.replace(line, episode=name) for line in chain(*written)]
    return list(dict.fromkeys(named))


@lru_cache(maxsize=4096)
def _checksum(episode: Path, changed_ns: int) -> str:  # noqa: ARG001 - of a file that may change
    """Checksum of a file, which is read once for each time that it changed."""
    return Recording.read_checksum(episode)


def name_of(episode: Path) -> str:
    """The name of the file of a recording in its data set: its task and its own, with a slash."""
    return f"{episode.parent.name}/{episode.stem}"
