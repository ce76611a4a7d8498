"""The card of a data set, recordings or an export: what the Hub shows, and searches."""

import json
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from duobench.data.dataset import DESCRIPTION, DataSet
from duobench.data.images import VideoFrames
from duobench.data.page import COLUMNS, as_jpeg, contact_sheet
from duobench.data.summary import summarize
from duobench.errors import DataError
from duobench.files import make_folder, write
from duobench.lerobot_keys import IMAGE_PREFIX, SUITE
from duobench.pages import CARD, render
from duobench.types import CONTROL_HZ

_Part = tuple[str, int, int, bytes | None]
"""A task, its episodes, their rows, and a picture, a JPEG, where there is something to show."""


def write_data_card(folder: Path, name: str, licence: str) -> Path:
    """Write the card and its pictures into the folder of a data set; the card's path.

    Raises:
        DataError: It holds neither recordings nor an export in LeRobot's format, or one for each
            task; or they cannot be read.
    """
    exports = sorted(path.parents[1] for path in folder.glob("**/meta/info.json"))
    summary, actors, about = None, dict[str, None](), dict[str, Any]()
    if (folder / DESCRIPTION).exists():
        data = DataSet.open(folder, create=False)
        summary, suite = summarize(data), data.read_description().suite_version
        actors = dict.fromkeys(actor for task in summary.tasks for actor in task.actors)
        parts = [
            (one.task, one.episodes, one.frames, contact_sheet(data.episodes(one.task)[0]))
            for one in summary.tasks
        ]
    elif exports:
        about, suite = _read(exports[0], "info.json"), _read(exports[0], "duobench.json")[SUITE]
        parts = [part for one in exports for part in _exported(one)]
    else:
        raise DataError(
            f"{folder} is no data set: neither recordings, with {DESCRIPTION}, nor an export in "
            "LeRobot's format, with meta/info.json."
        )
    make_folder(folder / "pictures")
    for task, *_, picture in parts:
        if picture:
            write(folder / "pictures" / f"{task}.jpg", picture)
    files = [path for path in folder.rglob("*") if path.is_file() and path.name != CARD]
    text = render(
        "duobench.data",
        "card.md.j2",
        id=name,
        name=name.rpartition("/")[2],
        licence=licence,
        suite=suite,
        summary=summary,
        actors=actors,
        about=about,
        several=len(exports) > 1,
        parts=parts,
        rate=CONTROL_HZ,
        megabytes=sum(path.stat().st_size for path in files) / 1e6,
    )
    write(folder / CARD, text)
    return folder / CARD


def _read(folder: Path, name: str) -> dict[str, Any]:
    try:
        return json.loads((folder / "meta" / name).read_bytes())
    except (OSError, ValueError) as error:
        raise DataError(f"{folder} is no export of DuoBench: {error}.") from error


def _exported(folder: Path) -> Iterator[_Part]:
    """The tasks of an export of DuoBench, which notes the recording of each episode."""
    lengths: dict[str, dict[int, int]] = {}
    for place, one in enumerate(_read(folder, "duobench.json")["episodes"]):
        lengths.setdefault(Path(one["file"]).parent.name, {})[place] = one["length"]
    for task, of in lengths.items():
        yield task, len(of), sum(of.values()), _frames(folder, *next(iter(of.items())))


def _frames(folder: Path, episode: int, length: int) -> bytes | None:
    """Images of an episode of an export, from its first camera; None where it has no video."""
    for path in sorted(folder.glob(f"videos/{IMAGE_PREFIX}*/*/file-{episode:03d}.mp4"))[:1]:
        with closing(VideoFrames(path)) as video:
            places = np.linspace(0, length - 1, COLUMNS).round().astype(int).tolist()
            return as_jpeg([video.read(place) for place in places])
    return None
