"""An episode while it is being recorded: an append-only file that survives a kill.

Rows are appended to an Arrow stream, a few at a time. When the episode ends, all of it is written
as Parquet, and the stream is removed. What a killed process leaves can be read up to its last whole
batch; see `recover`.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from duobench.data.recording import Recording, arrow_array, arrow_schema, info_of
from duobench.data.schema import COLUMNS, EpisodeInfo, Outcome
from duobench.errors import DataError
from duobench.files import make_folder, writing

SUFFIX = ".part"
"""Ending of the file of an episode that is being recorded."""
BATCH_ROWS = 24
"""Rows that are written at a time: 0.8 seconds, which is what a kill may cost."""
_FIRST_CAPACITY = 512
"""Rows that are made room for at first."""


class EpisodeStream:
    """Takes the rows of one episode."""

    def __init__(self, path: Path, info: EpisodeInfo, sizes: Mapping[str, int]) -> None:
        """Begin a file; nobody else may be writing an episode of that name.

        Args:
            path: Where the finished episode will be.
            info: What is known about it at its start.
            sizes: Numbers in one row of `action` and `state`.

        Raises:
            OutputError: The file cannot be made.
            FileExistsError: The episode is being recorded by somebody, or was left by a crash.
        """
        self.path = path
        """Where the finished episode will be."""
        self._info = info
        self._buffers = {
            column.name: np.zeros(
                (_FIRST_CAPACITY, *(size or sizes[column.name] for size in column.shape)),
                column.dtype,
            )
            for column in COLUMNS
        }
        self._rows = self._written = 0
        make_folder(path.parent)
        self._partial = path.with_suffix(SUFFIX)
        # Opened before it is handed to Arrow, so that no two processes take the same name.
        self._file = self._partial.open("xb")
        self._schema = arrow_schema(info, dict(sizes))
        with writing(self._partial):
            self._stream = pa.ipc.new_stream(self._file, self._schema)
            self._file.flush()

    def append(self, row: Mapping[str, Any]) -> None:
        """Append what was seen; its action follows with `act`.

        Args:
            row: Values by the name of the column, of those that do not belong to the action.

        Raises:
            OutputError: The file cannot be written.
        """
        if self._rows == len(self._buffers["time"]):
            for name, buffer in self._buffers.items():
                self._buffers[name] = np.concatenate([buffer, np.zeros_like(buffer)])
        for name, value in row.items():
            self._buffers[name][self._rows] = value
        self._rows += 1
        if self._rows - self._written > BATCH_ROWS:
            self._flush()

    def act(self, row: Mapping[str, Any]) -> None:
        """Complete the last row with its action and what the step gave.

        Args:
            row: Values by the name of the column, of those that belong to the action.
        """
        for name, value in row.items():
            self._buffers[name][self._rows - 1] = value

    def finish(self, outcome: Outcome, last_hash: str | None) -> Recording:
        """Write the whole episode as Parquet and remove the stream.

        Returns:
            What was written.

        Raises:
            OutputError: It cannot be written; the stream stays.
        """
        info = replace(self._info, outcome=outcome, last_hash=last_hash)
        recording = Recording(
            info=info,
            **{
                column.name: self._buffers[column.name][: self._rows - column.of_action]
                for column in COLUMNS
            },
        )
        recording.write(self.path)
        self.discard()
        return recording

    def discard(self) -> None:
        """Remove the stream; the episode is lost if it was not finished."""
        self.close()
        self._partial.unlink(missing_ok=True)

    def close(self) -> None:
        """Let go of the file and leave it as it is."""
        if not self._file.closed:
            self._stream.close()
            self._file.close()

    def _flush(self) -> None:
        """Write the rows that are complete: all but the last one, whose action is still to come."""
        span = slice(self._written, self._rows - 1)
        arrays = [arrow_array(column, self._buffers[column.name][span]) for column in COLUMNS]
        with writing(self._partial):
            self._stream.write_batch(pa.record_batch(arrays, schema=self._schema))
            self._file.flush()
        self._written = span.stop


def recover(partial: Path) -> Recording:
    """What can be read of an episode whose recording was killed.

    Args:
        partial: The stream that was left.

    Returns:
        The episode up to its last whole batch, marked as cut.

    Raises:
        DataError: Nothing of it can be read; the message names the file.
    """
    batches = []
    try:
        with pa.OSFile(str(partial)) as file, pa.ipc.open_stream(file) as reader:
            info = info_of(reader.schema)
            with suppress(OSError, pa.ArrowException):  # the batch that was being written
                for batch in reader:
                    batches.append(batch)
    except (OSError, pa.ArrowException, DataError) as error:
        raise DataError(f"Cannot recover {partial}: {error}") from error
    rows = {
        column.name: [_rows(batch.column(column.name)) for batch in batches] for column in COLUMNS
    }
    if not batches:
        raise DataError(f"Cannot recover {partial}: it ends before its first rows were written.")
    arrays = {name: np.concatenate(parts) for name, parts in rows.items()}
    stage, last = arrays["stage"], len(arrays["stage"]) - 1
    outcome = Outcome(
        success=bool(arrays["success"].any()),
        stage=int(stage.max()),
        max_stage=len(info.subinstructions),
        kept=False,
        reason="The recording was interrupted.",
        cut=True,
    )
    return Recording(
        info=replace(info, outcome=outcome),
        # The step of the last row that was written led to one that was not.
        **{
            column.name: arrays[column.name][: last if column.of_action else last + 1]
            for column in COLUMNS
        },
    )


def _rows(array: pa.Array) -> NDArray[Any]:
    if pa.types.is_fixed_size_list(array.type):
        return array.flatten().to_numpy().reshape(len(array), array.type.list_size)
    return array.to_numpy(zero_copy_only=False)
