"""`duobench export`: data sets in the formats that policies are trained on."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import tyro

from duobench.cli.data import opened
from duobench.cli.display.console import console, counted
from duobench.cli.interrupt import raising


def verbs() -> None:
    """Write data sets in the formats that policies are trained on."""


def lerobot(  # noqa: PLR0913, PLR0917 - each is an argument of the command line
    data: tyro.conf.Positional[Path],
    out: Path,
    tasks: tuple[str, ...] = (),
    cameras: tuple[str, ...] = ("head", "left_wrist", "right_wrist"),
    size: tuple[int, int] = (224, 224),
    look: str = "default",
    pairing: Literal["causal", "delayed"] = "causal",
    action: Literal["intended", "sent", "given"] = "intended",
    only_successes: bool = False,
    workers: int = 1,
) -> None:
    """Export a data set to LeRobot's format v3.0; images are rendered from the recorded states.

    The same command in the same folder goes on where it was stopped.

    Args:
        data: Folder of the data set.
        out: Folder of the export.
        tasks: Ids of the tasks to export; all of the data set if none is named.
        cameras: Cameras whose images are exported; --cameras alone exports none.
        size: Height and width of the images in pixels, even numbers.
        look: How the images look, such as wood_table or random:7; see docs/looks.md.
        pairing: Which observation stands with an action: the one before it (causal) or the one
            after it (delayed).
        action: Which numbers the actions are: joint targets as the actor wanted them (intended;
            what was sent, where it acted in something else), the commands as they were sent, or as
            they were given, tool poses solved by inverse kinematics.
        only_successes: Leave out episodes that did not succeed.
        workers: Processes that render and encode side by side.
    """
    source = opened(data)
    from duobench.cli.display.progress import display
    from duobench.data import ActionSource, ExportOptions, Pairing, export_lerobot

    screen = console()
    options = ExportOptions(
        tasks=tasks,
        cameras=cameras,
        size=size,
        look=look,
        pairing=Pairing(pairing),
        action=ActionSource(action),
        only_successes=only_successes,
    )
    with raising(screen), display(screen, "frame") as shown:
        done = export_lerobot(source, out, options, workers=workers, progress=shown.tell)
    megabytes = sum(path.stat().st_size for path in out.rglob("*") if path.is_file()) / 1e6
    screen.print(
        f"{counted(done.episodes, 'episode')}, {counted(done.frames, 'frame')}, "
        f"{megabytes:.1f} MB in {out}",
    )
    if done.left_out:
        screen.print(f"Left out: {counted(done.left_out, 'episode')}, discarded or not wanted.")
    if done.residual is not None:
        screen.print(f"Tool poses are missed by inverse kinematics: {done.residual}.")
