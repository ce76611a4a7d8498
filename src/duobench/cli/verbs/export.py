"""`duobench export`: data sets in the formats that policies are trained on."""

from __future__ import annotations

from pathlib import Path

import tyro

from duobench.cli.shared.advice import AdvisedError, advising
from duobench.cli.shared.console import console, counted
from duobench.cli.shared.interrupt import raising
from duobench.cli.verbs.data import opened
from duobench.data.lerobot.options import ExportOptions
from duobench.errors import DuoBenchError, SeveralTasksError

_DEFAULTS = ExportOptions()


def verbs() -> None:
    """Write data sets in the formats that policies are trained on."""


def lerobot(
    data: tyro.conf.Positional[tuple[Path, ...]],
    out: Path,
    export: tyro.conf.OmitArgPrefixes[ExportOptions] = _DEFAULTS,
    per_task: bool = False,
    workers: int = 1,
) -> None:
    """Export data sets to LeRobot's format v3.0; images are rendered from the recorded states.

    Images of real episodes are those that were recorded. The same command in the same folder goes
    on where it was stopped.

    Args:
        data: Folder of the data set, or of several, simulated and real ones too.
        out: Folder of the export.
        export: What is exported, and how.
        per_task: Write one data set a task, each in a folder of its name; object states of several
            tasks need it.
        workers: Processes that render and encode side by side.
    """
    if not data:
        raise AdvisedError("Name the folder of a data set, such as duobench record makes.")
    sources = [opened(each) for each in data]
    from duobench.cli.shared.progress import display
    from duobench.data import export_lerobot
    from duobench.rig_sessions.cameras import view_of

    screen = console()
    with raising(screen), advising(_advice), display(screen, "frame") as shown:
        done = export_lerobot(
            sources,
            out,
            export,
            per_task=per_task,
            workers=workers,
            progress=shown.tell,
            view_of=view_of,
        )
    megabytes = sum(path.stat().st_size for path in out.rglob("*") if path.is_file()) / 1e6
    screen.print(
        f"{counted(done.episodes, 'episode')}, {counted(done.frames, 'frame')}, "
        f"{megabytes:.1f} MB in {out}",
    )
    if done.left_out:
        screen.print(f"Left out: {counted(done.left_out, 'episode')}, discarded or not wanted.")
    if done.residual is not None:
        screen.print(f"Tool poses are missed by inverse kinematics: {done.residual}.")


def _advice(error: DuoBenchError) -> str | None:
    return (
        "With --per-task one command does that." if isinstance(error, SeveralTasksError) else None
    )
