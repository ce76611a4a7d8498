"""The look of an environment: an option of its making and of a reset."""

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import duobench
from duobench.looks.catalog import look
from duobench.looks.look import Look
from tests.envs.tools import TASK, sim_of, wave

SIZE = (24, 32)
OPTIONS: dict[str, Any] = {
    "cameras": "head",
    "image_size": SIZE,
    "render_mode": "rgb_array",
    "render_size": SIZE,
}


def make(**options: Any) -> gym.Env:
    return duobench.make(TASK, **OPTIONS, **options)


def seen(env: gym.Env, **options: Any) -> tuple[np.ndarray, Any, str]:
    """The head's image, what `render` shows, and the state, after a reset."""
    observation, _ = env.reset(seed=0, options=options)
    return observation["pixels"]["head"], env.render(), sim_of(env).state_hash()


def test_a_look_changes_images_and_nothing_else() -> None:
    plain, dark = make(), make(look="dark")
    first, second = seen(plain), seen(dark)
    assert first[0].mean() > 1.3 * second[0].mean()
    assert first[1].mean() > 1.3 * second[1].mean()
    for step in range(5):
        one, other = plain.step(wave(step)), dark.step(wave(step))
        assert np.array_equal(one[0]["agent_pos"], other[0]["agent_pos"])
    assert sim_of(plain).state_hash() == sim_of(dark).state_hash()
    assert dark.get_wrapper_attr("config").look == "dark"
    plain.close()
    dark.close()


def test_a_reset_may_choose_the_look_of_its_episode() -> None:
    env = make()
    plain = seen(env)[0]
    wood = seen(env, look="wood_table")[0]
    assert sim_of(env).look == look("wood_table")
    assert not np.array_equal(plain, wood)
    assert np.array_equal(seen(env, look=look("wood_table").to_json())[0], wood)
    assert np.array_equal(seen(env)[0], plain), "the next episode has the environment's look again"
    env.close()


def test_the_state_of_an_episode_is_restored_in_the_look_that_is_on() -> None:
    env = make(look="noisy")
    image = seen(env)[0]
    state = env.get_wrapper_attr("save_state")()
    env.step(wave(0))
    observation, _ = env.get_wrapper_attr("restore_state")(state)
    assert np.array_equal(observation["pixels"]["head"], image), "noise follows the state"
    env.close()


@pytest.mark.parametrize("value", [Look(exposure=-1.0), {"exposure": -1.0}])
def test_a_look_of_ones_own_is_kept_in_the_configuration(value: Any) -> None:
    env = make(look=value)
    config = env.get_wrapper_attr("config")
    assert config.look == Look(exposure=-1.0)
    bright = make()
    assert seen(env)[0].mean() < seen(bright)[0].mean()
    env.close()
    bright.close()
