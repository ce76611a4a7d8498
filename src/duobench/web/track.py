"""The track of an episode: where its bodies were after each control step, in few bytes.

A track is `DTR1`, two uint32, the steps and the bodies, and then raw deflate over int16, all
little-endian: the differences of each number from the step before, the first from zero and modulo
2^16, first the low bytes of all of them and then the high bytes; number after number of all bodies,
each with all its steps. Positions count tenths of a millimetre, quaternions 1/20480.
"""

import struct
import zlib

import numpy as np
from numpy.typing import ArrayLike, NDArray

from duobench.core.errors import DataError

POSITION_STEP = 1e-4
"""Metres."""
QUATERNION_STEP = 1 / 20480
"""Step of a unit quaternion's numbers: their error turns a body by 0.1 mrad at most."""

_MAGIC = b"DTR1"
_HEADER = struct.Struct("<4sII")
_STEPS = np.array([POSITION_STEP] * 3 + [QUATERNION_STEP] * 4)
_LIMIT = 32767
_RAW = -15
"""Deflate without a header, as a browser's `DecompressionStream("deflate-raw")` opens it."""


def encode(poses: ArrayLike) -> bytes:
    """Pack the poses of an episode.

    The error is 0.1 mm and 0.1 mrad at most, and what is further than 3.27 m from the origin, which
    is outside the room, comes back at the nearest number that fits.

    Args:
        poses: Poses (steps, bodies, 7), x y z in metres and w x y z, as `Geometry.poses` returns
            them, of one step and body at least; both signs of a quaternion mean the same.
    """
    array = np.asarray(poses, dtype=np.float64)
    if not np.isfinite(array).all():
        raise DataError("Poses must be finite, and one of them is not.")
    array = _without_flips(array)
    numbers = np.clip(np.rint(array / _STEPS), -_LIMIT, _LIMIT).astype(np.int32)
    differences = np.diff(numbers, axis=0, prepend=0).astype("<i2")  # modulo 2^16
    series = differences.transpose(1, 2, 0).ravel().view(np.uint8).reshape(-1, 2)
    compressor = zlib.compressobj(9, zlib.DEFLATED, _RAW)
    packed = compressor.compress(series.T.tobytes()) + compressor.flush()
    return _HEADER.pack(_MAGIC, array.shape[0], array.shape[1]) + packed


def decode(track: bytes) -> NDArray[np.float32]:
    """Unpack what `encode` packed, into poses (steps, bodies, 7) with unit quaternions."""
    steps, bodies = _head(track)
    try:
        planes = np.frombuffer(
            zlib.decompress(track[_HEADER.size :], _RAW), dtype=np.uint8
        )
        series = (
            planes.reshape(2, -1)
            .T.copy()
            .view("<i2")
            .reshape(bodies, len(_STEPS), steps)
        )
    except (zlib.error, ValueError) as error:
        raise DataError(f"This track of an episode is damaged: {error}.") from error
    numbers = np.cumsum(
        series.transpose(2, 0, 1), axis=0, dtype=np.int16
    )  # modulo 2^16
    poses = numbers * _STEPS
    poses[..., 3:] /= np.maximum(
        np.linalg.norm(poses[..., 3:], axis=-1, keepdims=True), 1e-9
    )
    return poses.astype(np.float32)


def length(track: bytes) -> int:
    """The number of steps of a track."""
    return _head(track)[0]


def _head(track: bytes) -> tuple[int, int]:
    if len(track) < _HEADER.size or not track.startswith(_MAGIC):
        raise DataError("This is no track of an episode: it begins with other bytes.")
    _, steps, bodies = _HEADER.unpack_from(track)
    return steps, bodies


def _without_flips(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same poses, with quaternions that never change their sign from one step to the next."""
    dots = np.einsum("tbi,tbi->tb", poses[1:, :, 3:], poses[:-1, :, 3:])
    signs = np.cumprod(np.where(dots < 0, -1.0, 1.0), axis=0)
    poses = poses.copy()
    poses[1:, :, 3:] *= signs[..., None]
    return poses
