"""A recorded episode: read, checked and written as one Parquet file."""

import hashlib
import io
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from duobench.core.errors import DataError, FileError
from duobench.core.files import decode, encode, write
from duobench.core.types import Array
from duobench.data.schema import (
    COLUMNS,
    INFO_KEY,
    LEADER,
    SCHEMA,
    Column,
    EpisodeInfo,
)

_CHECKSUM_KEY = INFO_KEY + b".sha256"
COMPRESSION_LEVEL = 1
"""Level of zstd; higher ones gain 1 % and take several times as long."""

_FLOATS = [
    f"{column.name}.list.element" if column.shape else column.name
    for column in COLUMNS
    if np.issubdtype(column.dtype, np.floating)
]
"""Columns whose bytes compress better side by side."""


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    eq=False,
)
class Recording:
    """One episode of T actions, with T + 1 rows of what was seen."""

    info: EpisodeInfo
    """Facts about the episode as a whole."""
    time: Array
    """Seconds (T + 1,) on a clock that never goes back: simulated time, 0 at the reset."""
    agent_pos: NDArray[np.float32]
    """Joint positions in radians and openings (T + 1, 16)."""
    tcp_pose: NDArray[np.float32]
    """Tool centre points (T + 1, 14), x y z qx qy qz qw in the table frame, left then right."""
    joint_velocity: NDArray[np.float32]
    """Joint velocities (T + 1, 14) in rad/s, left then right."""
    stage: NDArray[np.int64]
    """Stage (T + 1,)."""
    success: NDArray[np.bool_]
    """Whether the last stage was reached (T + 1,)."""
    success_at_end: NDArray[np.bool_]
    """Whether its constraint holds now (T + 1,)."""
    state: Array
    """Full states of the simulation (T + 1, n), from which images are rendered; n is 0
    on real arms."""
    action: Array
    """Action of the actor (T, m), in the environment's action mode: the label to learn from."""
    sent: Array
    """Joint targets in radians and openings that the arms were really sent (T, 16).

    They differ from the action where limits clipped it, where its mode is not "joint", and where an
    actor disturbed its own actions so that the recording shows how it recovers [DART, Laskey et al.
    2017].
    """
    reward: Array
    """Rewards (T,)."""
    clutch: NDArray[np.bool_]
    """Whether each hand of the operator led its arm (T, 2), left then right; without a clutch
    (T, 0)."""
    leader: NDArray[np.int64]
    """Who led (T,), as a place in `info.actors`."""
    frame: NDArray[np.int64]
    """Which frame of each video belongs to a row (T + 1, v), from 0 on; -1 before the first one. In
    the order of `info.videos`; without videos (T + 1, 0)."""
    frame_number: NDArray[np.int64]
    """Numbers that the cameras gave these frames (T + 1, v); a gap is a frame that got lost."""
    frame_age: Array
    """Seconds from when they were taken to `time` (T + 1, v); NaN before the first one."""
    left_robot_state: Array
    """State of the left arm from its driver (T + 1, n), see `info.robot_state_names`; NaN where it
    said something else. Without a rig (T + 1, 0)."""
    right_robot_state: Array
    """The same of the right arm (T + 1, n)."""

    def __post_init__(self) -> None:
        for column in COLUMNS:
            array = getattr(self, column.name)
            rows = len(self) if column.of_action else len(self) + 1
            size = max((int(column.is_in(self.info)), *array.shape[1:]))
            width = column.row_shape(self.info, size)
            if array.shape != (rows, *width) or array.dtype != column.dtype:
                raise DataError(
                    f"Column {column.name!r} has shape {array.shape} of {array.dtype}, expected "
                    f"was {(rows, *width)} of {np.dtype(column.dtype)}."
                )
        actors = len(self.info.actors)
        if len(self) and not 0 <= self.leader.min() <= self.leader.max() < actors:
            raise DataError(
                f"Column {LEADER!r} counts from {self.leader.min()} to {self.leader.max()}, and "
                f"{actors} led."
            )

    def __len__(self) -> int:
        return len(self.action)

    @property
    def success_step(self) -> int | None:
        """Control steps until the success that stands at the end, also its first row; or None."""
        return success_start(self.success)

    @property
    def steps(self) -> int:
        """Control steps until success, or until the end; what comes after success is no part."""
        return len(self) if self.success_step is None else self.success_step

    @property
    def is_led_by_policy(self) -> NDArray[np.bool_]:
        """Whether a policy led each row (T,), and no person."""
        return np.array([actor.kind.is_policy for actor in self.info.actors])[
            self.leader
        ]

    @property
    def corrections(self) -> tuple[tuple[int, int, str], ...]:
        """Stretches that were led in the place of a policy: first row, row after it, and reason."""
        ends = np.append(np.flatnonzero(self.is_led_by_policy), len(self))
        found = []
        for takeover in self.info.takeovers:
            if takeover.step < len(self):
                end = int(ends[np.searchsorted(ends, takeover.step)])
                found.append((takeover.step, end, takeover.why))
        return tuple(found)

    def until(self, actions: int) -> "Recording":
        """The episode up to what was seen after so many actions."""
        rows = {
            column.name: getattr(self, column.name)[: actions + (not column.of_action)]
            for column in COLUMNS
        }
        return replace(self, **rows)

    @staticmethod
    def read(path: Path) -> "Recording":
        """Read a recording.

        Raises:
            DataError: It cannot be read, is no recording, or of another version; the message names
                the file.
        """
        with _reading(path):
            return _from_table(pq.read_table(path, page_checksum_verification=True))

    @staticmethod
    def read_info(file: Path | bytes) -> EpisodeInfo:
        """Read only what a file, or its content, says about the episode as a whole; fast.

        Raises:
            DataError: See `read`.
        """
        is_path = isinstance(file, Path)
        with _reading(file if is_path else "a recording"):
            return _info_of(pq.read_schema(file if is_path else pa.BufferReader(file)))

    @staticmethod
    def read_checksum(path: Path) -> str:
        """SHA-256 of what a file says about the episode as a whole, which tells it from others.

        Raises:
            DataError: See `read`.
        """
        with _reading(path):
            schema = pq.read_schema(path)
            _info_of(schema)  # which checks it
            return schema.metadata[_CHECKSUM_KEY].decode()

    @staticmethod
    def read_length(path: Path) -> int:
        """Number of actions of a recording; fast, with the errors of `read`."""
        with _reading(path):
            return pq.read_metadata(path).num_rows - 1

    def write(self, path: Path) -> None:
        """Write it in one atomic step, or raise an `OutputError`."""
        write(path, self.to_bytes())

    def to_bytes(self) -> bytes:
        """The recording as the content of its file."""
        return to_bytes(
            _to_table(self),
            compression="zstd",
            compression_level=COMPRESSION_LEVEL,
            use_dictionary=False,
            use_byte_stream_split=_FLOATS,
            write_statistics=False,
            write_page_checksum=True,
            store_schema=True,
        )


def success_start(success: NDArray[np.bool_]) -> int | None:
    """The first row, of (T + 1,), of the success that stands at the end, if one does."""
    start = int(np.append(-1, np.flatnonzero(~success))[-1]) + 1
    return start if start < len(success) else None


def _to_table(recording: Recording) -> pa.Table:
    columns = [column for column in COLUMNS if column.is_in(recording.info)]
    arrays = [
        to_arrow(getattr(recording, column.name), int(column.of_action))
        for column in columns
    ]
    fields = [
        pa.field(column.name, array.type, nullable=column.of_action)
        for column, array in zip(columns, arrays, strict=True)
    ]
    info = encode(recording.info, SCHEMA).encode(errors="replace")
    return pa.Table.from_arrays(arrays, schema=pa.schema(fields, _metadata(info)))


def _from_table(table: pa.Table) -> Recording:
    info = _info_of(table.schema)
    absent = {column.name for column in COLUMNS} - {*table.column_names}
    missing = [
        column.name
        for column in COLUMNS
        if column.is_in(info) and column.name in absent
    ]
    if missing:
        raise DataError(f"Columns are missing: {', '.join(missing)}.")
    if not table.num_rows:
        raise DataError("It holds no rows.")
    arrays = {}
    for column in COLUMNS:
        length = table.num_rows - column.of_action
        if column.name in absent:
            arrays[column.name] = np.zeros(
                (length, *(0 for _ in column.shape)), column.dtype
            )
        else:
            rows = table.column(column.name).combine_chunks()
            arrays[column.name] = _numbers(column, rows[:length])
    return Recording(info=info, **arrays)


def _metadata(info: bytes) -> dict[bytes, bytes]:
    """Metadata of an episode's file, with a checksum, which Parquet has for rows alone."""
    return {INFO_KEY: info, _CHECKSUM_KEY: hashlib.sha256(info).hexdigest().encode()}


def _info_of(schema: pa.Schema) -> EpisodeInfo:
    metadata = schema.metadata or {}
    text = metadata.get(INFO_KEY)
    if text is None:
        raise DataError(
            "It is no recording of DuoBench: its metadata lacks the episode."
        )
    if metadata.get(_CHECKSUM_KEY) != _metadata(text)[_CHECKSUM_KEY]:
        raise DataError(
            "The metadata of the episode is damaged: its checksum is another one."
        )
    try:
        return decode(text, EpisodeInfo, SCHEMA)
    except FileError as error:
        raise DataError(f"The metadata of the episode is invalid: {error}") from error


def _numbers(column: Column, rows: pa.Array) -> NDArray[Any]:
    """Read the rows of a column, without missing values and of its type."""
    values = rows.flatten() if _is_list(rows) else rows
    if values.type != pa.from_numpy_dtype(column.dtype):
        raise DataError(f"Column {column.name!r} has type {rows.type}.")
    if rows.null_count or values.null_count:
        raise DataError(f"Column {column.name!r} lacks values.")
    return to_numpy(rows)


@contextmanager
def _reading(path: Path | str) -> Iterator[None]:
    try:
        yield
    except (OSError, ValueError, pa.ArrowException, DataError) as error:
        raise DataError(f"Cannot read {path}: {error}") from error


def to_arrow(rows: NDArray[Any], missing: int = 0) -> pa.Array:
    """A column from its rows (T,) or (T, n), with some more at the end that hold nothing.

    Where some lack, each list says how long it is: before 26 Arrow reads no list of fixed size that
    is missing. A column that holds nothing but such rows has lists of missing numbers there, which
    say how many they are.
    """
    values = pa.array(np.ascontiguousarray(rows).reshape(-1))
    if rows.ndim > 1:
        if missing and not len(rows):
            values = pa.nulls(missing * rows.shape[1], values.type)
            return pa.FixedSizeListArray.from_arrays(values, rows.shape[1])
        values = pa.FixedSizeListArray.from_arrays(values, rows.shape[1])
        if missing:
            values = values.cast(pa.list_(values.type.value_type))
    return (
        pa.concat_arrays([values, pa.nulls(missing, values.type)])
        if missing
        else values
    )


def to_numpy(column: pa.Array) -> NDArray[Any]:
    """Read the rows (T,) or (T, n) of a column, without missing values."""
    if not _is_list(column):
        return column.to_numpy(zero_copy_only=False)
    if pa.types.is_fixed_size_list(column.type):
        size = column.type.list_size
    else:
        sizes = np.diff(column.offsets.to_numpy())
        if not len(sizes):
            raise ValueError(
                "Lists without any row do not say how many numbers a row has."
            )
        size = int(sizes[0])
        if (sizes != size).any():
            raise ValueError(f"Rows have {sizes.min()} to {sizes.max()} numbers.")
    return column.flatten().to_numpy(zero_copy_only=False).reshape(len(column), size)


def _is_list(column: pa.Array) -> bool:
    return pa.types.is_fixed_size_list(column.type) or pa.types.is_list(column.type)


def to_bytes(table: pa.Table, **options: Any) -> bytes:
    """A table as a Parquet file; the options are those of `pyarrow.parquet.write_table`."""
    with io.BytesIO() as buffer:
        pq.write_table(table, buffer, **options)
        return buffer.getvalue()
