"""The picture of an episode at one moment, for people: the table, and what the policy saw."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np
from PIL import Image as Pillow
from PIL import ImageDraw, ImageFont

from duobench.backend import Image
from duobench.results.suite import TaskInfo
from duobench.types import CONTROL_HZ

_LARGE, _SMALL = 17, 12
"""Sizes of text in pixels."""
_MARGIN = 6
"""Pixels around text."""
_PAPER, _INK = (24, 28, 32), (255, 255, 255)
"""Colours of the box around text, and of text."""
_MOST_SHARE = 2
"""An image of the policy is as high as the overview over this number, at most."""


class Picture:
    """Puts the parts of a picture together: overview, stage and time, and the policy's images."""

    def __init__(self, task: TaskInfo, *, is_seen: bool = True) -> None:
        """Begin an episode of which the policy has seen nothing.

        Args:
            task: The task, which names the stages.
            is_seen: Whether the images that `look` gets are those that the policy saw, whose time
                is told then; if not, its cameras are shown at any time.
        """
        self._task = task
        self._is_seen = is_seen
        self._images: Mapping[str, Image] = {}
        self._seen_after = 0

    def look(self, number: int, images: Mapping[str, Image]) -> None:
        """Note the images (height, width, 3) by camera that the policy sees after some steps."""
        self._images, self._seen_after = images, number

    def draw(self, overview: Image, number: int, stage: int) -> Image:
        """The picture after a control step.

        Args:
            overview: The table (height, width, 3), both even.
            number: Control steps so far.
            stage: The highest stage so far.

        Returns:
            Image (height, width, 3); wider than the overview if the policy sees images.
        """
        picture = Pillow.fromarray(overview)
        _write(picture, self._caption(number, stage), _LARGE)
        if not self._images:
            return np.asarray(picture)
        column = self._column(picture.height)
        both = Pillow.new("RGB", (picture.width + column.width, picture.height), _PAPER)
        both.paste(picture, (0, 0))
        both.paste(column, (picture.width, 0))
        return np.asarray(both)

    def _caption(self, number: int, stage: int) -> str:
        reached = f": {self._task.stages[stage - 1]}" if stage else ""
        return f"{_time(number)}   stage {stage} of {self._task.max_stage}{reached}"

    def _column(self, height: int) -> Pillow.Image:
        """The policy's images, one below the other."""
        cell = height // max(_MOST_SHARE, len(self._images))
        scaled = {
            name: Pillow.fromarray(image).resize(
                (_even(cell * image.shape[1] / image.shape[0]), cell), Pillow.Resampling.LANCZOS
            )
            for name, image in self._images.items()
        }
        width = max(image.width for image in scaled.values())
        column = Pillow.new("RGB", (width, height), _PAPER)
        for nth, (name, image) in enumerate(scaled.items()):
            seen = f", seen at {_time(self._seen_after)}" if self._is_seen else ""
            _write(image, f"{name.replace('_', ' ')}{seen}", _SMALL)
            column.paste(image, (0, nth * cell))
        return column


def _time(number: int) -> str:
    return f"{number / CONTROL_HZ:.1f} s"


def _even(pixels: float) -> int:
    """The nearest even number, which videos ask for."""
    return 2 * max(1, round(pixels / 2))


@cache
def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """Pillow's own font, which no machine lacks."""
    return ImageFont.load_default(size=size)


def _write(picture: Pillow.Image, text: str, size: int) -> None:
    """Write a line into the upper left corner, shortened to the width of the picture."""
    pen, font = ImageDraw.Draw(picture), _font(size)
    room = picture.width - 2 * _MARGIN
    if pen.textlength(text, font) > room:
        while text and pen.textlength(f"{text}…", font) > room:
            text = text[:-1]
        text += "…"
    width = round(pen.textlength(text, font)) + 2 * _MARGIN
    pen.rectangle((0, 0, width, size + _MARGIN), fill=_PAPER)
    pen.text((_MARGIN, _MARGIN / 2), text, fill=_INK, font=font)
