"""Arrays as columns of Parquet files, and back."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray


def to_arrow(rows: NDArray[Any], missing: int = 0) -> pa.Array:
    """A column from its rows (T,) or (T, n), with some more at the end that hold nothing."""
    values = pa.array(np.ascontiguousarray(rows).reshape(-1))
    if rows.ndim > 1:
        values = pa.FixedSizeListArray.from_arrays(values, rows.shape[1])
    return pa.concat_arrays([values, pa.nulls(missing, values.type)]) if missing else values


def to_numpy(column: pa.Array) -> NDArray[Any]:
    """The rows (T,) or (T, n) of a column, all of which hold something."""
    if not pa.types.is_fixed_size_list(column.type):
        return column.to_numpy(zero_copy_only=False)
    return (
        column.flatten().to_numpy(zero_copy_only=False).reshape(len(column), column.type.list_size)
    )


def to_bytes(table: pa.Table, **options: Any) -> bytes:
    """A table as a Parquet file; the options are those of `pyarrow.parquet.write_table`."""
    with io.BytesIO() as buffer:
        pq.write_table(table, buffer, **options)
        return buffer.getvalue()
