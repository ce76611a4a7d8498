"""The page of the gallery, and the image of all tasks."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib import import_module
from inspect import cleandoc
from itertools import groupby
from pathlib import Path

import PIL.Image
from gallery_shots import FOLDER, LOOK, STAGE_SIZE, camera_file, stage_file
from PIL import ImageDraw, ImageFont

from duobench.core.errors import DuoBenchError
from duobench.core.types import CONTROL_HZ
from duobench.tasks import catalog
from duobench.tasks.task import Task
from duobench.world.looks.catalog import DEFAULT
from duobench.world.robot.cameras import OVERVIEW, POLICY_CAMERAS

PAGE = "gallery.md"
COVER_WIDTH = 840
COLUMNS = 3
"""Images in a row of the page."""


def cover(images: Mapping[str, PIL.Image.Image]) -> PIL.Image.Image:
    """Put one image of each task together, in rows of equal width, the larger ones first."""
    font = ImageFont.load_default(size=14)
    boxes = cells()
    sheet = PIL.Image.new(
        "RGB", (COVER_WIDTH, max(bottom for *_, bottom in boxes.values()))
    )
    for name, (left, top, right, bottom) in boxes.items():
        sheet.paste(images[name].resize((right - left, bottom - top)), (left, top))
        ImageDraw.Draw(sheet).text(
            (left + 8, top + 5),
            catalog.get(name).title,
            font=font,
            fill="white",
            stroke_width=2,
            stroke_fill="black",
        )
    return sheet


def cells() -> dict[str, tuple[int, int, int, int]]:
    """Return where each task is on the image of all: left, top, right, bottom in pixels."""
    found = {}
    top = 0
    for members in rows([catalog.get(name) for name in catalog.names()]):
        width = COVER_WIDTH // len(members)
        height = width * STAGE_SIZE[0] // STAGE_SIZE[1]
        for column, task in enumerate(members):
            found[task.id] = (column * width, top, (column + 1) * width, top + height)
        top += height
    return found


def rows(tasks: Sequence[Task]) -> Iterator[Sequence[Task]]:
    """Split tasks, in order, into rows of nearly equal length, the shorter ones first."""
    count = max(1, round(len(tasks) ** 0.5))
    shorter, longer = divmod(len(tasks), count)
    begin = 0
    for row in range(count):
        end = begin + shorter + (row >= count - longer)
        yield tasks[begin:end]
        begin = end


def page(folder: Path) -> str:
    """Return the page in Markdown: every task by category, with its images in a folder."""
    tasks = [catalog.get(name) for name in catalog.names()]
    lines = [
        "# The tasks in images",
        "",
        "Written and rendered by `make docs`. First how an episode begins, from the overview "
        "camera and as a policy sees it, from the head and the two wrists; then the scripted "
        "expert at every stage, a moment after it is reached. Policies' images are in the look "
        f"`{DEFAULT}`, the others in [`{LOOK}`](looks.md#the-studio). "
        "`replays/TASK.html` shows a whole episode of it in 3D, in a browser and without a "
        "network.",
    ]
    for category, members in groupby(tasks, key=lambda task: task.category):
        lines += ["", f"## {category.capitalize()}"]
        for task in members:
            lines += ["", *section(task, folder)]
    return "\n".join(lines) + "\n"


def section(task: Task, folder: Path) -> Iterator[str]:
    """Give the lines of one task."""
    yield f"### {task.title}"
    yield ""
    yield section_of(task.id, "Task")
    yield ""
    facts = [
        f"`{task.id}`",
        str(task.category),
        f"{task.max_stage} stages",
        f"{task.horizon} control steps ({task.horizon / CONTROL_HZ:.0f} s)",
        *(["printable objects"] if task.printable else []),
        *(["rebuilt on the real robot in the paper"] if task.real else []),
        f"[in 3D](replays/{task.id}.html)",
    ]
    yield " · ".join(facts)
    yield ""
    yield f"![{task.title} at the start]({link(task, camera_file(OVERVIEW))})"
    yield ""
    cameras = [
        (camera.replace("_", " ") + " camera", link(task, camera_file(camera)))
        for camera in POLICY_CAMERAS
    ]
    stages = list(pictured(task, folder))
    yield row(caption for caption, _ in cameras)
    yield row(["---"] * COLUMNS)
    yield row(f"![{caption}]({file})" for caption, file in cameras)
    for first in range(0, len(stages), COLUMNS):
        some = stages[first : first + COLUMNS]
        yield row(f"**{caption}**" for caption, _ in some)
        yield row(f"![{caption}]({file})" for caption, file in some)


def pictured(task: Task, folder: Path) -> Iterator[tuple[str, str]]:
    """Give caption and link of each image of the expert, which may show several stages.

    Raises:
        DuoBenchError: The last stage has no image.
    """
    waiting = []
    for number, stage in enumerate(task.stages, start=1):
        waiting.append(f"{number}. {stage.name}")
        if (folder / task.id / stage_file(number)).exists():
            yield ", ".join(waiting), link(task, stage_file(number))
            waiting.clear()
    if waiting:
        raise DuoBenchError(
            f"Folder {folder} has no image of the last stage of {task.id!r}; draw the task first."
        )


def row(cells: Iterable[str]) -> str:
    """Return a row of a table of `COLUMNS` columns."""
    texts = list(cells)
    return "| " + " | ".join(texts + [""] * (COLUMNS - len(texts))) + " |"


def link(task: Task, file: str) -> str:
    """Return where the page finds an image of a task."""
    return f"{FOLDER}/{task.id}/{file}"


def section_of(name: str, heading: str) -> str:
    """Return what the documentation of a task's module says under a heading, on one line."""
    text = cleandoc(import_module(f"duobench.tasks.{name}").__doc__ or "")
    found = re.search(rf"^{heading}:\n((?:    .*\n?|\n)+)", text, flags=re.MULTILINE)
    if found is None:
        raise DuoBenchError(
            f"The docstring of duobench.tasks.{name} has no section {heading!r}."
        )
    return " ".join(found[1].split())
