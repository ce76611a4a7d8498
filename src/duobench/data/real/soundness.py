"""What is wrong with the videos of a data set."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from duobench.data.dataset import SUFFIX, DataSet
from duobench.data.problem import Problem
from duobench.data.real.videos import describe, episode_of, video_path
from duobench.data.recording import Recording
from duobench.data.schema import VideoFacts
from duobench.data.stream import SUFFIX as PART_SUFFIX
from duobench.errors import DataError


def orphans(data: DataSet) -> Iterator[Problem]:
    """Videos beside which there is no episode, finished or not."""
    for video in data.videos():
        belongs = episode_of(video)
        names = [f"{belongs[0]}{suffix}" for suffix in (SUFFIX, PART_SUFFIX)] if belongs else []
        if not any(video.with_name(name).exists() for name in names):
            yield Problem(path=video, what="It is a video without an episode.")


def disagreements(recording: Recording, path: Path) -> Iterator[str]:
    """What an episode says about its videos that is not so.

    Args:
        recording: The episode.
        path: Its file.
    """
    info = recording.info
    for place, (camera, facts) in enumerate(info.videos.items()):
        video = video_path(path, camera)
        if facts.frames is None:
            yield f"It does not say how many frames {video.name} has."
            continue
        yield from _of_file(video, facts)
        frames = recording.frame[:, place]
        if frames.max() >= facts.frames:
            yield f"Its rows name frame {frames.max()} of {video.name}, which has {facts.frames}."
        if (np.diff(frames) < 0).any() or frames.min() < -1:
            yield f"Its rows go back in {video.name}."


def _of_file(video: Path, facts: VideoFacts) -> Iterator[str]:
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
