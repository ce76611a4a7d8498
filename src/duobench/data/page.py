"""The page of a data set: what it adds up to, with images, in one file that works offline."""

from __future__ import annotations

import base64
import io
from contextlib import closing
from pathlib import Path

import numpy as np
from PIL import Image

from duobench.data.dataset import DataSet
from duobench.data.images import ImageSource
from duobench.data.recording import Recording
from duobench.data.smoothness import JUMP, REVERSAL
from duobench.data.summary import Summary
from duobench.data.views import RecordedImages, raw_view
from duobench.files import write
from duobench.pages import render
from duobench.types import CONTROL_HZ, HEAD

PAGE = "index.html"
"""Name of the page in the folder of the data set."""
COLUMNS = 6
"""Images of an episode on its contact sheet, from its first to its last row."""
IMAGE_SIZE = (135, 240)
"""Height and width of each of them in pixels."""
JPEG_QUALITY = 80


def write_page(data: DataSet, summary: Summary, *, images: bool = True) -> Path:
    """Write the page into the folder of the data set.

    Args:
        data: The data set.
        summary: What it adds up to.
        images: Whether to show images of the first episode of each task, which are rendered.

    Returns:
        The page.

    Raises:
        DataError: An episode cannot be read or shown.
        RenderingError: Nothing can be rendered.
        OutputError: The page cannot be written.
    """
    shown = [task.task for task in summary.tasks if images and _has_images(data, task.task)]
    sheets = {task: _contact_sheet(data, task) for task in shown}
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


def _has_images(data: DataSet, task: str) -> bool:
    """Whether the first episode of a task has images, or states to render them from."""
    info = Recording.read_info(data.episodes(task)[0])
    return not info.is_real or HEAD in info.videos


def _contact_sheet(data: DataSet, task: str) -> str:
    """Images of the first episode of a task side by side, as the address of a JPEG."""
    path = data.episodes(task)[0]
    recording = Recording.read(path)
    moments = np.linspace(0, len(recording), COLUMNS).round().astype(int)
    if recording.info.is_real:
        with closing(RecordedImages(recording, path, (HEAD,), IMAGE_SIZE, raw_view)) as videos:
            images = [videos.images(int(row))[HEAD] for row in moments]
    else:
        with closing(ImageSource(task, cameras=(HEAD,), size=IMAGE_SIZE)) as source:
            images = [source.images(recording, int(row))[HEAD] for row in moments]
    buffer = io.BytesIO()
    Image.fromarray(np.hstack(images)).save(buffer, format="JPEG", quality=JPEG_QUALITY)
    return f"data:image/jpeg;base64,{base64.b64encode(buffer.getvalue()).decode()}"
