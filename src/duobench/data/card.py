"""Card of a data set, recordings or an export: its page and search terms on the Hub."""

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from duobench.core.errors import DataError, escaped
from duobench.core.files import make_folder, read_object, write
from duobench.core.lerobot_keys import (
    CARD,
    DEPTH_SUFFIX,
    FORMAT,
    IMAGE_PREFIX,
    OBJECT_STATE,
    ROBOT,
    STATE,
    SUITE,
    check_card,
    feature_names,
)
from duobench.core.pages import render
from duobench.core.types import CONTROL_HZ
from duobench.data.dataset import DESCRIPTION, DataSet
from duobench.data.summary import summarize
from duobench.envs import state_labels
from duobench.envs.spaces import JOINT_NAMES
from duobench.tasks import catalog
from duobench.world.robot.cameras import POLICY_CAMERAS

PICTURES = "pictures"
"""Folder of what a card shows: made of recordings; an export shows the JPEGs that are there."""


def write_data_card(
    folder: Path, name: str, licence: str, *, import_tasks: bool = False
) -> Path:
    """Write the card and its pictures into the folder of a data set; the card's path.

    Tasks that are not of the benchmark are imported if asked for, as by `DataSet`.

    Raises:
        OptionError: The Hub takes no such name or licence.
        DataError: It holds neither recordings nor an export in LeRobot's format, or one for each
            task; or they cannot be read.
    """
    check_card(name, licence)
    if (folder / DESCRIPTION).exists():
        told = _of_recordings(folder, import_tasks)
    else:
        try:
            told = _of_exports(folder)
        except (AttributeError, KeyError, TypeError) as error:
            raise DataError(
                f"{folder} is no whole export of DuoBench: its meta/info.json or "
                f"meta/duobench.json lacks what an export says ({escaped(repr(error))})."
            ) from error
    own = [task for task in told["parts"] if task not in catalog.names()]
    files = [path for path in folder.rglob("*") if path.is_file() and path.name != CARD]
    text = render(
        "duobench.data",
        "card.md.j2",
        **told,
        id=name,
        licence=licence,
        own=own,
        asked=" --import-tasks" if own else "",
        pictures=sorted(path.name for path in (folder / PICTURES).glob("*.jpg")),
        megabytes=sum(path.stat().st_size for path in files) / 1e6,
    )
    write(folder / CARD, text)
    return folder / CARD


def _of_recordings(folder: Path, import_tasks: bool) -> dict[str, Any]:
    """Card of recordings, whose pictures are made."""
    from duobench.data.page import contact_sheet  # loads the engine

    data = DataSet.open(folder, create=False, import_tasks=import_tasks)
    summary = summarize(data)
    make_folder(folder / PICTURES)
    for task in data.tasks:
        sheet = contact_sheet(data, data.episodes(task)[0])
        if sheet:
            write(folder / PICTURES / f"{task}.jpg", sheet)
    return {
        "summary": summary,
        "rate": CONTROL_HZ,
        "depths": [],
        "suite": data.read_description().suite_version,
        "parts": {one.task: (one.episodes, one.frames) for one in summary.tasks},
        # The state of each task has a length of its own, and a table has one.
        "configs": [
            _config(one.task, f"episodes/{one.task}/*.parquet") for one in summary.tasks
        ],
    }


def _of_exports(folder: Path) -> dict[str, Any]:
    """Card of an export, or of a folder with several."""
    found = sorted(path.parents[1] for path in folder.glob("**/meta/info.json"))
    places = [path.relative_to(folder) for path in found]
    places = [
        place for place in places if not place.as_posix().startswith((".cache", ".git"))
    ]
    if not places:
        raise DataError(
            f"{folder} is no data set: neither recordings, with {DESCRIPTION}, nor an export in "
            "LeRobot's format, with meta/info.json."
        )
    about = [_read(folder / place, "info.json") for place in places]
    beside = [_read(folder / place, "duobench.json") for place in places]
    suites = list(dict.fromkeys(one[SUITE] for one in beside))
    if len(suites) > 1:
        raise DataError(
            f"{folder} has exports of suites {' and '.join(suites)}: card each alone."
        )
    lengths: dict[str, list[int]] = {}
    for one in (episode for each in beside for episode in each["episodes"]):
        lengths.setdefault(Path(one["file"]).parent.name, []).append(one["length"])
    features = list(dict.fromkeys(key for one in about for key in one["features"]))
    return {
        "summary": None,
        "rate": about[0]["fps"],
        "suite": suites[0],
        "parts": {task: (len(of), sum(of)) for task, of in lengths.items()},
        "configs": [
            _config(
                ".".join(place.parts) or "default",
                (place / "data/*/*.parquet").as_posix(),
            )
            for place in places
        ],
        "features": features,
        "robots": " and ".join(
            dict.fromkeys(one[ROBOT] for one in beside if one.get(ROBOT))
        ),
        "depths": [key for key in features if key.endswith(DEPTH_SUFFIX)],
        "version": " and ".join(
            dict.fromkeys(one["codebase_version"] for one in about)
        ),
        "training": _training(places[0], about[0], list(lengths)),
    }


def _config(name: str, files: str) -> dict[str, str]:
    """Files that the Hub shows, and loads, as one table."""
    return {"config_name": name, "data_files": files}


def _training(
    place: Path,
    about: Mapping[str, Any],
    tasks: Sequence[str],
) -> str:
    """The command that learns a task from an export; empty where `duobench train` cannot."""
    known = {OBJECT_STATE, *(f"{IMAGE_PREFIX}{camera}" for camera in POLICY_CAMERAS)}
    parts = state_labels.find(feature_names(about, STATE) or JOINT_NAMES) or ()
    if (
        about["codebase_version"] != FORMAT
        or about["fps"] != CONTROL_HZ
        or known.isdisjoint(about["features"])
        or not {*parts} <= {*state_labels.SHOWN}
    ):
        return ""
    words = ["--tasks", tasks[0]] if len(tasks) > 1 and place == Path() else []
    data = (Path("data") / place).as_posix()
    return shlex.join(
        ["duobench", "train", "act", "--data", data, *words, "--out", "runs/act"]
    )


def _read(folder: Path, name: str) -> dict[str, Any]:
    content = read_object(folder / "meta" / name, DataError)
    if content is None:
        raise DataError(
            f"{folder} is no export of DuoBench: it has no meta/{name}, which other tools leave "
            "out; exports of DuoBench beside each other in a folder have one card."
        )
    return content
