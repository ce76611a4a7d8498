"""Images in the observation."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import duobench
from duobench import Camera
from duobench.core.errors import TaskError
from duobench.tasks import catalog
from duobench.world.objects.segmentation import segmentation_ids
from duobench.world.robot.cameras import POLICY_CAMERAS
from tests.children import printed
from tests.envs.tools import Make, equal, wave, waves

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


SIDE = Camera(name="side", position=(0.5, 1.2, 0.6), look_at=(0.5, 0.0, 0.0), size=(30, 40))
PALM = Camera(
    name="palm", position=(0.0, 0.1, 0.05), look_at=(0.0, 0.0, 0.3), on="right_flange", fovy_deg=80
)
EYES: Mapping[str, Any] = {
    "cameras": ("head", SIDE, PALM),
    "image_size": SIZE,
    "image_sizes": {"head": (16, 20)},
    "depth": ("side", "left_wrist"),
    "segmentation": True,
}
SHAPES = {"head": (16, 20), "side": (30, 40), "palm": SIZE, "left_wrist": SIZE}


@pytest.mark.parametrize(
    "options",
    [{}, {"chunk": 2}, {"shift": "sensing-3"}, {"look": "noisy"}, {"action_mode": "cartesian"}],
    ids=str,
)
def test_what_is_asked_for_is_observed_in_its_space(make: Make, options: dict[str, Any]) -> None:
    env = make(**EYES, **options)
    observation, _ = env.reset(seed=0)
    steps = [observation, env.step(env.action_space.sample())[0]]
    for seen in steps:
        assert seen in env.observation_space
        assert set(seen["pixels"]) == set(seen["segmentation"]) == {"head", "side", "palm"}
        assert set(seen["depth"]) == {"side", "left_wrist"}
        for key, kind in (("pixels", np.uint8), ("depth", np.float32), ("segmentation", np.int32)):
            for name, image in seen[key].items():
                assert (image.dtype, image.shape[:2]) == (kind, SHAPES[name])
        assert set(np.unique(seen["segmentation"]["side"])) <= {0, *env.segmentation_ids.values()}


def test_depth_needs_no_colours_and_no_other_images(make: Make) -> None:
    env = make(cameras=False, depth="head", image_size=SIZE)
    observation, _ = env.reset(seed=0)
    assert set(observation) == {"agent_pos", "tcp_pose", "depth"}
    both = make(cameras="head", depth="head", image_size=SIZE).reset(seed=0)[0]
    assert np.array_equal(observation["depth"]["head"], both["depth"]["head"])
    env.get_wrapper_attr("set_rendering")(False)
    assert set(env.reset(seed=0)[0]) == {"agent_pos", "tcp_pose"}


def test_colours_are_the_same_to_the_bit_whatever_else_is_observed(make: Make) -> None:
    plain = make(cameras=True, image_size=SIZE)
    more = make(cameras=(*POLICY_CAMERAS, SIDE), image_size=SIZE, depth=True, segmentation=True)
    for env in (plain, more):
        env.reset(seed=4)
    for number in range(4):
        one, other = (env.step(wave(number))[0]["pixels"] for env in (plain, more))
        assert all(np.array_equal(image, other[name]) for name, image in one.items())
    assert plain.state_hash() == more.state_hash()


def test_all_of_it_stands_in_one_level(make: Make) -> None:
    env, nested = make(**EYES, flat_obs=True), make(**EYES)
    flat, deep = env.reset(seed=1)[0], nested.reset(seed=1)[0]
    assert flat in env.observation_space
    for key, end in (("pixels", "image"), ("depth", "depth"), ("segmentation", "segmentation")):
        for name, image in deep[key].items():
            assert np.array_equal(flat.pop(f"{name}_{end}"), image)
    assert set(flat) == {"agent_pos", "tcp_pose"}
    assert set(env.cameras) == set(nested.cameras) == set(SHAPES)


def test_cameras_are_where_the_arms_have_them_at_each_step(make: Make) -> None:
    env = gym.Wrapper(make(**EYES, flat_obs=True))
    env.reset(seed=0)
    before = env.get_wrapper_attr("cameras")
    for number in range(5):
        env.step(wave(number + 5))
    after = env.get_wrapper_attr("cameras")
    assert set(after) == set(SHAPES)
    for name, seen in after.items():
        still = np.array_equal(seen.table_from_camera, before[name].table_from_camera)
        assert still == (name in ("head", "side"))
        assert np.array_equal(seen.matrix, before[name].matrix)
        height, width = SHAPES[name]
        assert seen.matrix[:2, 2].tolist() == [(width - 1) / 2, (height - 1) / 2]
    assert make().cameras == {}


def test_a_cloud_of_the_observation_finds_the_table(make: Make) -> None:
    env = make(cameras=("left_wrist", SIDE), image_size=(60, 80), depth=True, segmentation=True)
    observation, _ = env.reset(seed=0)
    for number in range(3):
        observation, *_ = env.step(wave(number))
    for name, seen in env.cameras.items():
        table = observation["segmentation"][name] == env.segmentation_ids["table"]
        depth = np.where(table, observation["depth"][name], 0.0)
        cloud, colours = duobench.point_cloud(
            depth, seen.matrix, seen.table_from_camera, observation["pixels"][name]
        )
        assert len(cloud) == len(colours) > 500
        assert np.median(np.abs(cloud[:, 2])) < 1e-4


def test_a_restored_state_shows_the_same(make: Make) -> None:
    env = make(**EYES)
    env.reset(seed=2)
    seen = env.step(wave(3))[0]
    places = env.cameras
    state = env.save_state()
    env.reset(seed=3)
    again, _ = env.restore_state(state)
    assert equal(again, seen)
    assert all(
        np.array_equal(env.cameras[name].table_from_camera, place.table_from_camera)
        for name, place in places.items()
    )


def test_a_prop_may_not_be_called_as_a_part_of_the_workcell() -> None:
    task = catalog.get("bin_sort")
    renamed = replace(task.props[0], name="room")
    assert "white_cube" in segmentation_ids(task.props)
    with pytest.raises(TaskError, match="prop 'room' has the name of a part of the workcell"):
        segmentation_ids([renamed])


def test_late_cameras_are_late_in_all_kinds_and_depth_follows_from_the_seed(make: Make) -> None:
    options = {**EYES, "cameras": ("head", SIDE), "depth": True, "shift": "sensing-5"}
    env, again, few = make(**options), make(**options), make(**{**options, "cameras": SIDE})
    for each in (env, again, few):
        each.reset(seed=5)
    steps = []
    for number in range(8):
        one, other, fewer = (each.step(wave(3 * number))[0] for each in (env, again, few))
        assert equal(one, other)
        for key in ("pixels", "depth", "segmentation"):
            assert equal(one[key]["side"], fewer[key]["side"]), "whatever else is observed"
        steps.append(one)
    parts = [step["segmentation"]["head"] for step in steps]
    late = [equal(*pair) for pair in pairwise(parts)]
    assert any(late)
    pixels = [step["depth"]["head"] for step in steps]
    assert [equal(*pair) for pair in pairwise(pixels)] == late, "the same frame, the same noise"
    assert (pixels[0] == 0.0).any()
