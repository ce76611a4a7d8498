"""The watcher that makes a video of an episode."""

from __future__ import annotations

import io
from collections.abc import Callable
from fractions import Fraction

import gymnasium as gym

from duobench.envs.execution import Step
from duobench.evaluation.rollout import Info, Observation
from duobench.types import CONTROL_HZ
from duobench.video import VP9, Image, VideoWriter

FRAME_EVERY = 2
"""Control steps from one frame to the next."""
FRAME_RATE = Fraction(CONTROL_HZ) / FRAME_EVERY
"""Frames a second: the video plays in real time."""


class VideoRecorder:
    """Encodes a video in memory: a frame at the start, and one every other control step.

    A video of an episode is half a megabyte, so it needs no file until it is complete.
    """

    def __init__(self, render: Callable[[], Image]) -> None:
        """Remember what to show; encoding begins with the first frame.

        Args:
            render: Gives the current image, (height, width, 3), both even.
        """
        self._render = render
        self._file = io.BytesIO()
        self._writer = VideoWriter(self._file, VP9, FRAME_RATE)

    def on_episode_start(self, env: gym.Env, observation: Observation, info: Info) -> None:  # noqa: ARG002 - the protocol's signature
        """Show the reset."""
        self._writer.add(self._render())

    def on_step(self, step: Step) -> None:
        """Show every other step, and the last."""
        if step.number % FRAME_EVERY == 0 or step.terminated or step.truncated:
            self._writer.add(self._render())

    def on_episode_end(self, error: BaseException | None) -> None:  # noqa: ARG002 - what there was is shown
        """Finish the video, whatever the end was."""
        self._writer.close()

    def video(self) -> bytes | None:
        """The video as a WebM file, once the episode has ended; None if nothing was shown."""
        return self._file.getvalue() or None
