"""Lenses and places of cameras are found from rendered views of the board."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from duobench.core.errors import CalibrationError
from duobench.core.sheets import Paper
from duobench.core.spatial import SE3
from duobench.core.types import Side
from duobench.real.calibration.board import Board, Detector, board_pose
from duobench.real.calibration.places import (
    BoardView,
    calibrate_lens,
    calibrate_wrist,
    flange_pose,
    locate_head,
)
from duobench.real.canonical import distorted, nominal_pose
from duobench.real.rig import CameraCalibration
from duobench.world.robot.cameras import HEAD
from duobench.world.robot.frames import ROBOT
from duobench.world.robot.mounts import HOME_JOINTS
from tests.real.lenses import D405, ZED
from tests.real.with_libraries.board_views import view

cv2 = pytest.importorskip("cv2", reason="It is not installed here: make test-hardware")

BOARD = Board()
TABLE_FROM_BOARD = SE3.at(0.40, 0.11, 0.0, yaw=-math.pi / 2)
HEAD_POSE = nominal_pose(HEAD) @ SE3.about((0.3, 1.0, 0.2), math.radians(2.0))
HAND = nominal_pose("left_wrist") @ SE3(
    SE3.about((1.0, -0.5, 0.3), math.radians(3.0)).rotation, np.array([0.006, -0.004, 0.008])
)
"""Where the imitated wrist camera really is."""


def check_pose(found: CameraCalibration, pose: SE3, metres: float, degrees: float) -> None:
    distance, angle = SE3.from_tquat(found.pose).distance(pose)
    assert distance < metres
    assert math.degrees(angle) < degrees
    assert found.error_px is not None
    assert found.error_px < 0.5


def is_seen(camera_from_board: SE3, lens: CameraCalibration, margin: float = 30.0) -> bool:
    size = BOARD.size
    edges = np.array([[0, 0, 0], [size[0], 0, 0], [0, size[1], 0], [*size, 0]])
    points = camera_from_board.apply(edges)
    if points[:, 2].min() < 0.1 or camera_from_board.inverse().translation[2] < 0.05:
        return False
    pixels = distorted(points[:, :2] / points[:, 2:], lens)
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    return bool(low.min() > margin and high[0] < 1280 - margin and high[1] < 720 - margin)


@cache
def wrist_views(side: Side, count: int = 20, spread: float = 0.4) -> tuple[BoardView, ...]:
    """Poses around one above a board, as a person would choose them."""
    random = np.random.default_rng(5)
    home = np.array(HOME_JOINTS[side.index])
    table_from_camera = flange_pose(ROBOT, side, home) @ HAND
    there = table_from_camera.translation + 0.42 * table_from_camera.rotation[:, 2]
    table_from_board = SE3.at(*there, yaw=0.3) @ SE3.at(*(-BOARD.middle))
    views: list[BoardView] = []
    while len(views) < count:
        joints = home + random.uniform(-spread, spread, 7)
        pose = (flange_pose(ROBOT, side, joints) @ HAND).inverse() @ table_from_board
        if is_seen(pose, D405):
            views.append(BoardView(image=view(BOARD, pose, D405, random), joints=joints))
    return tuple(views)


def test_corners_are_found_to_a_fraction_of_a_pixel() -> None:
    pose = SE3.about((1.0, 0.2, 0.1), math.pi - 0.4)
    pose = SE3(pose.rotation, -pose.apply(BOARD.middle) + np.array([0.0, 0.0, 0.5]))
    image = view(BOARD, pose, D405, np.random.default_rng(0))
    found = Detector(BOARD).find(image)
    assert found is not None
    assert len(found.points) == 28
    seen = pose.apply(found.points)
    error = found.pixels - distorted(seen[:, :2] / seen[:, 2:], D405)
    assert np.abs(error).max() < 0.15
    distance, angle = board_pose(found, D405).distance(pose)
    assert distance < 0.001
    assert math.degrees(angle) < 0.3
    assert Detector(BOARD).find(np.full((720, 1280, 3), 110, np.uint8)) is None


def test_a_lens_is_found() -> None:
    random, images = np.random.default_rng(1), []
    while len(images) < 20:
        turn = SE3.about(random.normal(size=3), random.uniform(0.2, 0.7)).rotation
        turn = turn @ np.diag([1.0, -1.0, -1.0])
        place = np.array([*random.uniform((-0.3, -0.17), (0.3, 0.17)), random.uniform(0.35, 0.55)])
        pose = SE3(turn, place - turn @ BOARD.middle)
        if is_seen(pose, ZED, margin=5.0):
            images.append(view(BOARD, pose, ZED, random))
    lens = calibrate_lens(images, BOARD)
    assert (lens.fx, lens.fy) == pytest.approx((ZED.fx, ZED.fy), rel=0.003)
    assert (lens.cx, lens.cy) == pytest.approx((ZED.cx, ZED.cy), abs=3.0)
    directions = np.stack(np.meshgrid([-0.7, 0.0, 0.7], [-0.4, 0.0, 0.4]), axis=-1)
    shift = np.linalg.norm(distorted(directions, lens) - distorted(directions, ZED), axis=-1)
    assert shift.max() < 3.0
    with pytest.raises(CalibrationError, match="10 are needed"):
        calibrate_lens(images[:6], BOARD)


@pytest.mark.parametrize("paper", Paper)
def test_the_head_is_located_by_one_pose(paper: Paper) -> None:
    board = Board(paper=paper)
    where = SE3.at(0.40, board.size[0] / 2, 0.0, yaw=-math.pi / 2)
    pose = HEAD_POSE.inverse() @ where
    images = [view(board, pose, ZED, np.random.default_rng(seed)) for seed in range(5)]
    measured = locate_head(images, board, ZED, where)
    check_pose(measured.calibration, HEAD_POSE, 0.004 if paper == "a4" else 0.003, 0.3)
    assert (measured.notes, measured.calibration.views) == ((), 5)


def test_a_board_that_lies_otherwise_is_noticed() -> None:
    image = view(BOARD, HEAD_POSE.inverse() @ TABLE_FROM_BOARD, ZED, np.random.default_rng(2))
    turned = TABLE_FROM_BOARD @ SE3.at(*BOARD.size, yaw=math.pi)
    with pytest.raises(CalibrationError, match="with its ruler on the side"):
        locate_head([image], BOARD, ZED, turned)
    near = SE3.at(0.46, 0.11, 0.0, yaw=-math.pi / 2)
    measured = locate_head([image], BOARD, ZED, near)
    assert "60 mm" in measured.notes[0] or "59 mm" in measured.notes[0], measured.notes
    with pytest.raises(CalibrationError, match="0 of 1 images show"):
        locate_head([np.zeros_like(image)], BOARD, ZED, TABLE_FROM_BOARD)


@pytest.mark.parametrize("side", [Side.LEFT, Side.RIGHT])
def test_a_wrist_camera_is_found(side: Side) -> None:
    measured = calibrate_wrist(wrist_views(side), side, BOARD, D405, ROBOT)
    check_pose(measured.calibration, HAND, 0.0005, 0.1)
    assert measured.error_mm is not None
    assert measured.error_mm < 1.0
    assert measured.calibration.views == 20
    assert measured.calibration.opencv == cv2.__version__


@pytest.mark.parametrize("scale", [0.976, 1.03])
def test_a_wrong_scale_is_found_by_the_motion_of_the_arm(scale: float) -> None:
    said = BOARD.measured(200.0 * scale)
    with pytest.raises(CalibrationError, match=r"larger than by its ruler"):
        calibrate_wrist(wrist_views(Side.LEFT), Side.LEFT, said, D405, ROBOT)


def test_a_print_of_another_size_is_right_once_it_was_measured() -> None:
    small = Board().measured(195.2)
    pose = HEAD_POSE.inverse() @ TABLE_FROM_BOARD
    image = view(small, pose, ZED, np.random.default_rng(3))
    found = [locate_head([image], board, ZED, TABLE_FROM_BOARD) for board in (small, BOARD)]
    poses = [SE3.from_tquat(each.calibration.pose) for each in found]
    right, wrong = (pose.distance(HEAD_POSE)[0] for pose in poses)
    assert right < 0.005
    assert wrong > 0.015, "the scale makes no difference in this test"


def test_a_board_that_was_pushed_is_noticed() -> None:
    views = list(wrist_views(Side.LEFT))
    random = np.random.default_rng(8)
    for number in range(12, 20):
        joints = views[number].joints
        table_from_camera = flange_pose(ROBOT, Side.LEFT, joints) @ HAND
        found = Detector(BOARD).find(views[number].image)
        assert found is not None
        pose = board_pose(found, D405)
        pushed = (table_from_camera @ pose).moved(x=0.02)
        image = view(BOARD, table_from_camera.inverse() @ pushed, D405, random)
        views[number] = replace(views[number], image=image)
    with pytest.raises(CalibrationError):
        calibrate_wrist(views, Side.LEFT, BOARD, D405, ROBOT)


def test_poses_that_are_too_few_or_too_alike_are_refused() -> None:
    first, *rest = views = wrist_views(Side.LEFT)
    alike = [replace(view, joints=first.joints + 0.01 * k) for k, view in enumerate(views)]
    wrong = (np.full(7, np.nan), np.zeros(6), np.degrees(first.joints))
    bad = [([replace(first, joints=joints), *rest], "7 joints in radians") for joints in wrong]
    for given, words in [(views[:8], "12 are needed"), (alike, "too much alike"), *bad]:
        with pytest.raises(CalibrationError, match=words):
            calibrate_wrist(given, Side.LEFT, BOARD, D405, ROBOT)
