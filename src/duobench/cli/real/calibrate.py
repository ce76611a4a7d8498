"""`duobench real calibrate`: lenses and places of cameras, with a printed board."""

from __future__ import annotations

import math
import sys
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import tyro

from duobench.cli.real.rigs import rig_file
from duobench.cli.shared.advice import AdvisedError
from duobench.cli.shared.console import say
from duobench.core.sheets import Paper
from duobench.core.spatial import SE3
from duobench.core.types import HEAD, Side, wrist_name
from duobench.real.calibration.board import RULER_MM, Board, Detector, write_board
from duobench.real.canonical import nominal_pose
from duobench.real.clock import SystemClock
from duobench.real.rig import CameraCalibration, Rig

if TYPE_CHECKING:
    from duobench.real.calibration.places import Measured
    from duobench.real.calibration.views import ViewFolder

_AT_REST = 0.01
"""Speed of a joint in rad/s under which an arm is at rest."""


def calibrate() -> None:
    """Measure lenses and places of cameras with a printed board; not yet tried on a camera."""


def board(out: Path, paper: Paper = Paper.A4) -> None:
    """Write the board as a PDF, to print at 100 %.

    Args:
        out: The PDF.
        paper: Size of the sheet.
    """
    write_board(Board(paper=paper), out)
    say(
        f"{out}: print it at 100 %, glue it flat onto a plate, and measure its ruler, which should "
        f"be {RULER_MM[paper]:g} mm long."
    )


def lens(
    camera: tyro.conf.Positional[Literal["head", "left_wrist", "right_wrist"]],
    rig: Path,
    views: Path,
    paper: Paper = Paper.A4,
) -> None:
    """Measure the lens of a camera from 20 or more images of the board, held by hand.

    Args:
        camera: Name of the camera.
        rig: The rig's file, into which the lens is written.
        views: Folder of images; if there are none in it, they are taken now, one at each Enter.
        paper: Sheet of the board.
    """
    from duobench.real.calibration.places import calibrate_lens

    known, sheet = Rig.read(rig_file(rig)), Board(paper=paper)
    folder = _folder(known, views, camera, None, sheet)
    found = calibrate_lens(folder.images(), sheet)
    pose = tuple(float(each) for each in nominal_pose(camera).tquat)
    note = "lens from a board; place as in the simulation"
    _write(rig, known, camera, replace(found, pose=pose, method=note, views=len(folder)))
    say(
        f"{camera}: {found.fx:.1f} x {found.fy:.1f} px, middle {found.cx:.1f}, {found.cy:.1f}, "
        f"distortion {', '.join(f'{each:.4f}' for each in found.distortion)}. Its place is that of "
        "the simulation until you measure it (again)."
    )


def head(
    rig: Path,
    views: Path,
    ruler: float | None = None,
    at: tuple[float, float, float] = (400.0, 120.0, -90.0),
    paper: Paper = Paper.A4,
) -> None:
    """Measure where the head camera is, from a board that lies at a known place on the table.

    Args:
        rig: The rig's file, into which the place is written.
        views: Folder of images; if there are none in it, they are taken now, one at each Enter.
        ruler: Length of the board's printed ruler in mm, measured with another ruler.
        at: The board's origin on the table, x and y in mm, and the angle of its x axis to the
            table's in degrees. By default its ruler is on the robot's side, and x points to the
            robot's right.
        paper: Sheet of the board.
    """
    from duobench.real.calibration.places import locate_head

    known, sheet = Rig.read(rig_file(rig)), _measured(paper, ruler)
    seen = _lens(known, HEAD)
    folder = _folder(known, views, HEAD, None, sheet)
    x, y, angle = at
    where = SE3.at(x / 1000.0, y / 1000.0, 0.0, yaw=math.radians(angle))
    _finish(rig, known, HEAD, locate_head(folder.images(), sheet, seen, where))


def wrist(
    side: tyro.conf.Positional[Literal["left", "right"]],
    rig: Path,
    views: Path,
    ruler: float | None = None,
    paper: Paper = Paper.A4,
) -> None:
    """Measure where a wrist camera is, from 15 to 25 poses of its arm over a board that lies still.

    Lead the arm by hand with its own buttons; the wrist is turned by 20 to 40 degrees about several
    axes. Every fifth view is held out.

    Args:
        side: Whose wrist.
        rig: The rig's file, into which the place is written.
        views: Folder of images and joints; if there are none in it, they are taken now, one at
            each Enter.
        ruler: Length of the board's printed ruler in mm, measured with another ruler.
        paper: Sheet of the board.
    """
    from duobench.real.calibration.places import calibrate_wrist

    known, sheet, arm = Rig.read(rig_file(rig)), _measured(paper, ruler), Side(side)
    name = wrist_name(arm)
    folder = _folder(known, views, name, arm, sheet)
    found = calibrate_wrist(folder.views(), arm, sheet, _lens(known, name))
    _finish(rig, known, name, found)


def gripper(side: tyro.conf.Positional[Literal["left", "right"]], rig: Path) -> None:
    """Measure at which positions a gripper is open and closed, empty; its fingers move.

    Args:
        side: Whose gripper.
        rig: The rig's file, into which the positions are written.
    """
    from duobench.real.drivers.robotiq import measure_ends
    from duobench.real.rig import GripperDriver

    known, arm = Rig.read(rig_file(rig)), Side(side)
    if known.grippers[arm].driver is not GripperDriver.ROBOTIQ:
        raise AdvisedError(f"The {side} gripper of this rig has no positions to measure.")
    say(
        f"The {side} gripper will open and close, with nothing between its fingers. Press Enter to "
        "go on, or Ctrl-C to leave."
    )
    if not sys.stdin.readline():
        raise AdvisedError("Nobody said that the gripper may move.")
    found = measure_ends(known.grippers[arm], SystemClock())
    replace(known, grippers={**known.grippers, arm: found}).write(rig)
    say(f"Open at {found.open_count}, closed at {found.closed_count}; written to {rig}.")


def _measured(paper: Paper, ruler: float | None) -> Board:
    if ruler is None:
        wanted = RULER_MM[paper]
        raise AdvisedError(
            f"Measure the ruler on the printed board, and say --ruler MM: it should be "
            f"{wanted:g} mm long, and prints that are not move cameras by centimetres."
        )
    return Board(paper=paper).measured(ruler)


def _lens(rig: Rig, camera: str) -> CameraCalibration:
    """The lens in the rig, or that which the camera itself tells."""
    from duobench.real.opening import open_rig

    config = rig.cameras.get(camera)
    if config is None:
        raise AdvisedError(f"The rig has no camera {camera}.")
    if config.calibration is not None:
        return config.calibration
    device = open_rig(rig, SystemClock(), guard=False).cameras[camera]
    try:
        device.connect()
        lens = getattr(device, "lens", None)
    finally:
        device.close()
    if lens is None:
        raise AdvisedError(
            f"The lens of {camera} is not known. Measure it first: duobench real calibrate lens "
            f"{camera}"
        )
    return lens


def _folder(rig: Rig, path: Path, camera: str, side: Side | None, sheet: Board) -> ViewFolder:
    """The images in a folder; where there are none, they are taken now."""
    from duobench.real.calibration.views import ViewFolder

    folder = ViewFolder(path, camera)
    if not len(folder):
        _capture(rig, folder, camera, side, sheet)
    return folder


def _capture(rig: Rig, folder: ViewFolder, camera: str, side: Side | None, sheet: Board) -> None:
    """Take an image at each Enter; nothing moves by itself."""
    from duobench.real.opening import open_rig

    if camera not in rig.cameras:
        raise AdvisedError(f"The rig has no camera {camera}.")
    detector = Detector(sheet)
    duo = open_rig(rig, SystemClock(), guard=False)
    device, arm = duo.cameras[camera], None if side is None else duo.arms[side]
    with ExitStack() as ending:
        for each in filter(None, (device, arm)):
            ending.callback(each.close)
            each.connect()
        say("Enter takes an image, d and Enter ends. The arm has to be at rest.")
        while (line := sys.stdin.readline()) and line.strip() != "d":
            frame = device.latest()
            reading = None if arm is None else arm.read()
            found = None if frame is None else detector.find(frame.image)
            if frame is None or device.fault is not None:
                say("The camera gives no image.")
            elif reading is not None and abs(reading.velocities).max() > _AT_REST:
                say("The arm moves; not taken.")
            elif found is None:
                say("The board is not seen; not taken.")
            else:
                folder.add(frame.image, None if reading is None else reading.joints)
                say(f"{len(folder)}: {len(found.points)} of 28 corners")


def _finish(path: Path, rig: Rig, camera: str, found: Measured) -> None:
    _write(path, rig, camera, found.calibration)
    x, y, z = (1000.0 * each for each in found.calibration.pose[:3])
    say(
        f"{camera}: at {x:.1f}, {y:.1f}, {z:.1f} mm, from {found.calibration.views} images; what "
        f"was held out is off by {found.calibration.error_px:.2f} px"
        + ("" if found.error_mm is None else f" and {found.error_mm:.2f} mm")
    )
    for note in found.notes:
        say(note, style="yellow")


def _write(path: Path, rig: Rig, camera: str, calibration: CameraCalibration) -> None:
    changed = replace(rig.cameras[camera], calibration=calibration)
    replace(rig, cameras={**rig.cameras, camera: changed}).write(path)
    say(f"Written to {path}; the rig has a new hash.")
