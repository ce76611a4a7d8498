"""Images in the observation."""

import gymnasium as gym
import numpy as np
import pytest

import duobench
from duobench.envs import ActionChunks, Cameras
from duobench.envs.sim_env import SimEnv
from duobench.tasks import catalog
from duobench.types import POLICY_CAMERAS
from tests.children import printed
from tests.envs.tools import TASK, wave, waves

SIZE = (24, 32)

# Nothing of OpenGL may be loaded before the first reset, so that vector environments can be made
# in a process that never draws.
BEFORE_RESET = """
import os, re, sys
import gymnasium as gym
import duobench
env = gym.make("duobench/bin_sort-v1", render_mode="rgb_array")
assert "OpenGL" not in sys.modules
if os.path.exists("/proc/self/maps"):
    loaded = re.findall(r"lib(?:GL|EGL|OSMesa)\\.so", open("/proc/self/maps").read())
    assert not loaded, loaded
env.close()
"""


def test_the_protocol_shows_three_cameras() -> None:
    env = duobench.make(TASK)
    pixels = env.observation_space["pixels"]  # type: ignore[index]
    assert tuple(pixels.spaces) == POLICY_CAMERAS == ("head", "left_wrist", "right_wrist")
    assert {space.shape for space in pixels.spaces.values()} == {(224, 224, 3)}
    observation, _ = env.reset(seed=0)
    assert observation in env.observation_space
    images = list(observation["pixels"].values())
    assert all(image.std() > 10 for image in images)
    assert not np.array_equal(images[1], images[2])
    env.close()
    env.close()


def test_an_image_follows_the_step_and_belongs_to_the_user() -> None:
    env = duobench.make(TASK, cameras="head", image_size=SIZE)
    first, _ = env.reset(seed=0)
    kept = first["pixels"]["head"].copy()
    for k in range(6):
        last, *_ = env.step(wave(5 + k))
    assert last["pixels"]["head"].shape == (*SIZE, 3)
    assert not np.array_equal(last["pixels"]["head"], kept)
    assert np.array_equal(first["pixels"]["head"], kept)
    env.close()


def test_images_that_nobody_looks_at_are_left_out_through_any_wrappers() -> None:
    env = gym.Wrapper(gym.Wrapper(duobench.make(TASK, cameras="head", image_size=SIZE)))
    switch = env.get_wrapper_attr("set_rendering")
    switch(False)
    blind, _ = env.reset(seed=0)
    assert set(blind) == {"agent_pos", "tcp_pose"}
    switch(True)
    seen, *_ = env.step(wave(0))
    assert seen in env.observation_space
    env.close()


def test_a_chunk_inside_is_drawn_once(monkeypatch: pytest.MonkeyPatch) -> None:
    env = Cameras(ActionChunks(SimEnv(catalog.get(TASK)), 5), ["head"], SIZE)
    env.reset(seed=0)
    drawn = []
    backend = env.base.backend
    draw = backend.images
    monkeypatch.setattr(backend, "images", lambda *given: (drawn.append(given), draw(*given))[1])
    observation, *_ = env.step(waves(5))
    assert len(drawn) == 1
    assert np.array_equal(observation["pixels"]["head"], draw(("head",), SIZE)["head"])
    env.close()


def test_no_opengl_before_the_first_reset() -> None:
    assert printed(BEFORE_RESET) == ""
