"""Cameras: images in the observation."""

from __future__ import annotations

from collections.abc import Sequence

import gymnasium as gym
import numpy as np

from duobench.envs.config import IMAGE_SIZE
from duobench.envs.duo_env import Observation
from duobench.envs.wrappers.base import ObservingWrapper
from duobench.errors import check_known
from duobench.robot.cameras import check_image_size
from duobench.types import POLICY_CAMERAS

PIXELS = "pixels"
"""Key of the images in an observation."""


class Cameras(ObservingWrapper):
    """Adds `pixels` to the observation: one image (height, width, 3), uint8, for each camera.

    It belongs outside action chunks: one image of each camera is rendered for each step and each
    reset, nothing before the first reset. `set_rendering` leaves images out that nobody looks
    at; `env.get_wrapper_attr` finds it through any wrappers.
    """

    def __init__(
        self,
        env: gym.Env,
        cameras: Sequence[str] = POLICY_CAMERAS,
        image_size: tuple[int, int] = IMAGE_SIZE,
    ) -> None:
        """Wrap an environment.

        Args:
            env: A `DuoEnv`, wrapped or not.
            cameras: Names of cameras.
            image_size: Height and width in pixels, at most the native 720 x 1280. An image shows
                the whole native field of view whatever its size.

        Raises:
            UnknownNameError: There is no such camera.
            RenderingError: The size is larger than the native one, or not positive.
        """
        for name in cameras:
            check_known("camera", name, POLICY_CAMERAS)
        self._cameras = tuple(cameras)
        self._is_rendering = True
        height, width = self._shape = image_size
        check_image_size(height, width)

        def image() -> gym.spaces.Box:
            return gym.spaces.Box(0, 255, (height, width, 3), dtype=np.uint8)

        images = gym.spaces.Dict({name: image() for name in cameras})
        super().__init__(env, PIXELS, images, cameras=self._cameras, image_size=image_size)

    def set_rendering(self, is_on: bool) -> None:
        """Switch images on or off; while they are off, an observation has no `pixels`."""
        self._is_rendering = is_on

    def observe(self, observation: Observation) -> Observation:
        """The observation with an image of each camera, unless nobody looks at them."""
        if not self._is_rendering:
            return observation
        return {**observation, PIXELS: self.base.backend.images(self._cameras, self._shape)}
