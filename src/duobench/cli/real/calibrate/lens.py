"""`duobench real calibrate lens`: the lens of a camera."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

import tyro

from duobench.cli.shared.calibration import open_views, write_camera
from duobench.cli.shared.console import say
from duobench.cli.shared.rigs import rig_file
from duobench.core.sheets import Paper
from duobench.real.calibration.board import Board
from duobench.real.canonical import nominal_pose
from duobench.real.rig import Rig


def run(
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
    folder = open_views(known, views, camera, None, sheet)
    found = calibrate_lens(folder.images(), sheet)
    pose = tuple(
        float(each) for each in nominal_pose(camera, known.robot.gripper).tquat
    )
    note = "lens from a board; place as in the simulation"
    write_camera(
        rig,
        known,
        camera,
        replace(
            found,
            pose=pose,
            method=note,
            views=len(folder),
        ),
    )
    say(
        f"{camera}: {found.fx:.1f} x {found.fy:.1f} px, middle {found.cx:.1f}, {found.cy:.1f}, "
        f"distortion {', '.join(f'{each:.4f}' for each in found.distortion)}. Its place is that of "
        "the simulation until you measure it (again)."
    )
