"""The look of an environment: an option of its making and of a reset."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest

from duobench.world.looks.catalog import look
from duobench.world.looks.look import Look
from tests.envs.tools import Make, sim_of, wave

SIZE = (24, 32)


@pytest.fixture
def seeing(make: Make) -> Callable[..., Any]:
    return partial(make, cameras="head", image_size=SIZE, render_mode="rgb_array", render_size=SIZE)


def seen(env: Any, **options: Any) -> np.ndarray:
    """The head's image after a reset."""
    return env.reset(seed=0, options=options)[0]["pixels"]["head"]


def test_a_look_changes_images_and_nothing_else(seeing: Make) -> None:
    plain, dark = seeing(), seeing(look="dark")
    assert seen(plain).mean() > 1.3 * seen(dark).mean()
    assert plain.render().mean() > 1.3 * dark.render().mean()
    for step in range(5):
        one, other = plain.step(wave(step)), dark.step(wave(step))
        assert np.array_equal(one[0]["agent_pos"], other[0]["agent_pos"])
    assert plain.state_hash() == dark.state_hash()
    assert dark.get_wrapper_attr("config").look == "dark"


def test_a_reset_may_choose_the_look_of_its_episode(seeing: Make) -> None:
    env = seeing()
    plain, wood = seen(env), seen(env, look="wood_table")
    assert sim_of(env).look == look("wood_table")
    assert not np.array_equal(plain, wood)
    assert np.array_equal(seen(env, look=look("wood_table").to_json()), wood)
    assert np.array_equal(seen(env), plain), "the next episode has the environment's look again"


@pytest.mark.parametrize(
    ("options", "asked"),
    [
        ({"look": "noisy"}, {}),
        ({}, {"look": "dark"}),
        ({"shift": "look-3"}, {}),
        ({"shift": "camera-3"}, {}),
    ],
)
def test_the_state_of_an_episode_brings_its_look(
    seeing: Make, options: dict[str, Any], asked: dict[str, Any]
) -> None:
    env = seeing(**options)
    image, state = seen(env, **asked), env.save_state()
    env.step(wave(0))
    env.reset(seed=7)
    for other in (env, seeing(**options)):
        observation, _ = other.restore_state(state)
        assert np.array_equal(observation["pixels"]["head"], image), "noise follows the state"
    assert np.array_equal(seen(env, **asked), image), "and the next reset has its own"


@pytest.mark.parametrize("value", [Look(exposure=-1.0), {"exposure": -1.0}])
def test_a_look_of_ones_own_is_kept_in_the_configuration(seeing: Make, value: Any) -> None:
    env = seeing(look=value)
    assert env.get_wrapper_attr("config").look == Look(exposure=-1.0)
    assert seen(env).mean() < seen(seeing()).mean()
