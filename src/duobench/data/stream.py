"""An episode while it is being recorded, in memory or in a file that survives a kill.

Rows are appended to the file as they lie in memory, a few at a time, after a head that says what
they are. When the episode ends, all of it is written as Parquet, and the file is removed. What a
killed process leaves can be read up to its last whole row; see `recover`.
"""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from duobench.core.errors import (
    DataError,
    DuoBenchError,
    FileError,
    OutputError,
)
from duobench.core.files import (
    check_there,
    decode,
    encode,
    lock,
    make_folder,
    remove,
    writing,
)
from duobench.data.recording import Recording, success_start
from duobench.data.schema import (
    COLUMNS,
    LEADER,
    SCHEMA,
    EpisodeInfo,
    Outcome,
    video_path,
)
from duobench.data.videos import Videos, recovered

SUFFIX = ".part"
"""Ending of the file of an episode that is being recorded."""
BATCH_ROWS = 8
"""Rows that are written at a time: 0.27 seconds, which is what a kill may cost."""
INTERRUPTED = "The recording was interrupted."
"""Reason of the end of a recovered episode."""
_FIRST_CAPACITY = 512  # rows; it doubles
_ROOM_BYTES = 1 << 14
"""Bytes after the head for those who lead later, and why: hundreds of them."""
_LENGTH_BYTES = 8
"""Bytes before the head that say how long it is."""


@dataclass(frozen=True, kw_only=True, slots=True)
class _Head:
    """Head of the file."""

    info: EpisodeInfo
    sizes: dict[str, int]
    """Numbers in one row of the columns that have as many as there are."""
    has_leader: bool = False
    """Whether rows say who led, which those of earlier versions did not."""

    def row_type(self) -> np.dtype[Any]:
        """Type of a row in memory and in the file."""
        fields = [
            (
                column.name,
                column.dtype,
                column.row_shape(self.info, self.sizes.get(column.name, 0)),
            )
            for column in COLUMNS
            if column.name != LEADER or self.has_leader
        ]
        return np.dtype(fields, align=True)


class EpisodeRows:
    """Takes the rows of one episode, in memory.

    Args:
        info: What is known about the episode at its start.
        sizes: Numbers in one row of `action` and `state`.
    """

    def __init__(self, info: EpisodeInfo, sizes: Mapping[str, int]) -> None:
        self.info = info
        """Facts about it, which grow."""
        self.videos: Videos | None = None
        self._head = _Head(
            info=info,
            sizes=dict(sizes),
            has_leader=True,
        )
        self._rows = np.zeros(_FIRST_CAPACITY, self._head.row_type())
        self._count = 0

    @property
    def rows(self) -> NDArray[Any]:
        """All rows so far, with a field for each column; the action of the last one is to come."""
        return self._rows[: self._count]

    def append(self, row: Mapping[str, Any]) -> None:
        """Append what was seen, by the names of columns; its action follows with `complete`."""
        if self._count == len(self._rows):
            self._rows = np.concatenate([self._rows, np.zeros_like(self._rows)])
        for name, value in row.items():
            self._rows[name][self._count] = value
        self._count += 1

    def complete(self, row: Mapping[str, Any]) -> None:
        """Fill columns of the last row: its action and what the step gave, or what is seen anew."""
        for name, value in row.items():
            self._rows[name][self._count - 1] = value

    def note(self, **facts: Any) -> None:
        """Note facts about the episode that came up while it ran, by their names in `info`."""
        self.info = replace(self.info, **facts)

    def finish(self, folder: Path | None = None) -> Recording:  # noqa: ARG002 - it has no file
        """The whole episode, which ends here as `info` says."""
        return _recording(self.info, self.rows)

    def flush(self) -> None:
        """Write every row, the last one too, which no action follows any more."""

    def discard(self) -> None:
        """Forget the episode if it was not finished."""


class EpisodeStream(EpisodeRows):
    """Takes them in a file beside the finished episode, which is locked while it is open."""

    def __init__(
        self,
        path: Path,
        info: EpisodeInfo,
        sizes: Mapping[str, int],
    ) -> None:
        super().__init__(info, sizes)
        self.path = path
        self._written = 0
        make_folder(path.parent)
        self._partial = path.with_suffix(SUFFIX)
        text = self._head_text(info)
        text = text.ljust(len(text) + _ROOM_BYTES)
        with writing(self._partial):
            try:
                self._file = self._partial.open("xb")
            except FileExistsError as error:
                raise DataError(
                    f"{self._partial} exists: the episode is being recorded by another process, or "
                    "its recording was killed. Recover or delete it first."
                ) from error
        try:  # only now, when no other process can begin one of that name
            check_free(path, *(video_path(path, camera) for camera in info.videos))
            with writing(self._partial):
                lock(self._file.fileno(), self._partial)
                self._file.write(len(text).to_bytes(_LENGTH_BYTES, "little") + text)
                self._file.flush()
        except DuoBenchError:
            self._remove()
            raise
        self._start = self._file.tell()

    def note(self, **facts: Any) -> None:
        """Note facts; in the file too, if they fit into the room of its head."""
        super().note(**facts)
        room = self._start - _LENGTH_BYTES
        text = self._head_text(self.info).ljust(room)
        if len(text) == room:
            with writing(self._partial):
                self._file.seek(_LENGTH_BYTES)
                self._file.write(text)
                self._file.flush()

    def _head_text(self, info: EpisodeInfo) -> bytes:
        """Head of the file with some facts, as it is written."""
        return encode(replace(self._head, info=info), SCHEMA).encode(errors="replace")

    def append(self, row: Mapping[str, Any]) -> None:
        """Append what was seen, and write what is complete now and then."""
        super().append(row)
        if self._count - self._written > BATCH_ROWS:
            # All but the last row, whose action is still to come.
            self._flush(self._count - 1)

    def flush(self) -> None:
        """Write every row, the last one too, and all that waits for the videos."""
        if self.videos is not None:
            self.videos.close()
        self._flush(self._count)

    def finish(self, folder: Path | None = None) -> Recording:
        """Write the whole episode as Parquet, by default beside the stream, and remove that."""
        place = self.path if folder is None else folder / self.path.name
        try:
            if self.videos is not None:
                self.info = replace(self.info, videos=self.videos.finish())
            recording = super().finish()
            check_free(place)
            check_there(self.path.parent)
            recording.write(place)
            for camera in self.info.videos if folder is not None else ():
                with writing(place), suppress(FileNotFoundError):  # one without a frame
                    video_path(self.path, camera).rename(video_path(place, camera))
        except DuoBenchError:
            self.close()
            raise
        self._remove()
        return recording

    def discard(self) -> None:
        """Remove the stream and its videos; the episode is lost if it was not finished."""
        if self.videos is not None:
            self.videos.discard()
        self._remove()

    def _remove(self) -> None:
        self._release()
        remove(self._partial)

    def close(self) -> None:
        """Let go of the file, with all rows in it that can be written."""
        with suppress(OutputError):
            self.flush()
        self._release()

    def _release(self) -> None:
        with suppress(OSError):  # rows that could not be written were complained about
            self._file.close()

    def _flush(self, end: int) -> None:
        """Write the rows before one; where it failed before, it begins again at the same place."""
        with writing(self._partial):
            self._file.seek(self._start + self._written * self._rows.itemsize)
            self._file.write(self._rows[self._written : end].data)
            self._file.flush()
        self._written = end


def check_free(*paths: Path) -> None:
    """Raise a `DataError` where one of some files is there."""
    for path in paths:
        if path.exists():
            raise DataError(f"{path} exists already; an episode is never overwritten.")


def recover(partial: Path) -> Recording:
    """The episode that a killed recording has left, up to its last whole row, marked as cut.

    Rows whose frames were not encoded yet name the newest one that is in the video, and its age.
    """
    info, rows = read_left(partial)
    if info.videos:
        rows, videos = recovered(partial, info, rows)
        info = replace(info, videos=videos)
    if not len(rows):
        raise DataError(
            f"Cannot recover {partial}: it ends before its first rows were written."
        )
    outcome = outcome_of(
        info,
        rows,
        kept=False,
        reason=INTERRUPTED,
        cut=True,
    )
    return _recording(replace(info, outcome=outcome), rows)


def outcome_of(
    info: EpisodeInfo, rows: NDArray[Any], *, kept: bool, reason: str | None, cut: bool
) -> Outcome:
    """Outcome of an episode from its rows, at least one."""
    return Outcome(
        success=bool(rows["success"][-1]),
        stage=int(rows["stage"][-1]),
        max_stage=len(info.subinstructions),
        kept=kept,
        reason=reason,
        cut=cut,
        success_step=success_start(rows["success"]),
    )


def _recording(info: EpisodeInfo, rows: NDArray[Any]) -> Recording:
    """The episode of some rows; the action of the last one is not known, or led to none of them."""
    columns = {
        column.name: rows[column.name][: len(rows) - column.of_action]
        for column in COLUMNS
    }
    return Recording(info=info, **columns)


def read_left(partial: Path) -> tuple[EpisodeInfo, NDArray[Any]]:
    """Facts about an episode when it began, and its whole rows, with that error."""
    try:
        data = partial.read_bytes()
        end = _LENGTH_BYTES + int.from_bytes(data[:_LENGTH_BYTES], "little")
        head = decode(data[_LENGTH_BYTES:end], _Head, SCHEMA)
        kind = head.row_type()
        rows = np.frombuffer(data[end:], kind, max(0, len(data) - end) // kind.itemsize)
    except (OSError, FileError, KeyError, ValueError) as error:
        raise DataError(f"Cannot recover {partial}: {error}") from error
    if head.has_leader:
        return head.info, rows
    whole = np.zeros(len(rows), replace(head, has_leader=True).row_type())
    for name in kind.names or ():
        whole[name] = rows[name]
    return head.info, whole
