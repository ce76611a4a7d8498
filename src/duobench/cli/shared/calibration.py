"""Images of a board, and what is measured from them, in the file of a rig."""

from __future__ import annotations

import sys
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from duobench.cli.shared.advice import AdvisedError
from duobench.cli.shared.console import say
from duobench.core.sheets import Paper
from duobench.core.types import Side
from duobench.real.calibration.board import RULER_MM, Board, Detector
from duobench.real.clock import SystemClock
from duobench.real.rig import CameraCalibration, Rig

if TYPE_CHECKING:
    from duobench.real.calibration.places import Measured
    from duobench.real.calibration.views import ViewFolder


_AT_REST = 0.01
"""Speed of a joint in rad/s under which an arm is at rest."""


def measured_board(paper: Paper, ruler: float | None) -> Board:
    """Return the board as it was printed, by the length of its ruler in mm."""
    if ruler is None:
        wanted = RULER_MM[paper]
        raise AdvisedError(
            f"Measure the ruler on the printed board, and say --ruler MM: it should be "
            f"{wanted:g} mm long, and prints that are not move cameras by centimetres."
        )
    return Board(paper=paper).measured(ruler)


def known_lens(rig: Rig, camera: str) -> CameraCalibration:
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


def open_views(
    rig: Rig, path: Path, camera: str, side: Side | None, sheet: Board
) -> ViewFolder:
    """Return the images in a folder; if it holds no images, they are taken now."""
    from duobench.real.calibration.views import ViewFolder

    folder = ViewFolder(path, camera)
    if not len(folder):
        _capture(rig, folder, camera, side, sheet)
    return folder


def _capture(
    rig: Rig, folder: ViewFolder, camera: str, side: Side | None, sheet: Board
) -> None:
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


def write_place(
    path: Path,
    rig: Rig,
    camera: str,
    found: Measured,
) -> None:
    """Write where a camera is into the file of a rig, and say how well it is known."""
    write_camera(path, rig, camera, found.calibration)
    x, y, z = (1000.0 * each for each in found.calibration.pose[:3])
    say(
        f"{camera}: at {x:.1f}, {y:.1f}, {z:.1f} mm, from {found.calibration.views} images; what "
        f"was held out is off by {found.calibration.error_px:.2f} px"
        + ("" if found.error_mm is None else f" and {found.error_mm:.2f} mm")
    )
    for note in found.notes:
        say(note, style="yellow")


def write_camera(
    path: Path, rig: Rig, camera: str, calibration: CameraCalibration
) -> None:
    """Write the calibration of a camera into the file of a rig."""
    changed = replace(rig.cameras[camera], calibration=calibration)
    replace(rig, cameras={**rig.cameras, camera: changed}).write(path)
    say(f"Written to {path}; the rig has a new hash.")
