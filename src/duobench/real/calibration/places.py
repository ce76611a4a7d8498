"""The lens of a camera, and where it is: on the table the head's, on a flange a wrist's.

For a wrist camera, hand-eye calibration by the method of Park and Martin gives a first answer; it
is then made better by least squares of the pixels of all corners, with the place of the board as a
second unknown. The motion of the arm tells how large the board is, which finds a wrong scale.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime

import numpy as np

from duobench.core.backend import Image
from duobench.core.errors import CalibrationError
from duobench.core.spatial import SE3, rotation_by, rotation_vector
from duobench.core.types import ARM_JOINTS, Array, Side
from duobench.real.calibration.board import (
    Board,
    Detection,
    Detector,
    board_pose,
    offsets,
    opencv,
    rms,
    split_views,
)
from duobench.real.canonical import nominal_pose
from duobench.real.rig import UNPOSED, CameraCalibration
from duobench.world.robot.cameras import HEAD, wrist_name
from duobench.world.robot.frames import Robot
from duobench.world.robot.joints import JOINT_RANGES

NOTED_M, NOTED_DEG = 0.03, 8.0
"""Distance and angle to the simulation's camera from which a place is remarked on."""
REFUSED_M, REFUSED_DEG = 0.25, 45.0
"""And from which something must be wrong."""
LARGEST_ERROR_PX = 2.0
"""Error on held-out corners from which something is wrong."""


FEWEST_LENS_VIEWS = 10
LARGEST_LENS_ERROR_PX = 1.0
"""Error of a lens on held-out images from which something is wrong."""


def calibrate_lens(images: Sequence[Image], board: Board) -> CameraCalibration:
    """Focal lengths, middle and distortion of a camera, without its place.

    Images show the board from many sides and in all their parts, at least ten times; every fifth
    is held out. The scale of the board does not matter here.
    """
    height, width, _ = images[0].shape
    found = Detector(board).find_all(images, FEWEST_LENS_VIEWS)
    used, held = split_views([detection for _, detection in found])
    _, matrix, distortion, _, _ = opencv().calibrateCamera(
        [each.points.astype(np.float32) for each in used],
        [each.pixels.astype(np.float32) for each in used],
        (width, height),
        None,
        None,
    )
    lens = CameraCalibration(
        fx=float(matrix[0, 0]),
        fy=float(matrix[1, 1]),
        cx=float(matrix[0, 2]),
        cy=float(matrix[1, 2]),
        distortion=tuple(float(each) for each in np.ravel(distortion)[:5]),
        pose=UNPOSED,
    )
    error = rms([offsets(each, board_pose(each, lens), lens) for each in held])
    if error > LARGEST_LENS_ERROR_PX:
        raise CalibrationError(
            f"Images that were held out are off by {error:.2f} px with the lens that was found; "
            f"at most {LARGEST_LENS_ERROR_PX:g} is usual. Is the board flat, and were "
            "the images sharp?"
        )
    return lens


@dataclass(frozen=True, kw_only=True, slots=True)
class Measured:
    """Result of a calibration."""

    calibration: CameraCalibration
    error_mm: float | None = None
    """How far the board's middle is from where it should be, on held-out views; None for a single
    place of the board."""
    notes: tuple[str, ...] = ()
    """Remarks for the operator, one sentence each."""


def locate_head(
    images: Sequence[Image],
    board: Board,
    lens: CameraCalibration,
    table_from_board: SE3,
) -> Measured:
    """The place of the head camera, from a board at a known place on the table.

    One or more images show the board, as it was printed, which lies still; every fifth corner is
    held out.
    """
    found = [each for _, each in Detector(board).find_all(images, 1)]
    points = np.concatenate([each.points for each in found])
    pixels = np.concatenate([each.pixels for each in found])
    _, numbers = np.unique(points, axis=0, return_inverse=True)
    is_test = numbers.ravel() % 5 == 4  # noqa: PLR2004 - the fifth
    pose = board_pose(Detection(points=points[~is_test], pixels=pixels[~is_test]), lens)
    test = Detection(points=points[is_test], pixels=pixels[is_test])
    table_from_camera = table_from_board @ pose.inverse()
    error = rms([offsets(test, pose, lens)])
    return _measured(
        HEAD, lens, table_from_camera, "one pose of a board", len(found), error
    )


def _measured(
    camera: str,
    lens: CameraCalibration,
    pose: SE3,
    method: str,
    views: int,
    error_px: float,
) -> Measured:
    """A lens with a place, how it was found, and what is remarkable about it."""
    if error_px > LARGEST_ERROR_PX:
        raise CalibrationError(
            f"What was held out is off by {error_px:.2f} px; at most {LARGEST_ERROR_PX:g} is "
            "usual. Did the board move, or was it bent? Are the joints those of this arm?"
        )
    distance, angle = pose.distance(nominal_pose(camera))
    degrees = math.degrees(angle)
    text = (
        f"{camera} was found {1000 * distance:.0f} mm and {degrees:.1f} degrees from where the "
        "simulation has it"
    )
    if distance > REFUSED_M or degrees > REFUSED_DEG:
        raise CalibrationError(
            f"{text}. Does the board lie where it was said, with its ruler on the side that was "
            "said, and is it the right camera?"
        )
    is_far = distance > NOTED_M or degrees > NOTED_DEG
    calibration = replace(
        lens,
        pose=tuple(float(each) for each in pose.tquat),
        method=method,
        views=views,
        error_px=round(error_px, 4),
        opencv=str(opencv().__version__),
        date=datetime.now(UTC).date().isoformat(),
    )
    return Measured(calibration=calibration, notes=(f"{text}.",) if is_far else ())


# --- a wrist camera ---

MAX_JOINT = float(np.max(np.abs(JOINT_RANGES))) + 0.1
FEWEST_VIEWS = 12
SMALLEST_TURN = math.radians(15.0)
"""Rotation of the arm, about a second axis, that the poses must have at least."""
LARGEST_SCALE_ERROR = 0.01
"""Difference between the board's size by the arm and by its ruler from which one is wrong."""
LARGEST_ERROR_MM = 5.0
"""Error of the board's place on held-out views from which something is wrong."""


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    eq=False,
)
class BoardView:
    """An image of the board, and where the arm was."""

    image: Image
    joints: Array
    """Joint positions (7,) in radians, at rest."""


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    eq=False,
)
class _Seen:
    detection: Detection
    table_from_flange: SE3


def flange_pose(robot: Robot, side: Side, joints: Array) -> SE3:
    """Pose of an arm's flange in the table frame at joint positions (7,) in radians."""
    return robot.tool_pose(side, joints) @ SE3.at(z=-robot.gripper.tool_offset)


def calibrate_wrist(
    views: Sequence[BoardView],
    side: Side,
    board: Board,
    lens: CameraCalibration,
    robot: Robot,
) -> Measured:
    """The place of a wrist camera in its flange.

    There are 15 to 25 views of a board, as it was printed, that does not move. The wrist is turned
    by 20 to 40 degrees about at least two axes; every fifth view is held out.
    """
    for view in views:
        if np.shape(view.joints) != (ARM_JOINTS,) or not np.all(
            np.abs(view.joints) < MAX_JOINT
        ):
            raise CalibrationError(
                f"A view has {ARM_JOINTS} joints in radians: {view.joints}."
            )
    found = Detector(board).find_all([view.image for view in views], FEWEST_VIEWS)
    seen = [
        _Seen(
            detection=each,
            table_from_flange=flange_pose(robot, side, views[number].joints),
        )
        for number, each in found
    ]
    train, test = split_views(seen)
    _check_turns([each.table_from_flange for each in train])
    flange_from_camera, table_from_board, scale = _solve(train, lens)
    if abs(scale - 1.0) > LARGEST_SCALE_ERROR:
        raise CalibrationError(
            f"By the motion of the arm the board is {100 * (scale - 1):+.1f} % larger than by its "
            "ruler. Measure the ruler again, and look whether the board has moved."
        )
    expected = [
        _camera_from_board(each, flange_from_camera, table_from_board) for each in test
    ]
    tests = [each.detection for each in test]
    error = rms([offsets(*each, lens) for each in zip(tests, expected, strict=True)])
    seen_at = np.array([board_pose(each, lens).apply(board.middle) for each in tests])
    due_at = np.array([pose.apply(board.middle) for pose in expected])
    error_mm = 1000.0 * float(np.mean(np.linalg.norm(seen_at - due_at, axis=-1)))
    if error_mm > LARGEST_ERROR_MM:
        raise CalibrationError(
            f"On held-out views the board is {error_mm:.1f} mm from where it should be; at most "
            f"{LARGEST_ERROR_MM:g} is usual. Did the board move, or were the arm's joints read "
            "while it moved?"
        )
    camera, method = wrist_name(side), "hand-eye (Park), refined on pixels"
    found = _measured(camera, lens, flange_from_camera, method, len(seen), error)
    return replace(found, error_mm=error_mm)


def _check_turns(poses: Sequence[SE3]) -> None:
    """Reject poses that are turned about one axis only, of which nothing can be learned."""
    first = poses[0].rotation
    turns = np.array([rotation_vector(first.T @ pose.rotation) for pose in poses[1:]])
    spread = np.linalg.svd(turns, compute_uv=False)[1] / math.sqrt(len(turns))
    if 2.0 * spread < SMALLEST_TURN:
        raise CalibrationError(
            "The poses of the arm are too much alike: turn the wrist by 20 to 40 degrees about at "
            "least two axes, and keep the board in sight."
        )


def _solve(seen: Sequence[_Seen], lens: CameraCalibration) -> tuple[SE3, SE3, float]:
    """Camera in the flange, board on the table, and the board's size by the arm's motion."""
    from scipy.optimize import least_squares

    cv2 = opencv()
    boards = [board_pose(each.detection, lens) for each in seen]
    flanges = [each.table_from_flange for each in seen]
    turn, shift = cv2.calibrateHandEye(
        [pose.rotation for pose in flanges],
        [pose.translation for pose in flanges],
        [pose.rotation for pose in boards],
        [pose.translation for pose in boards],
        method=cv2.CALIB_HAND_EYE_PARK,
    )
    if not (np.all(np.isfinite(turn)) and np.all(np.isfinite(shift))):
        raise CalibrationError("No place of the camera explains the views.")
    hand = SE3(turn, np.ravel(shift))
    table = flanges[0] @ hand @ boards[0]

    def unpacked(values: Array) -> tuple[SE3, SE3, float]:
        return (
            _moved(hand, values[:6]),
            _moved(table, values[6:12]),
            1.0 + float(values[12]),
        )

    def residuals(values: Array) -> Array:
        flange_from_camera, table_from_board, scale = unpacked(values)
        parts = []
        for each in seen:
            pose = _camera_from_board(each, flange_from_camera, table_from_board)
            larger = Detection(
                points=scale * each.detection.points, pixels=each.detection.pixels
            )
            parts.append(offsets(larger, pose, lens).ravel())
        return np.concatenate(parts)

    free = least_squares(residuals, np.zeros(13), loss="soft_l1")
    scale = unpacked(free.x)[2]
    fixed = least_squares(
        lambda values: residuals(np.append(values, 0.0)), free.x[:12], loss="soft_l1"
    )
    flange_from_camera, table_from_board, _ = unpacked(np.append(fixed.x, 0.0))
    return flange_from_camera, table_from_board, scale


def _moved(pose: SE3, change: Array) -> SE3:
    """A pose changed by a rotation vector and a shift (6,)."""
    return SE3(pose.rotation @ rotation_by(change[:3]), pose.translation + change[3:])


def _camera_from_board(
    seen: _Seen, flange_from_camera: SE3, table_from_board: SE3
) -> SE3:
    return (seen.table_from_flange @ flange_from_camera).inverse() @ table_from_board
