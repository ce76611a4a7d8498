"""Joint targets of an episode as few bytes, and back without a lost bit."""

from __future__ import annotations

import zlib

import numpy as np
from numpy.typing import ArrayLike

from duobench.errors import EvaluationError
from duobench.types import FLAT_SIZE, Array

_TYPES = (np.dtype("<f4"), np.dtype("<f8"))


def pack_targets(sent: ArrayLike) -> bytes:
    """Compress the commands of an episode.

    They are kept as float32, in which policies act. Where that would change one, because it was
    clipped to a limit that is no float32, all of the episode are kept as float64. What neighbouring
    numbers share is brought side by side: the bytes are sorted by their significance.

    Args:
        sent: Commands (T, 16).
    """
    exact = np.asarray(sent, dtype=_TYPES[1]).reshape(-1, FLAT_SIZE)
    short = exact.astype(_TYPES[0])
    kept = short if np.array_equal(short, exact) else exact
    columns = np.ascontiguousarray(kept.T)
    planes = columns.view(np.uint8).reshape(-1, kept.itemsize).T
    return zlib.compress(planes.tobytes(), level=9)


def unpack_targets(content: bytes, steps: int) -> Array:
    """The commands (steps, 16) that `pack_targets` compressed, as float64.

    Raises:
        EvaluationError: The bytes do not hold as many commands.
    """
    sizes = {steps * FLAT_SIZE * kind.itemsize: kind for kind in _TYPES}
    unpacking = zlib.decompressobj()
    try:
        data = unpacking.decompress(content, max(sizes) + 1)  # a few bytes can become many
    except zlib.error as error:
        raise EvaluationError(f"The joint targets of a record are damaged: {error}.") from error
    if len(data) not in sizes:
        raise EvaluationError(f"A record of {steps} steps does not hold as many joint targets.")
    kind = sizes[len(data)]
    planes = np.frombuffer(data, np.uint8).reshape(kind.itemsize, -1)
    columns = np.ascontiguousarray(planes.T).view(kind).reshape(FLAT_SIZE, steps)
    return columns.T.astype(np.float64)
