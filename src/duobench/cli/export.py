"""`duobench export`: data sets in the formats that policies are trained on."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import tyro

from duobench.cli.advice import AdvisedError
from duobench.cli.data import opened
from duobench.cli.display.console import console, counted
from duobench.cli.interrupt import raising
from duobench.errors import DuoBenchError, SeveralTasksError


def verbs() -> None:
    """Write data sets in the formats that policies are trained on."""


def lerobot(  # noqa: PLR0913, PLR0917 - each is an argument of the command line
    data: tyro.conf.Positional[tuple[Path, ...]],
    out: Path,
    tasks: tuple[str, ...] = (),
    cameras: tuple[str, ...] = ("head", "left_wrist", "right_wrist"),
    size: tuple[int, int] = (224, 224),
    look: str = "default",
    pairing: Literal["causal", "delayed"] = "causal",
    action: Literal["joint", "cartesian", "cartesian_relative"] = "joint",
    action_source: Literal["intended", "sent", "given"] = "intended",
    object_state: bool = False,
    per_task: bool = False,
    only_successes: bool = False,
    domains: Literal["sim", "real", "mixed"] = "mixed",
    workers: int = 1,
) -> None:
    """Export data sets to LeRobot's format v3.0; images are rendered from the recorded states.

    Images of real episodes are those that were recorded. The same command in the same folder goes
    on where it was stopped.

    Args:
        data: Folder of the data set, or of several, simulated and real ones too.
        out: Folder of the export.
        tasks: Ids of the tasks to export; all of the data set if none is named.
        cameras: Cameras whose images are exported, or none.
        size: Height and width of the images in pixels, even numbers.
        look: How the images look, such as wood_table or random:7; see docs/looks.md.
        pairing: Which observation stands with an action: the one before it (causal) or the one
            after it (delayed).
        action: What the actions are meant for: joint targets, tool poses, or changes of tool poses,
            with rotations as six numbers; see docs/lerobot.md.
        action_source: Which recorded numbers they are made of: what the actor wanted (intended;
            what was sent, where it acted in something else), the commands as they were sent, or as
            they were given, tool poses solved by inverse kinematics.
        object_state: Export where the objects are, as numbers that no camera sees.
        per_task: Write one data set a task, each in a folder of its name; object states of several
            tasks need it.
        only_successes: Leave out episodes that did not succeed.
        domains: Which episodes to export: simulated ones, real ones, or both.
        workers: Processes that render and encode side by side.
    """
    if not data:
        raise AdvisedError("Name the folder of a data set, such as duobench record makes.")
    sources = [opened(each) for each in data]
    from duobench.cli.advice import advising
    from duobench.cli.display.progress import display
    from duobench.data import ActionSource, ExportOptions, Pairing, export_lerobot
    from duobench.data.schema import Domain
    from duobench.rig_sessions.views import view_of

    screen = console()
    options = ExportOptions(
        tasks=tasks,
        cameras=() if cameras == ("none",) else cameras,
        size=size,
        look=look,
        pairing=Pairing(pairing),
        action=action,
        action_source=ActionSource(action_source),
        object_state=object_state,
        only_successes=only_successes,
        domains=tuple(Domain) if domains == "mixed" else (Domain(domains),),
    )
    with raising(screen), advising(_advice), display(screen, "frame") as shown:
        done = export_lerobot(
            sources,
            out,
            options,
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
