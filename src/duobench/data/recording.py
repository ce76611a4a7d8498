"""A recorded episode: read, checked and written as one Parquet file."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from duobench.data.schema import COLUMNS, INFO_KEY, SCHEMA, Column, EpisodeInfo
from duobench.errors import DataError, EvaluationError
from duobench.files import decode, encode, write
from duobench.types import Array

COMPRESSION_LEVEL = 1
"""Of zstd; higher ones gain 1 % and take several times as long."""

_FLOATS = [
    f"{column.name}.list.element" if column.shape else column.name
    for column in COLUMNS
    if np.issubdtype(column.dtype, np.floating)
]
"""Columns whose bytes compress better side by side."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Recording:
    """One episode of T actions, with T + 1 rows of what was seen."""

    info: EpisodeInfo
    """What is said about the episode as a whole."""
    time: Array
    """Seconds (T + 1,) on a clock that never goes back."""
    agent_pos: NDArray[np.float32]
    """Joint positions in radians and openings (T + 1, 16)."""
    tcp_pose: NDArray[np.float32]
    """Tool centre points (T + 1, 14), x y z qx qy qz qw in the table frame, left then right."""
    joint_velocity: NDArray[np.float32]
    """Joint velocities (T + 1, 14) in rad/s."""
    stage: NDArray[np.int64]
    """Stage (T + 1,)."""
    success: NDArray[np.bool_]
    """Whether the last stage was reached (T + 1,)."""
    success_at_end: NDArray[np.bool_]
    """Whether its constraint holds now (T + 1,)."""
    state: Array
    """Full states of the simulation (T + 1, n)."""
    action: Array
    """Actions as they were given (T, m)."""
    sent: Array
    """Commands that were really sent (T, 16)."""
    reward: Array
    """Rewards (T,)."""

    def __post_init__(self) -> None:
        """Reject columns that do not belong together."""
        for column in COLUMNS:
            array = getattr(self, column.name)
            rows = len(self) if column.of_action else len(self) + 1
            width = tuple(n or max((1, *array.shape[1:])) for n in column.shape)
            if array.shape != (rows, *width) or array.dtype != column.dtype:
                raise DataError(
                    f"Column {column.name!r} has shape {array.shape} of {array.dtype}, expected "
                    f"was {(rows, *column.shape)} of {np.dtype(column.dtype)}."
                )

    def __len__(self) -> int:
        """Number of actions."""
        return len(self.action)

    @staticmethod
    def read(path: Path) -> Recording:
        """Read a recording.

        Raises:
            DataError: It cannot be read, is no recording, or of another version; the message names
                the file.
        """
        try:
            table = pq.read_table(path, page_checksum_verification=True)
            return from_table(table)
        except (OSError, pa.ArrowException, DataError) as error:
            raise DataError(f"Cannot read {path}: {error}") from error

    @staticmethod
    def read_info(path: Path) -> EpisodeInfo:
        """Read only what is said about the episode as a whole; fast.

        Raises:
            DataError: See `read`.
        """
        try:
            return info_of(pq.read_schema(path))
        except (OSError, pa.ArrowException, DataError) as error:
            raise DataError(f"Cannot read {path}: {error}") from error

    @staticmethod
    def read_length(path: Path) -> int:
        """Number of actions of a recording; fast.

        Raises:
            DataError: See `read`.
        """
        try:
            return pq.read_metadata(path).num_rows - 1
        except (OSError, pa.ArrowException) as error:
            raise DataError(f"Cannot read {path}: {error}") from error

    def write(self, path: Path) -> None:
        """Write the recording in one atomic step.

        Raises:
            OutputError: It cannot be written.
        """
        table = to_table(self)
        with io.BytesIO() as buffer:
            pq.write_table(
                table,
                buffer,
                compression="zstd",
                compression_level=COMPRESSION_LEVEL,
                use_dictionary=False,
                use_byte_stream_split=_FLOATS,  # pyright: ignore[reportArgumentType] - a list too
                write_statistics=False,
                write_page_checksum=True,
                store_schema=True,
            )
            write(path, buffer.getvalue())


def arrow_schema(info: EpisodeInfo, sizes: dict[str, int]) -> pa.Schema:
    """The schema of a recording.

    Args:
        info: What is said about the episode.
        sizes: Numbers in one row of the columns that have as many as there are.
    """
    return pa.schema(
        [
            pa.field(column.name, arrow_type(column, sizes), nullable=column.of_action)
            for column in COLUMNS
        ],
        metadata={INFO_KEY: encode(info, SCHEMA).encode(errors="replace")},
    )


def arrow_type(column: Column, sizes: dict[str, int]) -> pa.DataType:
    """The type of a column."""
    kind = pa.from_numpy_dtype(column.dtype)
    if not column.shape:
        return kind
    return pa.list_(kind, column.shape[0] or sizes[column.name])


def arrow_array(column: Column, rows: NDArray[Any], missing: int = 0) -> pa.Array:
    """A column from its rows, with some rows at the end that hold nothing."""
    values = pa.array(np.ascontiguousarray(rows).reshape(-1))
    if column.shape:
        values = pa.FixedSizeListArray.from_arrays(values, rows.shape[1])
    if missing:
        values = pa.concat_arrays([values, pa.nulls(missing, values.type)])
    return values


def to_table(recording: Recording) -> pa.Table:
    """The recording as an Arrow table."""
    arrays = {column.name: getattr(recording, column.name) for column in COLUMNS}
    sizes = {name: array.shape[1] for name, array in arrays.items() if array.ndim > 1}
    return pa.Table.from_arrays(
        [arrow_array(column, arrays[column.name], int(column.of_action)) for column in COLUMNS],
        schema=arrow_schema(recording.info, sizes),
    )


def from_table(table: pa.Table) -> Recording:
    """The recording from a table that `to_table` made.

    Raises:
        DataError: It is none, or of another version.
    """
    info = info_of(table.schema)
    missing = [column.name for column in COLUMNS if column.name not in table.column_names]
    if missing:
        raise DataError(f"Columns are missing: {', '.join(missing)}.")
    if not table.num_rows:
        raise DataError("It holds no rows.")
    arrays = {}
    for column in COLUMNS:
        rows = table.column(column.name).combine_chunks()
        arrays[column.name] = _numbers(column, rows[:-1] if column.of_action else rows)
    return Recording(info=info, **arrays)


def info_of(schema: pa.Schema) -> EpisodeInfo:
    """What is said about the episode as a whole.

    Raises:
        DataError: The schema is not that of a recording of this version.
    """
    text = (schema.metadata or {}).get(INFO_KEY)
    if text is None:
        raise DataError("It is no recording of DuoBench: its metadata lacks the episode.")
    try:
        return decode(text, EpisodeInfo, SCHEMA)
    except EvaluationError as error:
        raise DataError(f"The metadata of the episode is invalid: {error}") from error


def _numbers(column: Column, rows: pa.Array) -> NDArray[Any]:
    """The rows of a column as an array of its type."""
    kind, size = rows.type, 0
    if pa.types.is_fixed_size_list(kind):
        kind, size = kind.value_type, kind.list_size
    if kind != pa.from_numpy_dtype(column.dtype) or bool(size) != bool(column.shape):
        raise DataError(f"Column {column.name!r} has type {rows.type}.")
    if rows.null_count:
        raise DataError(f"Column {column.name!r} lacks values.")
    values = rows.flatten() if size else rows
    if values.null_count:
        raise DataError(f"Column {column.name!r} lacks values.")
    array = values.to_numpy(zero_copy_only=False)
    return array.reshape(len(rows), size) if size else array
