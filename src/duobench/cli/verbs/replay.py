"""`duobench replay`: replay recorded episodes, as images of their states or by their commands."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import rich.table
from tyro.conf import Positional

from duobench.cli.shared.console import console, counted
from duobench.cli.verbs.data import opened
from duobench.errors import DataError

if TYPE_CHECKING:
    from duobench.backend import Image
    from duobench.data import DataSet, ImageSource, Recording


def replay(
    data: Positional[Path],
    mode: Literal["states", "actions"] = "states",
    tasks: tuple[str, ...] = (),
    out: Path = Path("replay"),
    cameras: tuple[str, ...] = ("overview",),
    size: tuple[int, int] = (480, 640),
    look: str = "default",
) -> None:
    """Replay recorded episodes.

    With states, every recorded state is shown as it was, in a video for each episode, from any
    camera, at any size, in any look. With actions, the commands run through the physics again, and
    a table says whether states and stages come out the same; the exit code is 1 if they do not.

    Args:
        data: Folder of the data set.
        mode: What is replayed.
        tasks: Only these tasks; all of the data set if none is named.
        out: Folder of the videos.
        cameras: What the videos show, side by side: overview, head, left_wrist, right_wrist.
        size: Height and width of one image in pixels, both even.
        look: Look of the images: wood_table, dark, random:7, ... (see docs/looks.md).
    """
    dataset = opened(data)
    if mode == "actions":
        _by_actions(dataset, tasks)
    else:
        _by_states(dataset, tasks, out, cameras, size, look)


def _by_actions(data: DataSet, tasks: tuple[str, ...]) -> None:
    from duobench.data import Recording
    from duobench.replay import replay as play_again
    from duobench.tasks import catalog

    screen = console()
    table = rich.table.Table("task", "episodes", "bit-exact", "same stages", "largest difference")
    wrong = 0
    for task in tasks or data.tasks:
        paths = data.episodes_of([catalog.get(task).id])
        results = []
        for path, result in zip(paths, play_again(task, map(Recording.read, paths)), strict=True):
            results.append(result)
            if not result.is_exact:
                screen.print(
                    f"{path.relative_to(data.path)}: first differs at step {result.first}, stage "
                    f"{result.stage} instead of {result.recorded_stage}",
                )
        wrong += sum(not result.is_exact for result in results)
        table.add_row(
            task,
            str(len(results)),
            str(sum(result.is_exact for result in results)),
            str(sum(result.same_stages for result in results)),
            f"{max((result.largest for result in results), default=0.0):.2g}",
        )
    screen.print(table)
    if wrong:
        screen.print(
            f"{counted(wrong, 'episode')} came out differently: by other versions of MuJoCo or "
            "DuoBench than those that recorded, or on a processor that is no x86-64 with AVX2.",
        )
        sys.exit(1)


def _by_states(
    data: DataSet,
    tasks: tuple[str, ...],
    out: Path,
    cameras: tuple[str, ...],
    size: tuple[int, int],
    look: str,
) -> None:
    from duobench.data import ImageSource, Recording
    from duobench.evaluation.video import FRAME_RATE
    from duobench.files import replacing
    from duobench.results.folder import VIDEO_SUFFIX
    from duobench.tasks import catalog
    from duobench.video import VP9, write_video

    if not cameras:
        raise DataError("A video shows at least one camera; --cameras names none.")
    screen = console()
    for task in tasks or data.tasks:
        paths = data.episodes_of([catalog.get(task).id])
        with closing(ImageSource(task, cameras=cameras, size=size, look=look)) as source:
            for path in paths:
                recording = Recording.read(path)
                target = out / path.parent.name / f"{path.stem}{VIDEO_SUFFIX}"
                with replacing(target) as temporary:
                    write_video(_frames(source, recording), temporary, VP9, FRAME_RATE)
                screen.print(str(target))


def _frames(source: ImageSource, recording: Recording) -> Iterator[Image]:
    """The images of all cameras side by side, for a video."""
    import numpy as np

    from duobench.evaluation.video import FRAME_EVERY

    for row in range(0, len(recording) + 1, FRAME_EVERY):
        yield np.concatenate(list(source.images(recording, row).values()), axis=1)
