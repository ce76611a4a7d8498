"""The page of a data set: its summary, with images, in one file that works offline."""

import base64
from contextlib import closing
from pathlib import Path

import numpy as np

from duobench.core.files import write
from duobench.core.pages import render
from duobench.core.types import CONTROL_HZ
from duobench.core.video import jpeg
from duobench.data.dataset import DataSet
from duobench.data.images import ImageSource, RecordedImages, resized
from duobench.data.recording import Recording
from duobench.data.summary import JUMP, REVERSAL, Summary
from duobench.world.robot.cameras import HEAD

PAGE = "index.html"
"""Name of the page in the folder of the data set."""
COLUMNS = 6
"""Images of an episode on its contact sheet, from its first to its last row."""
IMAGE_SIZE = (135, 240)
"""Height and width of each of them in pixels."""


def write_page(
    data: DataSet,
    summary: Summary,
    *,
    images: bool = True,
) -> Path:
    """Write the page into the folder of the data set, and say where.

    Args:
        data: The data set.
        summary: What it adds up to.
        images: Whether to show images of the first episode of each task, which are rendered.

    Raises:
        DataError: An episode cannot be read or shown.
        RenderingError: Nothing can be rendered.
        OutputError: The page cannot be written.
    """
    firsts = {
        task.task: data.episodes(task.task)[0] for task in summary.tasks if images
    }
    sheets = {
        task: base64.b64encode(s).decode()
        for task, path in firsts.items()
        if (s := contact_sheet(data, path))
    }
    page = data.path / PAGE
    text = render(
        "duobench.data",
        "dataset.html.j2",
        name=data.path.name,
        about=data.read_description(),
        summary=summary,
        sheets=sheets,
        rate=CONTROL_HZ,
        reversal=REVERSAL,
        jump=JUMP,
    )
    write(page, text)
    return page


def contact_sheet(data: DataSet, path: Path) -> bytes | None:
    """Images of an episode side by side, as a JPEG; None if it has none."""
    recording = Recording.read(path)
    rows = np.linspace(0, len(recording), COLUMNS).round().astype(int).tolist()
    if not recording.info.is_real:
        task = data.reference(recording.info)
        with closing(ImageSource(task, cameras=(HEAD,), size=IMAGE_SIZE)) as source:
            images = [source.images(recording, row)[HEAD] for row in rows]
    elif HEAD in recording.info.videos:
        with closing(
            RecordedImages(recording, path, (HEAD,), IMAGE_SIZE, lambda *_: resized)
        ) as videos:
            images = [videos.images(row)[HEAD] for row in rows]
    else:
        return None
    return jpeg(np.hstack(images))
