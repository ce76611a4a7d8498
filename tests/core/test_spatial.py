"""Laws of rigid transforms, on random ones and on the awkward ones."""

import itertools
import math
from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from duobench.core.spatial import (
    SE3,
    dot,
    length,
    matrix_from_wxyz,
    product,
    rotation_about,
    rotation_vector,
    wxyz_from_matrix,
)

EXACT = 1e-12


def rotations() -> list[np.ndarray]:
    """Random rotations, half turns, quarter turns, and tiny ones."""
    found = list(Rotation.random(40, rng=np.random.default_rng(0)).as_matrix())
    for axis in (*np.eye(3), (1, 1, 0), (-1, 2, 3)):
        for angle in (0.0, 1e-9, 1e-4, math.pi / 2, math.pi - 1e-7, math.pi, -math.pi / 3):
            vector = np.asarray(axis) / np.linalg.norm(axis) * angle
            found.append(Rotation.from_rotvec(vector).as_matrix())
    return found


def poses() -> list[SE3]:
    rng = np.random.default_rng(1)
    return [SE3(rotation, rng.normal(size=3)) for rotation in rotations()]


def assert_same(one: SE3, other: SE3, tolerance: float = EXACT) -> None:
    assert_allclose(one.rotation, other.rotation, atol=tolerance)
    assert_allclose(one.translation, other.translation, atol=tolerance)


def test_quaternions_and_matrices_agree_with_scipy() -> None:
    for matrix in rotations():
        w, x, y, z = wxyz_from_matrix(matrix)
        assert w >= 0
        assert_allclose(Rotation.from_quat([x, y, z, w]).as_matrix(), matrix, atol=EXACT)
        assert_allclose(matrix_from_wxyz([w, x, y, z]), matrix, atol=EXACT)
        assert_allclose(matrix_from_wxyz([-w, -x, -y, -z]), matrix, atol=EXACT)
        assert_allclose(math.hypot(w, x, y, z), 1.0, atol=EXACT)


def test_products_and_lengths_are_those_of_linear_algebra() -> None:
    rng = np.random.default_rng(2)
    for one in rotations():
        other, vector = rng.normal(size=(3, 3)), rng.normal(size=3)
        assert_allclose(product(one, other), one @ other, atol=EXACT)
        assert_allclose(product(one.T, vector), one.T @ vector, atol=EXACT)
        assert_allclose(dot(one[0], vector), one[0] @ vector, atol=EXACT)
        assert_allclose(length(vector), np.linalg.norm(vector), atol=EXACT)


def test_rotation_vectors_agree_with_scipy() -> None:
    for matrix in rotations():
        ours, theirs = rotation_vector(matrix), Rotation.from_matrix(matrix).as_rotvec()
        assert_allclose(np.linalg.norm(ours), np.linalg.norm(theirs), atol=1e-9)
        assert_allclose(Rotation.from_rotvec(ours).as_matrix(), matrix, atol=1e-9)


def test_a_rotation_about_an_axis_is_scipys() -> None:
    rng = np.random.default_rng(2)
    for axis, angle in zip(rng.normal(size=(20, 3)), rng.uniform(-7, 7, size=20), strict=True):
        expected = Rotation.from_rotvec(axis / np.linalg.norm(axis) * angle).as_matrix()
        assert_allclose(rotation_about(axis, angle), expected, atol=EXACT)
        assert_allclose(rotation_about(5 * axis, angle), expected, atol=EXACT)


def homogeneous(pose: SE3) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = pose.rotation, pose.translation
    return matrix


def test_transforms_are_the_group_of_homogeneous_matrices() -> None:
    """Hence associative, with an identity and inverses, and points are mapped like frames."""
    points = np.random.default_rng(3).normal(size=(2, 5, 3))
    ones = np.ones((*points.shape[:-1], 1))
    assert np.array_equal(homogeneous(SE3()), np.eye(4))
    for a, b in zip(poses(), reversed(poses()), strict=True):
        assert_allclose(homogeneous(a @ b), homogeneous(a) @ homogeneous(b), atol=EXACT)
        assert_allclose(homogeneous(a) @ homogeneous(a.inverse()), np.eye(4), atol=EXACT)
        mapped = np.concatenate([points, ones], axis=-1) @ homogeneous(a).T
        assert_allclose(a.apply(points), mapped[..., :3], atol=EXACT)
        assert_allclose(a.apply(points[0, 0]), mapped[0, 0, :3], atol=EXACT)


def test_tquat_round_trip() -> None:
    for pose in poses():
        numbers = pose.tquat
        assert numbers.shape == (7,)
        assert_same(SE3.from_tquat(numbers), pose)
        assert_same(SE3.from_tquat([*numbers[:3], *(-3.0 * numbers[3:])]), pose)
        assert_same(SE3.from_wxyz(pose.wxyz, pose.translation), pose)


def test_yaw_is_the_turn_of_an_upright_pose() -> None:
    for yaw in (-3.0, -0.1, 0.0, 1.0, 3.0):
        pose = SE3.at(1.0, 2.0, 3.0, yaw=yaw)
        assert pose.yaw == pytest.approx(yaw)
        assert pose.translation.tolist() == [1.0, 2.0, 3.0]
        assert_allclose(pose.rotation[2], [0, 0, 1], atol=EXACT)


def test_distance_is_a_metric_that_frames_do_not_change() -> None:
    all_poses = poses()
    for a, b, c in zip(all_poses, all_poses[1:], all_poses[2:], strict=False):
        length, angle = a.distance(b)
        assert (length, angle) == pytest.approx(b.distance(a), abs=1e-9)
        assert (length, angle) == pytest.approx((c @ a).distance(c @ b), abs=1e-7)
        assert 0 <= angle <= math.pi + 1e-9
        assert a.distance(a) == pytest.approx((0.0, 0.0), abs=1e-7)
        assert length <= a.distance(c)[0] + c.distance(b)[0] + EXACT
        assert angle <= a.distance(c)[1] + c.distance(b)[1] + 1e-9


def test_interpolation_ends_at_both_poses_and_is_even() -> None:
    all_poses = poses()
    for a, b in itertools.pairwise(all_poses):
        assert_same(a.interpolate(b, 0.0), a, 1e-9)
        assert_same(a.interpolate(b, 1.0), b, 1e-7)
        length, angle = a.distance(b)
        assert a.distance(a.interpolate(b, 0.3)) == pytest.approx(
            (0.3 * length, 0.3 * angle), abs=1e-7
        )


def test_moved_shifts_in_the_target_frame() -> None:
    for pose in poses():
        assert_same(pose.moved(x=1.0, z=-2.0), SE3(np.eye(3), np.array([1.0, 0.0, -2.0])) @ pose)


def test_a_transform_cannot_be_changed() -> None:
    source = np.zeros(3)
    pose = SE3(np.eye(3), source)
    source[0] = 1.0
    assert pose.translation[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        pose.translation[0] = 1.0
    with pytest.raises(FrozenInstanceError):
        pose.rotation = np.eye(3)  # type: ignore[misc]


def test_wrong_shapes_are_refused() -> None:
    for wrong, shape in (((np.eye(4),), r"\(3, 3\)"), ((np.eye(3), np.zeros(2)), r"\(3,\)")):
        with pytest.raises(ValueError, match=shape):
            SE3(*wrong)
