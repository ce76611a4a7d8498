"""Poses of objects from where cameras see points of them: rays that meet.

A pixel is a ray in the table's frame, known by the lens and the place of its camera. An object is
where the rays of its points pass it most closely, each as sure as its map is narrow, near where
objects were in demonstrations: there they lie on things and in things, so that one tells of
another. Nothing of that is learned: what may say how sure it is ends by trusting nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from frames import bodies, cross_matrices, rotations_by, turns_between
from numpy.typing import NDArray

Array = NDArray[np.float64]
ARM = 0.06
"""Metres from the origin of an object along its axes to its other points."""
TURN = 0.01
"""Standard deviation of a rotation that was guessed without rays (rad): guesses are 1 degree off
where rays alone are 2 to 10."""
LEAST = 0.003
"""Standard deviation of a place (m) that demonstrations never changed."""
CLOSEST = 0.05
"""Metres from a camera to a point, at least."""
TINY = 1e-9
"""What is added to inverse covariances that may be nought."""
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
        """What each point (J,) counts: all objects alike, and origins as much as other points."""
        origins = (self.offsets == 0).all(1)
        others = np.bincount(self.things[~origins], minlength=origins.sum())[
            self.things
        ]
        shares = np.where(
            others == 0, 1.0, 1 / 2 / np.where(origins, 1, np.maximum(others, 1))
        )
        return shares / origins.sum()

    def at(self, places: Array, turns: Array) -> Array:
        """Points (T, J, 3) of objects at places (T, K, 3) that are turned (T, K, 3, 3)."""
        arms = np.einsum("tjab,jb->tja", turns[:, self.things], self.offsets)
        return places[:, self.things] + arms


@dataclass(frozen=True)
class Usual:
    """Where objects were when demonstrated, in the table's frame and in those of other objects.

    Attributes:
        mean: Their places (K + 1, K, 3): in the frame of each object, and at last of the table.
        precision: Inverse covariances (K + 1, K, 3, 3); none in frames of what has no axes.
    """

    mean: Array
    precision: Array

    @staticmethod
    def of(points: Points, places: Array, turns: Array) -> Usual:
        """That of places (T, K, 3) and rotations (T, K, 3, 3)."""
        count = places.shape[1]
        mean, precision = (
            np.zeros((count + 1, count, 3)),
            np.zeros((count + 1, count, 3, 3)),
        )
        with_axes = set(points.things[points.offsets.any(1)].tolist())
        for one in range(count):
            for other in [*with_axes - {one}, count]:
                there = places[:, one]
                if other < count:
                    away = there - places[:, other]
                    there = np.einsum("tij,ti->tj", turns[:, other], away)
                spread = np.cov(there.T) + LEAST**2 * np.eye(3)
                mean[other, one] = there.mean(0)
                precision[other, one] = np.linalg.inv(spread)
        return Usual(mean, precision)


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
    places, turns = np.tile(usual.mean[-1], (count, 1, 1)), guess.copy()
    for _ in range(STEPS):
        pulls = [
            _to_rays(rays, points, places, turns),
            _to_guess(guess, turns),
            _to_usual(usual, places),
        ]
        pulls += [
            _to_others(usual, places, turns, k)
            for k in range(things)
            if usual.precision[k].any()
        ]
        hessian = sum(pull.hessian() for pull in pulls)
        gradient = sum(pull.gradient() for pull in pulls)
        step = np.linalg.solve(hessian, gradient[..., None])[..., 0]
        step = step.reshape(count, 2, things, 3)
        places = places + step[:, 0]
        turns = rotations_by(step[:, 1]) @ turns
    return places, turns


@dataclass(frozen=True)
class _Pull:
    """Vectors that are to be nought, and how sure that is.

    Attributes:
        errors: The vectors (T, M, 3).
        weights: Inverse covariances (T, M, 3, 3).
        moves: How they move with places and small turns of objects (T, M, 3, 2, K, 3).
    """

    errors: Array
    weights: Array
    moves: Array

    def hessian(self) -> Array:
        flat = self.moves.reshape(*self.errors.shape, -1)
        held = self.weights @ flat
        return np.einsum("tmai,tmaj->tij", flat, held, optimize=True)

    def gradient(self) -> Array:
        flat = self.moves.reshape(*self.errors.shape, -1)
        forces = self.weights @ self.errors[..., None]
        return -np.einsum("tmai,tma->ti", flat, forces[..., 0])


def _to_rays(rays: Rays, points: Points, places: Array, turns: Array) -> _Pull:
    """Pull of points to rays, of all cameras together."""
    here = points.at(places, turns)
    ways = here[:, None] - rays.origins[:, :, None]
    far = np.maximum(np.linalg.norm(ways, axis=-1), CLOSEST)
    aside = np.eye(3) - rays.ways[..., None] * rays.ways[..., None, :]
    weights = (rays.sharpness / far)[..., None, None] ** 2 * aside
    forces = (weights @ ways[..., None]).sum(1)
    weights = weights.sum(1)
    moves = _moves(len(places), len(points.things), places.shape[1])
    for j, k in enumerate(points.things):
        moves[:, j, :, 0, k] = np.eye(3)
        moves[:, j, :, 1, k] = -cross_matrices(here[:, j] - places[:, k])
    errors = np.linalg.solve(weights + TINY * np.eye(3), forces)[..., 0]
    return _Pull(errors, weights, moves)


def _to_guess(guess: Array, turns: Array) -> _Pull:
    """Pull of rotations to what was guessed."""
    count, things = guess.shape[:2]
    moves = _moves(count, things, things)
    for k in range(things):
        moves[:, k, :, 1, k] = np.eye(3)
    weights = np.tile(np.eye(3) / TURN**2, (count, things, 1, 1))
    return _Pull(-turns_between(turns, guess), weights, moves)


def _to_usual(usual: Usual, places: Array) -> _Pull:
    """Pull of places to where they were in the table's frame."""
    count, things = places.shape[:2]
    moves = _moves(count, things, things)
    for k in range(things):
        moves[:, k, :, 0, k] = np.eye(3)
    weights = np.tile(usual.precision[-1], (count, 1, 1, 1))
    return _Pull(places - usual.mean[-1], weights, moves)


def _to_others(usual: Usual, places: Array, turns: Array, other: int) -> _Pull:
    """Pull of places to where they were in the frame of one object."""
    count, things = places.shape[:2]
    turn = turns[:, other, None]
    there = (turn @ usual.mean[other, ..., None])[..., 0]
    moves = _moves(count, things, things)
    for k in range(things):
        moves[:, k, :, 0, k] = np.eye(3)
    moves[:, :, :, 0, other] -= np.eye(3)
    moves[:, :, :, 1, other] = cross_matrices(there)
    weights = turn @ usual.precision[other] @ turn.swapaxes(-1, -2)
    return _Pull(places - places[:, other, None] - there, weights, moves)


def _moves(count: int, vectors: int, things: int) -> Array:
    return np.zeros((count, vectors, 3, 2, things, 3))
