"""`duobench real calibrate wrist`: the place of a wrist camera."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import tyro

from duobench.cli.shared.calibration import (
    known_lens,
    measured_board,
    open_views,
    write_place,
)
from duobench.cli.shared.rigs import rig_file
from duobench.core.sheets import Paper
from duobench.core.types import Side
from duobench.real.rig import Rig
from duobench.world.robot.cameras import wrist_name


def run(
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

    known = Rig.read(rig_file(rig))
    sheet = measured_board(paper, ruler)
    arm = Side(side)
    name = wrist_name(arm)
    folder = open_views(known, views, name, arm, sheet)
    found = calibrate_wrist(
        folder.views(), arm, sheet, known_lens(known, name), known.robot
    )
    write_place(rig, known, name, found)
