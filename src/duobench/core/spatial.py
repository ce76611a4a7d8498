"""Rigid transforms: one frozen type, composed with `@`.

A transform named `a_from_b` maps coordinates of frame b to frame a, so neighbours match:
`world_from_cube = world_from_table @ table_from_cube`.

Products and lengths are plain sums of floats in a fixed order. Those of NumPy end in BLAS, which
picks its kernel by the type of the processor, and kernels differ in the last bit.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from duobench.core.types import Array


def _frozen(values: ArrayLike, shape: tuple[int, ...]) -> Array:
    array = np.array(values, dtype=np.float64)
    if array.shape != shape:
        raise ValueError(f"Expected an array of shape {shape}, got {array.shape}.")
    array.setflags(write=False)
    return array


def product(a: Array, b: Array) -> Array:
    """Matrix product of a (3, 3) with b, (3, 3) or (3,); the same bits on every processor."""
    if b.ndim == 1:
        u, v, w = b.tolist()
        return np.array([x * u + y * v + z * w for x, y, z in a.tolist()])
    columns = b.T.tolist()
    return np.array(
        [[x * u + y * v + z * w for u, v, w in columns] for x, y, z in a.tolist()]
    )


def dot(a: ArrayLike, b: ArrayLike) -> float:
    """Dot product of two short vectors (n,); the same bits on every processor."""
    return sum_of_products(np.asarray(a).tolist(), np.asarray(b).tolist())


def length(vector: ArrayLike) -> float:
    """Euclidean length of a short vector (n,); the same bits on every processor."""
    return math.sqrt(dot(vector, vector))


def sum_of_products(a: Iterable[Any], b: Iterable[Any]) -> Any:
    """Dot product of two vectors whose parts are floats, or arrays: one entry for each vector."""
    total = 0.0  # `sum` of some Pythons compensates
    for x, y in zip(a, b, strict=True):
        total = total + x * y
    return total


def root(squares: Any) -> Any:
    """Square root of a float, or of each number of an array."""
    return math.sqrt(squares) if isinstance(squares, float) else np.sqrt(squares)


def hypot(*parts: Any) -> Any:
    """Length of a vector whose parts are floats, or arrays: one entry for each vector.

    Each entry has the bits that the floats would give, which NumPy's sums of squares have not.
    """
    if isinstance(parts[0], float):
        return math.hypot(*parts)
    lengths = np.frompyfunc(math.hypot, len(parts), 1)(*parts)
    return np.asarray(lengths, dtype=np.float64)


def unit_quaternion(parts: Iterable[float]) -> list[float]:
    """A quaternion (4,), divided by its length.

    Raises:
        ValueError: It has no length, so it names no orientation.
    """
    quat = list(parts)
    norm = math.sqrt(sum_of_products(quat, quat))
    if not norm > 0.0:
        raise ValueError(f"A quaternion of length {norm:g} names no orientation.")
    return [part / norm for part in quat]


def matrix_from_wxyz(wxyz: ArrayLike) -> Array:
    """Rotation matrix (3, 3) of a unit quaternion in w x y z order."""
    return np.array(rows_from_wxyz(np.asarray(wxyz).tolist()))


def rows_from_wxyz(wxyz: Iterable[float]) -> list[list[float]]:
    """`matrix_from_wxyz` in Python's floats, which are faster than arrays of three."""
    w, x, y, z = wxyz
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]


def wxyz_from_matrix(matrix: ArrayLike) -> Array:
    """Unit quaternion (4,), w x y z with w >= 0, of a rotation matrix (3, 3).

    The largest of the four squared components is computed first (Shepperd's method), so that no
    division by a small number happens.
    """
    return np.array(wxyz_from_rows(np.asarray(matrix, dtype=np.float64).tolist()))


def wxyz_from_rows(m: Sequence[Sequence[float]]) -> list[float]:
    """`wxyz_from_matrix` in Python's floats, which are faster than arrays of three."""
    diagonal = [m[0][0], m[1][1], m[2][2]]
    trace = diagonal[0] + diagonal[1] + diagonal[2]
    largest = max(diagonal)
    if trace >= largest:
        q = [
            1 + trace,
            m[2][1] - m[1][2],
            m[0][2] - m[2][0],
            m[1][0] - m[0][1],
        ]
    else:
        i = diagonal.index(largest)
        j, k = (i + 1) % 3, (i + 2) % 3
        q = [m[k][j] - m[j][k], 0.0, 0.0, 0.0]
        q[1 + i] = 1 + m[i][i] - m[j][j] - m[k][k]
        q[1 + j] = m[j][i] + m[i][j]
        q[1 + k] = m[k][i] + m[i][k]
    size = math.sqrt(sum_of_products(q, q))
    return [-part / size for part in q] if q[0] < 0 else [part / size for part in q]


@dataclass(frozen=True, slots=True, eq=False)
class SE3:
    """A rigid transform, as rotation matrix and translation."""

    rotation: Array = field(default_factory=lambda: np.eye(3))
    """Rotation matrix (3, 3)."""
    translation: Array = field(default_factory=lambda: np.zeros(3))
    """Translation (3,) in metres."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "rotation", _frozen(self.rotation, (3, 3)))
        object.__setattr__(self, "translation", _frozen(self.translation, (3,)))

    @staticmethod
    def at(
        x: float = 0.0,
        y: float = 0.0,
        z: float = 0.0,
        *,
        yaw: float = 0.0,
    ) -> SE3:
        """Upright pose at a position in metres, turned by `yaw` radians about z."""
        return SE3(rotation_about((0.0, 0.0, 1.0), yaw), np.array([x, y, z]))

    @staticmethod
    def about(axis: ArrayLike, angle: float) -> SE3:
        """Pure rotation by `angle` radians about `axis` (3,)."""
        return SE3(rotation_about(axis, angle))

    @staticmethod
    def from_wxyz(wxyz: ArrayLike, translation: ArrayLike = (0.0, 0.0, 0.0)) -> SE3:
        """Transform from a quaternion (4,) in w x y z order, normalized here, and a position.

        Raises:
            ValueError: The quaternion has no length, so it names no orientation.
        """
        unit = unit_quaternion(np.asarray(wxyz, dtype=np.float64).tolist())
        return SE3(np.array(rows_from_wxyz(unit)), np.asarray(translation))

    @staticmethod
    def from_tquat(tquat: ArrayLike) -> SE3:
        """Transform from seven numbers x y z qx qy qz qw; see `from_wxyz` for what is rejected."""
        x, y, z, qx, qy, qz, qw = np.asarray(tquat, dtype=np.float64).tolist()
        return SE3.from_wxyz((qw, qx, qy, qz), (x, y, z))

    @property
    def wxyz(self) -> Array:
        """Unit quaternion (4,), w x y z, w >= 0."""
        return wxyz_from_matrix(self.rotation)

    @property
    def tquat(self) -> Array:
        """Seven numbers x y z qx qy qz qw."""
        return np.concatenate([self.translation, self.wxyz[[1, 2, 3, 0]]])

    @property
    def yaw(self) -> float:
        """Angle of the x axis about world z, in radians."""
        return math.atan2(self.rotation[1, 0], self.rotation[0, 0])

    def __matmul__(self, other: SE3) -> SE3:
        """Composition: `a_from_b @ b_from_c` is `a_from_c`."""
        return SE3(
            product(self.rotation, other.rotation),
            product(self.rotation, other.translation) + self.translation,
        )

    def inverse(self) -> SE3:
        """The inverse transform: of `a_from_b`, `b_from_a`."""
        return SE3(self.rotation.T, -product(self.rotation.T, self.translation))

    def apply(self, points: ArrayLike) -> Array:
        """Map points (..., 3) from the source frame to the target frame."""
        points = np.asarray(points, dtype=np.float64)
        x, y, z = (points[..., axis, None] for axis in range(3))
        along_x, along_y, along_z = self.rotation.T
        return x * along_x + y * along_y + z * along_z + self.translation

    def moved(
        self,
        x: float = 0.0,
        y: float = 0.0,
        z: float = 0.0,
    ) -> SE3:
        """Pose of the same orientation, shifted in the target frame by metres."""
        return SE3(self.rotation, self.translation + np.array([x, y, z]))

    def interpolate(self, other: SE3, fraction: float) -> SE3:
        """Pose between this (0) and `other` (1): straight line, constant-axis rotation."""
        relative = rotation_vector(product(self.rotation.T, other.rotation))
        angle = length(relative)
        turn = rotation_about(relative, fraction * angle) if angle > 0 else np.eye(3)
        return SE3(
            product(self.rotation, turn),
            (1 - fraction) * self.translation + fraction * other.translation,
        )

    def distance(self, other: SE3) -> tuple[float, float]:
        """Distance in metres and angle in radians to another pose."""
        angle = length(rotation_vector(product(self.rotation.T, other.rotation)))
        return length(other.translation - self.translation), angle


def rotation_about(axis: ArrayLike, angle: float) -> Array:
    """Rotation matrix (3, 3) of `angle` radians about `axis` (3,), which need not be unit."""
    unit = np.asarray(axis, dtype=np.float64)
    unit = unit / length(unit)
    half = 0.5 * angle
    return matrix_from_wxyz([math.cos(half), *(math.sin(half) * unit)])


def rotation_by(vector: ArrayLike) -> Array:
    """Rotation matrix (3, 3) of a rotation vector (3,), axis times angle in radians."""
    angle = length(vector)
    return rotation_about(vector, angle) if angle > 0.0 else np.eye(3)


def rotation_vector(rotation: ArrayLike) -> Array:
    """Rotation vector (3,), axis times angle in radians, of a rotation matrix (3, 3)."""
    w, *xyz = wxyz_from_matrix(rotation)
    vector = np.array(xyz)
    sine = length(vector)
    if sine == 0.0:
        return np.zeros(3)
    return vector * (2.0 * math.atan2(sine, float(w)) / sine)
