"""The page of a data set: what it adds up to, with images, in one file that works offline."""

from __future__ import annotations

import base64
import io
from contextlib import closing
from pathlib import Path

import numpy as np
from markupsafe import Markup
from PIL import Image

from duobench.data.dataset import DataSet
from duobench.data.images import ImageSource
from duobench.data.recording import Recording
from duobench.data.summary import JointSummary, Summary, TaskSummary
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
    sheets = {task.task: _contact_sheet(data, task.task) for task in summary.tasks if images}
    page = data.path / PAGE
    text = render(
        "duobench.data",
        "dataset.html.j2",
        name=data.path.name,
        about=data.read_description(),
        summary=summary,
        sheets=sheets,
        rate=CONTROL_HZ,
        lengths=_lengths,
        range_strip=_range_strip,
        shares=_shares,
    )
    write(page, text)
    return page


def _contact_sheet(data: DataSet, task: str) -> str:
    """Images of the first episode of a task side by side, as the address of a JPEG."""
    recording = Recording.read(data.episodes(task)[0])
    moments = np.linspace(0, len(recording), COLUMNS).round().astype(int)
    with closing(ImageSource(task, cameras=(HEAD,), size=IMAGE_SIZE)) as source:
        images = [source.images(recording, int(row))[HEAD] for row in moments]
    buffer = io.BytesIO()
    Image.fromarray(np.hstack(images)).save(buffer, format="JPEG", quality=JPEG_QUALITY)
    return f"data:image/jpeg;base64,{base64.b64encode(buffer.getvalue()).decode()}"


def _lengths(task: TaskSummary) -> Markup:
    """The length of every episode as a dot on a line from 0 to the horizon, and a tick at 99 %."""
    longest = max(task.horizon, task.lengths[-1])
    dots = Markup("").join(
        Markup('<circle cx="{:.1f}" cy="6" r="2" fill="currentColor" fill-opacity=".35"/>').format(
            100 * length / longest
        )
        for length in task.lengths
    )
    return Markup(
        '<svg class="whisker" viewBox="-5 0 110 12" aria-hidden="true">'
        '<path d="M0 6H100M100 2V10" stroke="currentColor" stroke-opacity=".25"/>{}'
        '<path d="M{:.1f} 1V11" stroke="currentColor" stroke-width="1.5"/></svg>'
    ).format(dots, 100 * task.long_length / longest)


def _range_strip(joint: JointSummary) -> Markup:
    """A joint's range as a line: what is commanded, 98 % of it thick, a tick at the median."""
    span = joint.high - joint.low
    least, low, middle, high, most = (100 * (q - joint.low) / span for q in joint.quantiles)
    return Markup(
        '<svg class="whisker" viewBox="-5 0 110 12" aria-hidden="true">'
        '<path d="M0 6H100M0 2V10M100 2V10" stroke="currentColor" stroke-opacity=".25"/>'
        '<path d="M{:.1f} 6H{:.1f}" stroke="currentColor" stroke-opacity=".6"/>'
        '<path d="M{:.1f} 6H{:.1f}" stroke="currentColor" stroke-width="4"/>'
        '<path d="M{:.1f} 1V11" stroke="currentColor" stroke-width="1.5"/></svg>'
    ).format(least, most, low, high, middle)


def _shares(task: TaskSummary) -> list[float]:
    """Percent of the time that is spent in each stage."""
    total = sum(task.stage_seconds) or 1.0
    return [100 * seconds / total for seconds in task.stage_seconds]
