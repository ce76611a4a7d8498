"""Small environments for libraries of the field."""

from typing import Any

import gymnasium as gym

import duobench
from tests.envs.tools import TASK

HORIZON = 6
IMAGES = {"cameras": ("head", "left_wrist"), "image_size": (48, 64), "horizon": HORIZON}
STATES = {"cameras": False, "object_state": True, "horizon": HORIZON}
RENDERED = {"render_mode": "rgb_array", "render_size": (48, 64)}


def flat(**options: Any) -> gym.Env:
    """An environment with two cameras, whose observations have one level."""
    return duobench.make(TASK, **{**IMAGES, "flat_obs": True, **options})


def eyes(**options: Any) -> gym.Env:
    """One with depth and segmentation beside the images, and a camera of one's own."""
    side = duobench.Camera(name="side", position=(0.5, 1.2, 0.6), look_at=(0.5, 0.0, 0.0))
    cameras = ("head", side)
    return flat(cameras=cameras, depth=True, segmentation="side", **options)


def nested(**options: Any) -> gym.Env:
    """The same in the form of LeRobot."""
    return duobench.make(TASK, **{**IMAGES, **options})


def states(**options: Any) -> gym.Env:
    """One without images, but with the numbers of the objects."""
    return duobench.make(TASK, **{**STATES, **options})
