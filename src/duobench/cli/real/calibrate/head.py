"""`duobench real calibrate head`: the place of the head camera."""

from __future__ import annotations

import math
from pathlib import Path

from duobench.cli.shared.calibration import (
    known_lens,
    measured_board,
    open_views,
    write_place,
)
from duobench.cli.shared.rigs import rig_file
from duobench.core.sheets import Paper
from duobench.core.spatial import SE3
from duobench.real.rig import Rig
from duobench.world.robot.cameras import HEAD


def run(
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

    known, sheet = Rig.read(rig_file(rig)), measured_board(paper, ruler)
    seen = known_lens(known, HEAD)
    folder = open_views(known, views, HEAD, None, sheet)
    x, y, angle = at
    where = SE3.at(
        x / 1000.0,
        y / 1000.0,
        0.0,
        yaw=math.radians(angle),
    )
    write_place(rig, known, HEAD, locate_head(folder.images(), sheet, seen, where))
