"""Videos of episodes, for people: the table, stage and time, and the policy's images."""

import io
import time
from collections.abc import Callable, Mapping
from fractions import Fraction
from functools import cache

import gymnasium as gym
import numpy as np
from PIL import Image as Pillow, ImageDraw, ImageFont

from duobench.core.backend import Image
from duobench.core.codecs import VP9
from duobench.core.false_colours import pictures
from duobench.core.types import CONTROL_HZ
from duobench.core.video import VideoWriter
from duobench.envs.execution import Step
from duobench.envs.sim_env import sim_of
from duobench.evaluation.rollouts import Info, Observation
from duobench.results.suite import TaskInfo
from duobench.world.looks.catalog import as_look
from duobench.world.robot.cameras import OVERVIEW
from duobench.world.sim.rendering import Renderer

FRAME_EVERY = 2
"""Control steps from one frame to the next."""
FRAME_RATE = Fraction(CONTROL_HZ) / FRAME_EVERY
"""Frames a second: the video plays in real time."""
VIDEO_SIZE = (480, 640)
"""Height and width of its images in pixels."""
_LARGE, _SMALL = 17, 12  # text, in pixels
_MARGIN = 6  # pixels around text
_PAPER, _INK = (24, 28, 32), (255, 255, 255)
_MOST_SHARE = 2
"""An image of the policy is as high as the overview over this number, at most."""


class Overview:
    """The camera for people, on a simulated environment, wrapped or not.

    OpenGL is first touched by the first image.

    Args:
        env: The environment.
        look: Look of the images; without one, that of the episode.
    """

    def __init__(self, env: gym.Env, look: str | None = None) -> None:
        self._base = sim_of(env)
        self._own = None if look is None else as_look(look)
        height, width = VIDEO_SIZE
        self._renderer = Renderer(
            self._base.simulation.model, height=height, width=width
        )

    def image(self) -> Image:
        """The current image (480, 640, 3)."""
        self._renderer.set_look(self._own or self._base.look)
        return self._renderer.render(self._base.simulation.data, OVERVIEW)

    def close(self) -> None:
        """Free the renderer."""
        self._renderer.close()


class VideoRecorder:
    """Encodes a video in memory: a frame at the start, and one every other control step.

    A video of an episode is half a megabyte, so it needs no file until it is complete.

    Args:
        render: Gives the current image, (height, width, 3), both even.
        picture: Adds stage, time and the images of observations; None shows the image alone.
    """

    def __init__(
        self, render: Callable[[], Image], picture: "Picture | None" = None
    ) -> None:
        self._render, self._picture = render, picture
        self.seconds = 0.0
        """Seconds that the video has taken so far."""
        self._file = io.BytesIO()
        self._writer = VideoWriter(self._file, VP9, FRAME_RATE)

    def on_episode_start(
        self,
        env: gym.Env,  # noqa: ARG002 - the protocol's signature
        observation: Observation,
        info: Info,
    ) -> None:
        """Show the reset."""
        self._look(0, observation)
        self._show(0, info)

    def on_step(self, step: Step) -> None:
        """Show every other step, and the last."""
        if not step.is_last:  # after which no policy acts
            self._look(step.number, step.observation)
        if step.number % FRAME_EVERY == 0 or step.is_last:
            self._show(step.number, step.info)

    def on_episode_end(self, error: BaseException | None) -> None:  # noqa: ARG002 - what there was is shown
        """Finish the video, however the episode ended."""
        self._writer.close()

    def video(self) -> bytes | None:
        """The video as a WebM file, once the episode has ended; None if nothing was shown."""
        return self._file.getvalue() or None

    def _look(self, number: int, observation: Observation) -> None:
        images = {} if self._picture is None else dict(pictures(observation))
        if self._picture is not None and images:
            self._picture.look(number, images)

    def _show(self, number: int, info: Info) -> None:
        start = time.perf_counter()
        image = self._render()
        if self._picture is not None:
            image = self._picture.draw(image, number, info["stage"])
        self._writer.add(image)
        self.seconds += time.perf_counter() - start


class Picture:
    """Puts the parts of a picture together: overview, stage and time, and the policy's images.

    Args:
        task: The task, which names the stages.
        is_seen: Whether the images that `look` gets are those that the policy saw, whose time is
            told then; if not, its cameras are shown at any time.
    """

    def __init__(self, task: TaskInfo, *, is_seen: bool = True) -> None:
        self._task, self._is_seen = task, is_seen
        self._images: Mapping[str, Image] = {}
        self._seen_after = 0

    def look(self, number: int, images: Mapping[str, Image]) -> None:
        """Note the images (height, width, 3) by name that the policy sees after some steps."""
        self._images, self._seen_after = images, number

    def draw(
        self,
        overview: Image,
        number: int,
        stage: int,
    ) -> Image:
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
        cell = height // max(_MOST_SHARE, len(self._images))
        scaled: dict[str, Pillow.Image] = {}
        for name, image in self._images.items():
            width = 2 * max(
                1, round(cell * image.shape[1] / image.shape[0] / 2)
            )  # even, for VP9
            scaled[name] = Pillow.fromarray(image).resize(
                (width, cell), Pillow.Resampling.LANCZOS
            )
        widest = max(image.width for image in scaled.values())
        column = Pillow.new("RGB", (widest, height), _PAPER)
        for nth, (name, image) in enumerate(scaled.items()):
            seen = f", seen at {_time(self._seen_after)}" if self._is_seen else ""
            _write(image, f"{name.replace('_', ' ')}{seen}", _SMALL)
            column.paste(image, (0, nth * cell))
        return column


def _time(number: int) -> str:
    return f"{number / CONTROL_HZ:.1f} s"


@cache
def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """Pillow's own font, which no machine lacks."""
    return ImageFont.load_default(size=size)


def _write(
    picture: Pillow.Image,
    text: str,
    size: int,
) -> None:
    """Write a line into the upper left corner, shortened to the width of the picture."""
    pen, font = ImageDraw.Draw(picture), _font(size)
    room = picture.width - 2 * _MARGIN
    if pen.textlength(text, font) > room:
        while text and pen.textlength(f"{text}…", font) > room:
            text = text[:-1]
        text += "…"
    width = round(pen.textlength(text, font)) + 2 * _MARGIN
    pen.rectangle((0, 0, width, size + _MARGIN), fill=_PAPER)
    pen.text(
        (_MARGIN, _MARGIN / 2),
        text,
        fill=_INK,
        font=font,
    )
