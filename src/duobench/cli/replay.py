"""`duobench replay`: recorded episodes, as videos or played again."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from rich.table import Table
from tyro.conf import Positional

from duobench.cli.shared.advice import FOREIGN, advising
from duobench.cli.shared.console import counted, say
from duobench.cli.shared.folders import open_data
from duobench.core.backend import Image
from duobench.core.errors import DataError
from duobench.core.files import (
    check_outside,
    remove_abandoned,
    replacing,
    taken_back,
)
from duobench.results.folder import VIDEO_SUFFIX
from duobench.tasks import catalog
from duobench.world.robot.cameras import Camera

if TYPE_CHECKING:
    from duobench.data import DataSet, ImageSource, Recording


def run(  # noqa: PLR0913, PLR0917 - each is an argument of the command line
    data: Positional[Path],
    mode: Literal["states", "actions"] = "states",
    tasks: tuple[str, ...] = (),
    out: Path = Path("replay"),
    cameras: tuple[str | Camera, ...] = ("overview",),
    size: tuple[int, int] = (480, 640),
    depth: bool = False,
    segmentation: bool = False,
    look: str = "default",
    import_tasks: bool = False,
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
        cameras: What the videos show, side by side: overview, head, left_wrist, right_wrist, or
            cameras of your own as JSON or module:NAME.
        size: Height and width of one image in pixels, both even.
        depth: Show depth below the images, in the colours whose legend render has.
        segmentation: Show below which part of the scene each pixel shows, in colours.
        look: Look of the images: wood_table, dark, random:7, ... (see the page looks).
        import_tasks: Import tasks that are not of the benchmark, which runs the code of the modules
            that the data set names.
    """
    dataset = open_data(data, tasks, import_tasks=import_tasks)
    from duobench.data import Recording

    episodes: dict[str, list[Path]] = {}
    with advising(FOREIGN):
        for name in [catalog.id_of(task) for task in tasks] or dataset.tasks:
            paths = dataset.episodes_of([name])
            episodes[dataset.reference(Recording.read_info(paths[0]))] = paths
    if not episodes:
        raise DataError(f"{data} has no finished episode.")
    if mode == "actions":
        _by_actions(dataset, episodes)
    else:
        check_outside(out, dataset.path)
        with taken_back(out):
            _by_states(episodes, out, cameras, size, (depth, segmentation), look)


def _by_actions(data: DataSet, episodes: Mapping[str, Sequence[Path]]) -> None:
    from duobench.data import Recording
    from duobench.evaluation.replay import replay as play_again

    table = Table("task", "episodes", "bit-exact", "same stages", "largest difference")
    wrong = 0
    for task, paths in episodes.items():
        results = []
        for path, result in zip(
            paths, play_again(task, map(Recording.read, paths)), strict=True
        ):
            results.append(result)
            if not result.is_exact:
                say(
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
    say(table)
    if wrong:
        say(
            f"{counted(wrong, 'episode')} came out differently: by other versions of MuJoCo or "
            "DuoBench than those that recorded, by a task of one's own that has changed, or on a "
            "processor that is no x86-64 with AVX2.",
        )
        sys.exit(1)


def _by_states(
    episodes: Mapping[str, Sequence[Path]],
    out: Path,
    cameras: tuple[str | Camera, ...],
    size: tuple[int, int],
    kinds: tuple[bool, bool],
    look: str,
) -> None:
    from duobench.core.codecs import VP9
    from duobench.core.video import write_video
    from duobench.data import ImageSource, Recording
    from duobench.evaluation.video import FRAME_RATE

    if not cameras:
        raise DataError("A video shows at least one camera; --cameras names none.")
    if any(side % 2 for side in size):
        raise DataError(
            f"Height and width of a video are even; --size is {size[0]} {size[1]}."
        )
    remove_abandoned(out, VIDEO_SUFFIX)
    for task, paths in episodes.items():
        with closing(
            ImageSource(
                task,
                cameras=[
                    replace(camera, size=None) if isinstance(camera, Camera) else camera
                    for camera in cameras
                ],
                size=size,
                look=look,
                depth=kinds[0],
                segmentation=kinds[1],
            )
        ) as source:
            for path in paths:
                recording = Recording.read(path)
                target = out / path.parent.name / f"{path.stem}{VIDEO_SUFFIX}"
                with replacing(target) as temporary:
                    write_video(_frames(source, recording), temporary, VP9, FRAME_RATE)
                say(str(target))


def _frames(source: ImageSource, recording: Recording) -> Iterator[Image]:
    """The images of all cameras side by side, for a video; each kind has a row."""
    import numpy as np

    from duobench.core.false_colours import pictures
    from duobench.envs.observation_wrappers import KEYS
    from duobench.evaluation.video import FRAME_EVERY

    for row in range(0, len(recording) + 1, FRAME_EVERY):
        seen = source.images_by_kind(recording, row)
        rows = [pictures({KEYS[kind]: images}) for kind, images in seen.items()]
        yield np.vstack([np.hstack([image for _, image in row]) for row in rows])
