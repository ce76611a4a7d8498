"""Poses of objects from where cameras see points of them: rays that meet.

A pixel is a ray in the table's frame, known by the lens and the place of its camera. An object is
where the rays of its points pass it most closely, each as sure as its map is narrow, near where
objects were in demonstrations: there they lie on things and in things, so that one tells of
another. Nothing of that is learned: what may say how sure it is ends by trusting nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from frames import bodies
from numpy.typing import NDArray

Array = NDArray[np.float64]
ARM = 0.05
"""Metres from the origin of an object along its axes to its other points."""
TURN = 0.3
"""Standard deviation of a rotation that was guessed without rays (rad)."""
LEAST = 0.01
"""Standard deviation of a place (m) that demonstrations never changed."""
CLOSEST = 0.05
"""Metres from a camera to a point, at least."""
STEPS = 6
"""Steps of Gauss and Newton from the guess to where rays meet."""


@dataclass(frozen=True)
class Points:
    """Points of objects that cameras look for: origins, and the ends of axes where these are told.

    Attributes:
        things: Of which object each is (J,).
        offsets: Where it is in the frame of that object (J, 3), in metres.
    """

    things: NDArray[np.int64]
    offsets: Array

    @staticmethod
    def of(names: tuple[str, ...]) -> Points:
        """Those of an object state with these names."""
        arms = np.concatenate([np.eye(3), -np.eye(3)]) * ARM
        things, offsets = [], []
        for k, body in enumerate(bodies(names)):
            own = [np.zeros((1, 3))]
            if f"{body}_x_axis_x" in names:
                own.append(arms)
            offsets += own
            things += [k] * sum(map(len, own))
        return Points(np.array(things), np.concatenate(offsets))

    def shares(self) -> Array:
        """What each point (J,) counts, so that every object counts alike, and all of them one."""
        counts = np.bincount(self.things)
        return 1 / counts[self.things] / len(counts)

    def at(self, places: Array, turns: Array) -> Array:
        """Points (T, J, 3) of objects at places (T, K, 3) that are turned (T, K, 3, 3)."""
        arms = np.einsum("tjab,jb->tja", turns[:, self.things], self.offsets)
        return places[:, self.things] + arms


@dataclass(frozen=True)
class Usual:
    """Where objects were when demonstrated, as a normal distribution.

    Attributes:
        mean: Their places (K, 3).
        precision: Inverse covariance (3 K, 3 K) of all of them together.
    """

    mean: Array
    precision: Array

    @staticmethod
    def of(places: Array) -> Usual:
        """That of places (T, K, 3)."""
        flat = places.reshape(len(places), -1).astype(np.float64)
        spread = np.cov(flat.T) + LEAST**2 * np.eye(flat.shape[1])
        return Usual(flat.mean(0).reshape(-1, 3), np.linalg.inv(spread))


@dataclass(frozen=True)
class Rays:
    """Rays of C cameras to J points, in T images.

    Attributes:
        origins: Where the cameras are (T, C, 3).
        ways: Unit vectors (T, C, J, 3) away from there.
        sharpness: One over the standard deviation of their direction (T, C, J), in 1 / rad.
    """

    origins: Array
    ways: Array
    sharpness: Array


def meet(rays: Rays, points: Points, usual: Usual, guess: Array) -> tuple[Array, Array]:
    """Places (T, K, 3) and rotations (T, K, 3, 3) of objects.

    Args:
        rays: Where their points were seen.
        points: Which these are.
        usual: Where objects are without a look.
        guess: Rotations (T, K, 3, 3) to begin from, and to stay near.
    """
    count, things = guess.shape[:2]
    places, turns = np.tile(usual.mean, (count, 1, 1)), guess.copy()
    size = 3 * things
    before = np.zeros((2 * size, 2 * size))
    before[:size, :size] = usual.precision
    before[size:, size:] = np.eye(size) / TURN**2
    aside = np.eye(3) - rays.ways[..., None] * rays.ways[..., None, :]
    for _ in range(STEPS):
        arms = points.at(np.zeros_like(places), turns)
        here = places[:, points.things] + arms
        ways = here[:, None] - rays.origins[:, :, None]
        far = np.maximum(np.linalg.norm(ways, axis=-1), CLOSEST)
        weights = (rays.sharpness / far)[..., None, None] ** 2 * aside
        pulls = -np.einsum("tcjab,tcjb->tja", weights, ways)
        weights = weights.sum(1)
        moves = _moves(points, arms, things)
        held = np.einsum("tjab,tjbn->tjan", weights, moves)
        hessian = before + np.einsum("tjan,tjam->tnm", moves, held)
        away = np.concatenate([(usual.mean - places), _turn(guess, turns)], axis=1)
        gradient = np.einsum("tjan,tja->tn", moves, pulls)
        gradient += away.reshape(count, -1) @ before
        step = np.linalg.solve(hessian, gradient[..., None])[..., 0]
        step = step.reshape(count, 2 * things, 3)
        places = places + step[:, :things]
        turns = _rotation(step[:, things:]) @ turns
    return places, turns


def _moves(points: Points, arms: Array, things: int) -> Array:
    """How points (T, J, 3, 6 K) move with places and small turns of objects."""
    moves = np.zeros((*arms.shape, 2, things, 3))
    for j, k in enumerate(points.things):
        moves[:, j, :, 0, k] = np.eye(3)
        moves[:, j, :, 1, k] = -_cross(arms[:, j])
    return moves.reshape(*arms.shape, -1)


def _cross(vectors: Array) -> Array:
    """Matrices (..., 3, 3) that multiply as a cross product with vectors (..., 3) does."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    rows = [zero, -z, y, z, zero, -x, -y, x, zero]
    return np.stack(rows, axis=-1).reshape(*vectors.shape, 3)


def _turn(wanted: Array, now: Array) -> Array:
    """By which vectors (..., 3) rotations are to be turned to be others, for small ones."""
    error = wanted @ np.swapaxes(now, -1, -2)
    odd = (error - np.swapaxes(error, -1, -2)) / 2
    return np.stack([odd[..., 2, 1], odd[..., 0, 2], odd[..., 1, 0]], axis=-1)


def _rotation(vectors: Array) -> Array:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3)."""
    angle = np.linalg.norm(vectors, axis=-1)[..., None, None]
    axis = _cross(vectors / np.maximum(angle[..., 0], 1e-12))
    return np.eye(3) + np.sin(angle) * axis + (1 - np.cos(angle)) * axis @ axis
