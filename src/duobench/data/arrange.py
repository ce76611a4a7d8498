"""Data sets out of data sets: several merged into one, one split into two.

Files are copied as they are, with the videos beside them, and with what was said about them at a
second look. What cannot be done is found out before
the first copy, and what was interrupted goes on when it is called again.
"""

import hashlib
from collections.abc import Collection, Mapping, Sequence
from contextlib import ExitStack
from filecmp import cmp
from itertools import chain, count
from pathlib import Path
from shutil import copyfile

from duobench.core.errors import DataError, NamesTakenError
from duobench.core.files import (
    check_outside,
    locked,
    replacing,
    write,
)
from duobench.data.dataset import SUFFIX, DataSet
from duobench.data.recording import Recording
from duobench.data.schema import video_path
from duobench.data.stream import SUFFIX as PART_SUFFIX


def merge(
    sources: Sequence[DataSet],
    out: Path,
    *,
    rename: bool = False,
) -> int:
    """Copy the episodes of several data sets into one.

    Args:
        sources: The data sets.
        out: Folder that is new, empty, or a data set that is added to.
        rename: Whether an episode whose name is taken by another one gets the next free number.

    Returns:
        How many episodes the sources have together, the same one counted once.

    Raises:
        NamesTakenError: Two different episodes have the same name.
        DataError: There is no data set, or a file cannot be read.
        OtherRunError: The folder holds something else.
        OutputError: A file cannot be written, or another process is writing into the folder.
    """
    if not sources:
        raise DataError("There is nothing to merge; name at least one data set.")
    check_outside(
        out, *(each.path for each in sources if each.path.resolve() != out.resolve())
    )
    target = DataSet.open(out, how=f"merged from {len(sources)} data sets")
    with locked(target.path):
        plan: dict[Path, Path] = {}
        copies: list[tuple[Path, Path]] = []
        clashes = []
        for path in chain.from_iterable(source.episodes() for source in sources):
            _check_whole(path)
            place = target.episode(path.parent.name, path.stem)
            if rename:
                place = _free(place, path, plan)
            if not _may_be(path, place, plan):
                clashes.append(f"{place.parent.name}/{place.stem}")
            plan.setdefault(place, path)
            copies.append((path, place))
        if clashes:
            names = "name stands" if len(clashes) == 1 else "names stand"
            raise NamesTakenError(
                f"{len(clashes)} {names} for different episodes, such as {clashes[0]}."
            )
        _copy(plan)
        target.reviews.take_over(copies)
    return len(plan)


def split(
    data: DataSet,
    first: Path,
    second: Path,
    *,
    fraction: float | None = None,
    tasks: Collection[str] = (),
    seed: int = 0,
) -> tuple[int, int]:
    """Copy the episodes of a data set into two, each into one of them.

    Args:
        data: The data set.
        first: Folder of the first one; new, empty, or with nothing but episodes of this part.
        second: Folder of the second one, likewise.
        fraction: Share of each task's episodes that go into the first, rounded; which ones follows
            from the seed alone.
        tasks: Tasks that go into the first as a whole, if no fraction is given.
        seed: Seed of the choice.

    Returns:
        How many episodes each of them has.

    Raises:
        DataError: Neither or both of fraction and tasks are given, the fraction is no share, a
            file cannot be read, or a folder holds something else, such as the other part.
        UnknownNameError: The data set has no episode of a task.
        OutputError: A file cannot be written, or another process is writing into a folder.
    """
    if (fraction is None) == (not tasks):
        raise DataError(
            "A data set is split by a fraction or by tasks; exactly one is needed."
        )
    if fraction is not None and not 0.0 < fraction < 1.0:
        raise DataError(f"The fraction is between 0 and 1, got {fraction}.")
    if first.resolve() == second.resolve():
        raise DataError(f"The two parts need a folder each, got {first} for both.")
    for folder in (first, second):
        check_outside(folder, data.path)
    chosen = (
        set(data.episodes_of(tasks))
        if fraction is None
        else _share(data, fraction, seed)
    )
    how = f"split by {'tasks' if fraction is None else f'fraction {fraction}, seed {seed}'}"
    plans: list[dict[Path, Path]] = []
    targets: list[DataSet] = []
    with ExitStack() as stack:
        for folder, is_first in ((first, True), (second, False)):
            target = DataSet.open(folder, how=how)
            stack.enter_context(locked(target.path))
            paths = [path for path in data.episodes() if (path in chosen) is is_first]
            plans.append(_part(paths, target))
            targets.append(target)
        for target, plan in zip(targets, plans, strict=True):
            _copy(plan)
            target.reviews.take_over((path, place) for place, path in plan.items())
    return len(plans[0]), len(plans[1])


def _share(
    data: DataSet,
    fraction: float,
    seed: int,
) -> set[Path]:
    def shuffled(path: Path) -> str:
        return hashlib.sha256(
            f"{seed}\x1f{path.parent.name}\x1f{path.stem}".encode()
        ).hexdigest()

    chosen: set[Path] = set()
    for task in data.tasks:
        episodes = sorted(data.episodes(task), key=shuffled)
        chosen |= set(episodes[: round(fraction * len(episodes))])
    return chosen


def _part(paths: Sequence[Path], target: DataSet) -> dict[Path, Path]:
    """Episodes by their place in a part, which holds no other ones."""
    plan = {target.episode(path.parent.name, path.stem): path for path in paths}
    for path in paths:
        _check_whole(path)
    for place in target.episodes():
        if place not in plan or not _may_be(plan[place], place, {}):
            raise DataError(
                f"{place} is no episode of this part; split into folders of their own, or delete "
                "what an earlier split has left."
            )
    return plan


def _check_whole(path: Path) -> None:
    """Reject now an episode that cannot be read to its end, or lacks a video."""
    Recording.read(path)
    for video, _ in _videos(path, path):
        if not video.exists():
            raise DataError(f"{video} is missing, which belongs to {path.name}.")


def _videos(path: Path, place: Path) -> list[tuple[Path, Path]]:
    """Videos that a finished episode says it has, with their places when it is copied to one."""
    videos = Recording.read_info(path).videos
    cameras = [camera for camera, facts in videos.items() if facts.frames]
    return [(video_path(path, camera), video_path(place, camera)) for camera in cameras]


def _may_be(
    path: Path,
    place: Path,
    plan: Mapping[Path, Path],
) -> bool:
    """Whether an episode may be copied to a place: nothing is there, or the same."""
    others = {plan.get(place, path), place if place.exists() else path}
    if not all(cmp(path, other, shallow=False) for other in others - {path}):
        return False
    if place.with_suffix(PART_SUFFIX).exists():
        return False  # it is being recorded, or was
    return all(
        not there.exists() or cmp(video, there, shallow=False)
        for video, there in _videos(path, place)
    )


def _free(
    place: Path,
    path: Path,
    plan: Mapping[Path, Path],
) -> Path:
    """The place itself, or the next number whose place is free for an episode."""
    numbers = (place.with_name(f"{number:05d}{SUFFIX}") for number in count())
    return next(each for each in chain([place], numbers) if _may_be(path, each, plan))


def _copy(plan: Mapping[Path, Path]) -> None:
    """Copy files to their places; those that are there are the same."""
    for place, path in plan.items():
        for video, there in _videos(
            path, place
        ):  # first: an episode has all of its videos
            if not there.exists():
                with replacing(there) as temporary:
                    copyfile(video, temporary)
        if not place.exists():
            write(place, path.read_bytes())
