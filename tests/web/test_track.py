from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from duobench.core.errors import DataError
from duobench.tasks import get
from duobench.web.geometry import Geometry
from duobench.web.track import decode, encode, length
from tests.task_harness import TaskHarness

MOST_BYTES_A_STEP = 350


def angles(one: NDArray[np.floating], other: NDArray[np.floating]) -> NDArray[np.float64]:
    """Angles in radians between quaternions."""
    one, other = one.astype(np.float64), other.astype(np.float64)
    sign = np.sign(np.einsum("...i,...i", one, other))[..., None]
    return 2 * np.linalg.norm(one - sign * other, axis=-1)


def wander(rng: np.random.Generator, steps: int, bodies: int) -> NDArray[np.float32]:
    """Poses of bodies that drift and turn, their quaternions of any sign."""
    poses = np.cumsum(rng.normal(size=(steps, bodies, 7)) * 0.02, axis=0)
    poses[..., 3:] += rng.normal(size=(bodies, 4))
    poses[..., 3:] /= np.linalg.norm(poses[..., 3:], axis=-1, keepdims=True)
    poses[..., 3:] *= rng.choice([-1.0, 1.0], size=(steps, bodies, 1))
    return poses.astype(np.float32)


def check_errors(back: NDArray[np.float32], poses: NDArray[np.float32]) -> None:
    assert (back.shape, back.dtype) == (poses.shape, np.float32)
    assert np.linalg.norm(back[..., :3] - poses[..., :3], axis=-1).max() <= 1e-4
    assert angles(back[..., 3:], poses[..., 3:]).max() <= 1e-4


@pytest.mark.parametrize("seed", range(5))
def test_errors_are_small(seed: int) -> None:
    rng = np.random.default_rng(seed)
    poses = wander(rng, int(rng.integers(1, 200)), int(rng.integers(1, 40)))
    check_errors(decode(encode(poses)), poses)


def test_signs_of_quaternions_cost_nothing() -> None:
    poses = wander(np.random.default_rng(0), 100, 5)
    steady = poses.copy()
    signs = np.sign(np.einsum("tbi,bi->tb", steady[:, :, 3:], steady[0, :, 3:]))
    steady[:, :, 3:] *= signs[..., None]
    assert len(encode(poses)) == len(encode(steady))
    turns = decode(encode(poses))[:, :, 3:]
    assert np.einsum("tbi,tbi->tb", turns[:-1], turns[1:]).min() > 0


def test_what_rests_costs_next_to_nothing() -> None:
    poses = np.repeat(wander(np.random.default_rng(1), 1, 30), 600, axis=0)
    assert len(encode(poses)) < 3000


def test_arms_that_move_with_a_cup_of_marbles_fit() -> None:
    """The task with most bodies, with arms and marbles in motion."""
    simulation = TaskHarness(get("pour_marbles")).sim
    geometry = Geometry(simulation.model)
    command = simulation.duo.command()
    phases = np.arange(command.joints.size).reshape(command.joints.shape)
    poses = []
    for step in range(60):
        swing = 0.5 * np.sin(step / 10 + phases)
        simulation.step(replace(command, joints=command.joints + swing))
        poses.append(geometry.poses(simulation.data))
    track = encode(poses)
    assert length(track) == 60
    assert len(track) / 60 <= MOST_BYTES_A_STEP
    check_errors(decode(track), np.array(poses))


def test_what_left_the_room_stays_at_its_border() -> None:
    poses = np.zeros((3, 1, 7))
    poses[..., 3] = 1.0
    poses[:, 0, 0] = [0.0, 50.0, 0.0]
    np.testing.assert_allclose(decode(encode(poses))[:, 0, 0], [0.0, 3.2767, 0.0], atol=1e-4)


def test_what_are_no_poses_is_rejected() -> None:
    with pytest.raises(DataError, match="finite"):
        encode(np.full((2, 1, 7), np.nan))


@pytest.mark.parametrize("damage", [b"", b"DTR2", b"PK\3\4" + bytes(20)])
def test_other_files_are_rejected(damage: bytes) -> None:
    for read in (decode, length):
        with pytest.raises(DataError, match="no track"):
            read(damage)


def test_damage_is_found() -> None:
    track = encode(wander(np.random.default_rng(2), 20, 3))
    for damaged in (track[:-10], track[:4] + (19).to_bytes(4, "little") + track[8:]):
        with pytest.raises(DataError, match="damaged"):
            decode(damaged)
