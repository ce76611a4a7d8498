"""The camera for people, from which videos show the table."""

from __future__ import annotations

import gymnasium as gym

from duobench.backend import Image
from duobench.envs.sim_env import sim_of
from duobench.robot.cameras import OVERVIEW
from duobench.sim.rendering import Renderer

VIDEO_SIZE = (480, 640)
"""Height and width of its images in pixels."""


class Overview:
    """The camera for people, on the simulation of an environment."""

    def __init__(self, env: gym.Env) -> None:
        """Find the simulation; OpenGL is first touched by the first image.

        Args:
            env: A simulated environment, wrapped or not.
        """
        self._base = sim_of(env)
        height, width = VIDEO_SIZE
        self._renderer = Renderer(self._base.simulation.model, height=height, width=width)

    def image(self) -> Image:
        """The current image (480, 640, 3), in the look of the episode.

        Raises:
            RenderingError: Nothing can be rendered.
        """
        if self._renderer.look != self._base.look:
            self._renderer.set_look(self._base.look)
        return self._renderer.render(self._base.simulation.data, OVERVIEW)

    def close(self) -> None:
        """Free the renderer."""
        self._renderer.close()
