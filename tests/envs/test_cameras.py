"""Images in the observation."""

import gymnasium as gym
import numpy as np
import pytest

from duobench.world.robot.cameras import POLICY_CAMERAS
from tests.children import printed
from tests.envs.tools import Make, wave, waves

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


def test_the_protocol_shows_three_cameras(make: Make) -> None:
    env = make(cameras=True)
    pixels = env.observation_space["pixels"]
    assert tuple(pixels.spaces) == POLICY_CAMERAS == ("head", "left_wrist", "right_wrist")
    assert {space.shape for space in pixels.spaces.values()} == {(224, 224, 3)}
    observation, _ = env.reset(seed=0)
    assert observation in env.observation_space
    images = [*observation["pixels"].values()]
    assert all(image.std() > 10 for image in images)
    assert not np.array_equal(images[1], images[2])
    env.close()  # as the fixture does once more


def test_an_image_follows_the_step_and_belongs_to_the_user(make: Make) -> None:
    env = make(cameras="head", image_size=SIZE)
    first = env.reset(seed=0)[0]["pixels"]["head"]
    kept = first.copy()
    last = [env.step(wave(5 + k))[0] for k in range(6)][-1]["pixels"]["head"]
    assert last.shape == (*SIZE, 3)
    assert not np.array_equal(last, kept)
    assert np.array_equal(first, kept)


def test_images_that_nobody_looks_at_are_left_out_through_any_wrappers(make: Make) -> None:
    env = gym.Wrapper(gym.Wrapper(make(cameras="head", image_size=SIZE)))
    switch = env.get_wrapper_attr("set_rendering")
    switch(False)
    assert set(env.reset(seed=0)[0]) == {"agent_pos", "tcp_pose"}
    switch(True)
    assert env.step(wave(0))[0] in env.observation_space


def test_a_chunk_inside_is_drawn_once(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    env = make(cameras="head", image_size=SIZE, chunk=5)
    env.reset(seed=0)
    drawn = []
    backend = env.base.backend
    draw = backend.images_by_kind
    monkeypatch.setattr(
        backend, "images_by_kind", lambda wanted: (drawn.append(wanted), draw(wanted))[1]
    )
    observation, *_ = env.step(waves(5))
    assert drawn == [{"rgb": {"head": SIZE}}]
    assert np.array_equal(observation["pixels"]["head"], backend.images(("head",), SIZE)["head"])


def test_no_opengl_before_the_first_reset() -> None:
    assert printed(BEFORE_RESET) == ""
