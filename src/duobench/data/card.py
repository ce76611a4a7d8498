"""The card of a data set, recordings or an export: what the Hub shows, and searches."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from duobench.data.dataset import DESCRIPTION, DataSet
from duobench.data.summary import summarize
from duobench.errors import DataError, escaped
from duobench.files import make_folder, read_object, write
from duobench.lerobot_keys import CARD, SUITE
from duobench.pages import render
from duobench.tasks import catalog
from duobench.types import CONTROL_HZ

PICTURES = "pictures"
"""Folder of what a card shows: made of recordings; an export shows the JPEGs that are there."""


def write_data_card(folder: Path, name: str, licence: str, *, import_tasks: bool = False) -> Path:
    """Write the card and its pictures into the folder of a data set; the card's path.

    Tasks that are not of the benchmark are imported if asked for, as by `DataSet`.

    Raises:
        DataError: It holds neither recordings nor an export in LeRobot's format, or one for each
            task; or they cannot be read.
    """
    exports = sorted(path.parents[1] for path in folder.glob("**/meta/info.json"))
    summary, about = None, dict[str, Any]()
    if (folder / DESCRIPTION).exists():
        data = DataSet.open(folder, create=False, import_tasks=import_tasks)
        summary, suite = summarize(data), data.read_description().suite_version
        parts = [(one.task, one.episodes, one.frames) for one in summary.tasks]
        make_folder(folder / PICTURES)
        from duobench.data.page import contact_sheet  # loads the engine

        for task in data.tasks:
            if sheet := contact_sheet(data, data.episodes(task)[0]):
                write(folder / PICTURES / f"{task}.jpg", sheet)
    elif exports:
        try:
            about, suite = _read(exports[0], "info.json"), _read(exports[0], "duobench.json")[SUITE]
            parts = [part for one in exports for part in _exported(one)]
        except (AttributeError, KeyError, TypeError) as error:
            raise DataError(
                f"{folder} is no whole export of DuoBench: what its meta/duobench.json says of its "
                f"episodes cannot be read ({escaped(repr(error))})."
            ) from error
    else:
        raise DataError(
            f"{folder} is no data set: neither recordings, with {DESCRIPTION}, nor an export in "
            "LeRobot's format, with meta/info.json."
        )
    own = [task for task, *_ in parts if task not in catalog.names()]
    files = [path for path in folder.rglob("*") if path.is_file() and path.name != CARD]
    text = render(
        "duobench.data",
        "card.md.j2",
        id=name,
        licence=licence,
        suite=suite,
        summary=summary,
        about=about,
        parts=parts,
        own=own,
        asked=" --import-tasks" if own else "",
        pictures=sorted(path.name for path in (folder / PICTURES).glob("*.jpg")),
        rate=CONTROL_HZ,
        megabytes=sum(path.stat().st_size for path in files) / 1e6,
    )
    write(folder / CARD, text)
    return folder / CARD


def _read(folder: Path, name: str) -> dict[str, Any]:
    content = read_object(folder / "meta" / name, DataError)
    if content is None:
        raise DataError(f"{folder} is no export of DuoBench: it has no meta/{name}.")
    return content


def _exported(folder: Path) -> Iterator[tuple[str, int, int]]:
    """Task, episodes and rows: an export notes the recording of each episode."""
    lengths: dict[str, list[int]] = {}
    for one in _read(folder, "duobench.json")["episodes"]:
        lengths.setdefault(Path(one["file"]).parent.name, []).append(one["length"])
    for task, of in lengths.items():
        yield task, len(of), sum(of)
