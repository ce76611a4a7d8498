"""Problems of a data set: every file is read whole, and every claim in it is checked."""

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from duobench.core.errors import (
    DataError,
    DuoBenchError,
    FileError,
    ForeignTaskError,
)
from duobench.core.files import (
    CHECKSUM,
    checksum,
    digest_of,
    read_object,
)
from duobench.core.processes import Progress, run_all
from duobench.core.randomness import SUITE_VERSION
from duobench.core.versions import package_versions
from duobench.data.attempts import ATTEMPTS, RUN, compared
from duobench.data.dataset import SUFFIX, DataSet
from duobench.data.recording import Recording
from duobench.data.reviews import REVIEWS
from duobench.data.schema import (
    COLUMNS,
    VideoFacts,
    steps_after_success,
    video_path,
)
from duobench.data.stream import SUFFIX as PART_SUFFIX
from duobench.data.videos import describe
from duobench.envs.config import LAYOUT, SPLIT, EnvConfig
from duobench.envs.episode_state import EpisodeState
from duobench.envs.protocol import make_env
from duobench.envs.sim_env import sim_of
from duobench.world.robot.cameras import POLICY_CAMERAS

_GAPPY = ("frame_age", "left_robot_state", "right_robot_state")
"""Columns that are NaN where a device gave no value."""
_FOREIGN = (
    "It was not recorded here under this name: it was renamed, copied, merged, recovered, or "
    "recorded with other options."
)


@dataclass(frozen=True, kw_only=True, slots=True)
class Problem:
    """Problem of a file, in a sentence."""

    path: Path
    what: str
    is_foreign: bool = False
    """Whether the task comes from outside the benchmark and may not be imported."""


def find_problems(
    data: DataSet, *, workers: int = 0, progress: Progress = lambda _done, _total: None
) -> list[Problem]:
    """Check every file of a data set.

    Every episode that the attempts name as kept must exist once, under its name. Each episode must
    be readable and in the folder of its task. Its numbers must be finite, its stages must not fall,
    and its outcome must agree with them. It must begin with the layout of its seed and split and
    with the state of its first hash, bit for bit. Every video must belong to an episode, every
    episode must have its videos, and these must be unchanged and hold the frames that its rows
    name. What was said at a second look must be about episodes that are there. Only an action
    replay shows that the last state follows from the commands.

    Args:
        data: The data set.
        workers: Processes that check side by side; 0 checks in this process. See `run_all`.
        progress: Called with the numbers of checked episodes and of all.

    Returns:
        Problems, sorted by file.
    """
    problems = [
        Problem(path=path, what="Its recording was interrupted: recover or delete it.")
        for path in data.partials()
    ]
    problems += [
        Problem(path=video, what="It is a video without an episode.")
        for video in data.videos()
        if not _has_episode(video)
    ]
    problems += [*_compared(data), *_copies(data), *_reviewed(data)]
    paths = data.episodes()
    progress(0, len(paths))
    with closing(run_all(partial(_checker, data), paths, workers)) as results:
        for done, faults in enumerate(results, start=1):
            problems += faults
            progress(done, len(paths))
    return sorted(problems, key=lambda problem: (str(problem.path), problem.what))


def _compared(data: DataSet) -> Iterator[Problem]:
    """Find differences from the attempts, which would keep a recording from continuing."""
    run = data.path / RUN
    try:
        about = read_object(run, FileError)
        differences = compared(data).values()
    except FileError as error:
        yield Problem(path=data.path, what=str(error))
        return
    if about is None and (data.path / ATTEMPTS).exists():
        yield Problem(
            path=run, what="It is missing, without which no recording goes on."
        )
    if about is not None and about.get(CHECKSUM) != checksum(about):
        yield Problem(path=run, what="It was changed after it was written.")
    for each in differences:
        for path in each.missing:
            yield Problem(
                path=path, what="It was kept, as attempts say, and is missing."
            )
        for path in each.foreign:
            yield Problem(path=path, what=_FOREIGN)


def _copies(data: DataSet) -> Iterator[Problem]:
    """Files with the content of another one."""
    sizes = Counter(path.stat().st_size for path in data.episodes())
    first: dict[str, Path] = {}
    for path in data.episodes():
        if sizes[path.stat().st_size] > 1:
            other = first.setdefault(digest_of(path), path)
            if other is not path:
                yield Problem(
                    path=path, what=f"It is a copy of {other.relative_to(data.path)}."
                )


def _reviewed(data: DataSet) -> Iterator[Problem]:
    """Find lines of the second look that cannot be read, or that hold for no recording here."""
    try:
        reviews = data.reviews
    except FileError as error:
        yield Problem(
            path=data.path / REVIEWS,
            what=str(error),
        )
        return
    for number, why in reviews.unreadable.items():
        yield Problem(
            path=reviews.path,
            what=f"Line {number} cannot be read and counts for nothing, as half a line after a "
            f"kill: {why}.",
        )
    for name in sorted({review.episode for review in reviews.reviews}):
        task, _, stem = name.partition("/")
        path = data.episode(task, stem)
        if not path.exists():
            yield Problem(
                path=reviews.path,
                what=f"It speaks of {name}, which is missing.",
            )
            continue
        with suppress(DataError):  # which is found elsewhere
            if not reviews.about(path):
                yield Problem(
                    path=reviews.path,
                    what=f"What it says about {name} was said about another recording of that "
                    "name, and counts for nothing.",
                )
            rows = reviews.of(path).rows
            length = Recording.read_length(path)
            if rows is not None and rows[1] > length:
                yield Problem(
                    path=reviews.path,
                    what=f"It names row {rows[1]} of {name}, whose last one is {length}.",
                )


def _checker(data: DataSet) -> Callable[[Path], list[Problem]]:
    """Return a function that checks an episode, and keeps its environment for the next one."""
    environment = lru_cache(maxsize=1)(partial(make_env, cameras=False))

    def check(path: Path) -> list[Problem]:
        try:
            recording = Recording.read(path)
            faults = [*_disagreements(recording, path), *_wrong_videos(recording, path)]
            if not recording.info.is_real:
                faults += _beginning(
                    recording, data.reference(recording.info), environment
                )
        except ForeignTaskError as error:
            return [Problem(path=path, what=str(error), is_foreign=True)]
        except DuoBenchError as error:
            faults = [str(error)]
        return [Problem(path=path, what=what) for what in faults]

    return check


def _beginning(
    recording: Recording, task: str, environment: Callable[..., gym.Env]
) -> list[str]:
    info = recording.info
    config = info.config or EnvConfig()
    env = environment(
        task,
        action_mode=info.mode.name,
        shift=config.shift,
        gripper=config.gripper,
        mount=config.mount,
    )
    options = {LAYOUT: info.layout} if info.seed is None else {SPLIT: info.split}
    _, seen = env.reset(seed=info.seed, options=options)
    if seen["layout"] != info.layout:
        return [
            f"Its layout is not the one that seed {info.seed} of {info.split!r} samples."
        ]
    if info.versions != package_versions():
        return []  # another engine comes to rest elsewhere
    if not np.array_equal(sim_of(env).simulation.get_state(), recording.state[0]):
        return ["Its first state is not the one that its layout begins with."]
    state: EpisodeState = env.get_wrapper_attr("save_state")()
    # Without a time limit, steps are not counted.
    hashes = (state.hash, replace(state, steps=None).hash)
    if info.config is not None and info.first_hash not in hashes:
        return ["The hash of its first state is another one."]
    return []


def _disagreements(recording: Recording, path: Path) -> list[str]:
    """Contradictions within an episode, or with the place of its file."""
    info = recording.info
    outcome = info.outcome
    stage = recording.stage
    length = len(recording)
    steps = recording.steps
    horizon = None if info.config is None else info.config.horizon
    most_after_success = steps_after_success(info.after_success)
    # Real arms that were held during a step are not measured again.
    least_s = 0.0 if info.is_real else 1e-9

    def falls(values: NDArray[Any]) -> bool:
        return bool((np.diff(values.astype(np.int64)) < 0).any())

    infinite = [
        column.name
        for column in COLUMNS
        if column.name not in _GAPPY
        and not np.isfinite(getattr(recording, column.name)).all()
    ]
    faults = {
        f"It belongs to task {info.task!r}, not into this folder.": (
            path.parent.name != info.task
        ),
        f"It belongs to suite {info.suite_version}.": (
            info.suite_version != SUITE_VERSION
        ),
        f"Not all numbers are finite: {', '.join(infinite)}.": bool(infinite),
        "Its clock goes back.": bool((np.diff(recording.time) < least_s).any()),
        # An operator may take back a stage or a success.
        "Its stage falls.": not info.is_real and falls(stage),
        "Its success ends.": not info.is_real and falls(recording.success),
        "It has no actions.": not length,
        f"It has {steps} actions, more than its horizon.": bool(
            horizon and steps > horizon
        ),
        f"It goes on for {length - steps} control steps after success, not for at most "
        f"{most_after_success}.": length - steps > most_after_success,
        "It does not say how it ended.": outcome is None,
    }
    if outcome is not None:
        faults |= {
            "Its last stage is not the one it says.": int(stage[-1]) != outcome.stage,
            "It is no success as it says, or the reverse.": (
                bool(recording.success[-1]) != outcome.success
            ),
            "The step of its success is not the one it says.": (
                outcome.success_step != recording.success_step
            ),
            "The hash of its last state is missing.": (
                not (outcome.cut or info.is_real) and info.last_hash is None
            ),
        }
    return [sentence for sentence, is_so in faults.items() if is_so]


def _has_episode(video: Path) -> bool:
    """Whether the episode of a video is beside it, finished or not."""
    episode, _, camera = video.stem.rpartition(".")
    return camera in POLICY_CAMERAS and any(
        video.with_name(f"{episode}{suffix}").exists()
        for suffix in (SUFFIX, PART_SUFFIX)
    )


def _wrong_videos(recording: Recording, path: Path) -> Iterator[str]:
    info = recording.info
    for place, (camera, facts) in enumerate(info.videos.items()):
        video = video_path(path, camera)
        if facts.frames is None:
            yield f"It does not say how many frames {video.name} has."
            continue
        yield from _wrong_file(video, facts)
        frames = recording.frame[:, place]
        if frames.max() >= facts.frames:
            yield f"Its rows name frame {frames.max()} of {video.name}, which has {facts.frames}."
        if (np.diff(frames) < 0).any() or frames.min() < -1:
            yield f"Its rows go back in {video.name}."


def _wrong_file(video: Path, facts: VideoFacts) -> Iterator[str]:
    if not video.exists():
        if facts.frames:
            yield f"Its video {video.name} is missing."
        return
    try:
        found = describe(video)
    except (DataError, OSError) as error:
        yield str(error)
        return
    if found.frames != facts.frames:
        yield f"{video.name} has {found.frames} frames, not {facts.frames}."
    elif facts.sha256 not in {None, found.sha256}:
        yield f"{video.name} has changed since it was recorded: its checksum is another one."
