"""`duobench export lerobot`: data sets in the format of LeRobot."""

from __future__ import annotations

from pathlib import Path

import tyro

from duobench.cli.shared.advice import (
    FOREIGN,
    Advice,
    AdvisedError,
    advising,
)
from duobench.cli.shared.console import counted, say
from duobench.cli.shared.folders import open_data
from duobench.cli.shared.process import raising
from duobench.cli.shared.progress import display
from duobench.core.errors import NoSuccessesError, SeveralTasksError
from duobench.core.files import taken_back
from duobench.data.lerobot.options import (
    EpisodeChoice,
    ExportForm,
    ExportImages,
    ExportOptions,
)
from duobench.data.used_rows import Reason

_EPISODES, _IMAGES, _FORM = EpisodeChoice(), ExportImages(), ExportForm()
_ADVICE: Advice = {
    SeveralTasksError: "With --per-task one command does that.",
    NoSuccessesError: "With --keep-failures they are exported.",
    **FOREIGN,
}


def run(
    data: tyro.conf.Positional[tuple[Path, ...]],
    out: Path,
    episodes: tyro.conf.OmitArgPrefixes[EpisodeChoice] = _EPISODES,
    images: tyro.conf.OmitArgPrefixes[ExportImages] = _IMAGES,
    export: tyro.conf.OmitArgPrefixes[ExportForm] = _FORM,
    per_task: bool = False,
    workers: int = 1,
    import_tasks: bool = False,
) -> None:
    """Export data sets to LeRobot's format; images are rendered from the recorded states.

    Images of real episodes are those that were recorded. The same command in the same folder goes
    on where it was stopped.

    Args:
        data: Folder of the data set, or of several, simulated and real ones too.
        out: Folder of the export.
        episodes: Which episodes are exported, and which of their rows.
        images: What cameras show of them.
        export: What else is exported of them, and how.
        per_task: Write one data set a task, each in a folder of its name; object states of several
            tasks need it.
        workers: Processes that render and encode side by side.
        import_tasks: Import tasks that are not of the benchmark, which runs the code of the modules
            that the data sets name.
    """
    if not data:
        raise AdvisedError(
            "Name the folder of a data set, such as duobench record makes."
        )
    sources = [
        open_data(each, episodes.tasks, import_tasks=import_tasks) for each in data
    ]
    from duobench.data import export_lerobot
    from duobench.real.canonical import view_of

    new = taken_back(out, "duobench.json")
    with raising(out), new, advising(_ADVICE), display("frame") as shown:
        done = export_lerobot(
            sources,
            out,
            ExportOptions(**vars(episodes), **vars(images), **vars(export)),
            per_task=per_task,
            workers=workers,
            progress=shown.tell,
            view_of=view_of,
        )
    megabytes = (
        sum(path.stat().st_size for path in out.rglob("*") if path.is_file()) / 1e6
    )
    say(
        f"{counted(done.episodes, 'episode')}, {counted(done.frames, 'frame')}, "
        f"{megabytes:.1f} MB in {out}",
    )
    if done.failures:
        say(
            f"Left out: {counted(done.failures, 'episode')} that people led without success; "
            "--keep-failures exports them too."
        )
    others = done.left_out - done.failures
    if others:
        say(
            f"Left out: {counted(others, 'episode')}, discarded, not wanted or there twice."
        )
    trimmed = done.rows_left_out.get(Reason.TRIMMED, 0)
    if trimmed:
        say(f"Left out: {counted(trimmed, 'row')} that were trimmed at a second look.")
    idle = done.rows_left_out.get(Reason.IDLE, 0)
    if idle:
        say(
            f"Left out: {counted(idle, 'row')} in which nobody led and nothing moved; "
            "--keep-idle keeps them."
        )
    uncorrected = done.rows_left_out.get(Reason.UNCORRECTED, 0)
    if uncorrected:
        say(f"Left out: {counted(uncorrected, 'row')} that no take-over is about.")
    if done.eval_layouts:
        of_eval = counted(done.eval_layouts, "episode")
        say(f"{of_eval} with layouts that policies are evaluated on: train on others.")
    if done.residual is not None:
        say(f"Tool poses are missed by inverse kinematics: {done.residual}.")
