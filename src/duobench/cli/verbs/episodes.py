"""`duobench record` and `duobench replay`: episodes of a data set."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import tyro
from rich.table import Table
from tyro.conf import Positional

from duobench.backend import Image
from duobench.cli.shared.advice import FOR_RECORDING, advising
from duobench.cli.shared.console import counted, say
from duobench.cli.shared.options import command_line
from duobench.cli.shared.process import load_engine, raising
from duobench.cli.shared.progress import EpisodesKept, display
from duobench.cli.verbs.data import opened
from duobench.errors import DataError
from duobench.files import remove_abandoned, replacing
from duobench.results.folder import VIDEO_SUFFIX
from duobench.results.run import TimeLimits
from duobench.results.suite import find_tasks
from duobench.tasks import catalog

if TYPE_CHECKING:
    from duobench.data import DataSet, ImageSource, Recording
    from duobench.runners.demonstrations import Attempt


_LIMITS = TimeLimits()


def record(  # noqa: PLR0913, PLR0917 - each is an argument of the command line
    out: Path,
    policy: str = "expert",
    variety: Literal["none", "human", "wide"] = "human",
    tasks: tuple[str, ...] = (),
    episodes: int = 50,
    workers: int = 1,
    split: Literal["train", "eval"] = "train",
    instructions: Literal["fixed", "varied"] = "fixed",
    keep_failures: bool = False,
    after_success: float = 1.0,
    limits: tyro.conf.OmitArgPrefixes[TimeLimits] = _LIMITS,
) -> None:
    """Record demonstrations: states and actions; images are rendered from them later.

    Every task gets that many successful episodes; those that fail are counted and left out. The
    same command in the same folder goes on where it was stopped, also with more episodes.

    Args:
        out: Folder of the data set.
        policy: expert, hold, random, zero, or module:attribute for a policy of your own.
        variety: How much the scripted experts vary their speed, ways and grasps, and are disturbed;
            only they know how to.
        tasks: Task ids (see: duobench list) or module:ATTRIBUTE; all tasks if none is named.
        episodes: Episodes of each task.
        workers: Processes that play side by side; the data set does not depend on it.
        split: Layouts to begin with. Those of eval are the ones that policies are evaluated on:
            whatever learns from them cannot be evaluated any more.
        instructions: What the policy is told and the data set says: the task's own instruction, or
            in each episode one that is sampled from it and ten paraphrases.
        keep_failures: Keep every episode, whether it succeeds or not.
        after_success: Seconds that a recording goes on after success, while the hands open and
            retreat; 0 ends it there.
        limits: How long the policy may take.
    """
    command = command_line("record", record, locals())
    load_engine()
    from duobench.data import DataSet
    from duobench.runners import demonstrations

    name = f"expert:{variety}" if policy == "expert" and variety != "none" else policy
    with advising(FOR_RECORDING), raising(), display("episode") as shown:
        attempts = demonstrations.record(
            name,
            find_tasks(tasks),
            DataSet.open(out, how=f"duobench record --policy {name}"),
            episodes=episodes,
            split=split,
            instructions=instructions,
            keep_failures=keep_failures,
            after_success=after_success,
            limits=limits,
            workers=workers,
            observers=[EpisodesKept(shown)],
            command=command,
        )
    say(_kept_and_failed(attempts))


def _kept_and_failed(attempts: Sequence[Attempt]) -> str:
    kept = sum(attempt.kept for attempt in attempts)
    steps = sum(attempt.steps for attempt in attempts if attempt.kept)
    failed = [attempt for attempt in attempts if not attempt.success]
    lines = [
        f"{counted(kept, 'episode')}, {steps} steps until success, after which frames are still "
        f"recorded (--after-success); {len(failed)} more did not succeed."
    ]
    lines += [
        f"{attempt.task}, episode {attempt.episode} ended at stage {attempt.stage}"
        + (f": {attempt.error}" if attempt.error else ".")
        for attempt in failed
    ]
    return "\n".join(lines)


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

    table = Table("task", "episodes", "bit-exact", "same stages", "largest difference")
    wrong = 0
    for task in tasks or data.tasks:
        paths = data.episodes_of([catalog.get(task).id])
        results = []
        for path, result in zip(paths, play_again(task, map(Recording.read, paths)), strict=True):
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
    from duobench.video import VP9, write_video

    if not cameras:
        raise DataError("A video shows at least one camera; --cameras names none.")
    remove_abandoned(out, VIDEO_SUFFIX)
    for task in tasks or data.tasks:
        paths = data.episodes_of([catalog.get(task).id])
        with closing(ImageSource(task, cameras=cameras, size=size, look=look)) as source:
            for path in paths:
                recording = Recording.read(path)
                target = out / path.parent.name / f"{path.stem}{VIDEO_SUFFIX}"
                with replacing(target) as temporary:
                    write_video(_frames(source, recording), temporary, VP9, FRAME_RATE)
                say(str(target))


def _frames(source: ImageSource, recording: Recording) -> Iterator[Image]:
    """The images of all cameras side by side, for a video."""
    import numpy as np

    from duobench.evaluation.video import FRAME_EVERY

    for row in range(0, len(recording) + 1, FRAME_EVERY):
        yield np.concatenate(list(source.images(recording, row).values()), axis=1)
