"""Every axis changes exactly what it says: everything else is equal, physics to the bit."""

from collections.abc import Iterator
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import duobench
from duobench.envs.config import EnvConfig
from duobench.errors import OptionError, UnknownNameError
from duobench.shifts.shift import Shift
from duobench.types import POLICY_CAMERAS
from tests.envs.tools import arrays, equal

TASK, SEED, STEPS = "spring_door", 5, 12
MODEL = (
    *("body_mass", "body_inertia", "geom_friction", "jnt_stiffness", "dof_damping"),
    *("geom_size", "geom_pos", "body_pos", "geom_rgba", "actuator_gainprm", "dof_invweight0"),
)


def played(shift: str, cameras: Any = False) -> dict[str, Any]:
    """What an episode of fixed actions shows."""
    env = duobench.make(TASK, cameras=cameras, image_size=32, object_state=True, shift=shift)
    observation, info = env.reset(seed=SEED)
    seen, states = [observation], [env.get_wrapper_attr("state_hash")()]
    action = env.get_wrapper_attr("hold_action")()
    for number in range(STEPS):
        action[1] += 0.02
        action[7] = number % 2
        observation, *_, last = env.step(action)
        seen.append(observation)
        states.append(env.get_wrapper_attr("state_hash")())
    model = env.unwrapped.simulation.model
    found = {
        "states": states,
        "layout": info["layout"],
        "instruction": info["instruction"],
        "stage": last["stage"],
        "numbers": [
            {name: value for name, value in each.items() if name != "pixels"} for each in seen
        ],
        "images": [each.get("pixels") for each in seen],
        "model": {name: getattr(model, name).copy() for name in MODEL},
    }
    env.close()
    return found


@pytest.fixture(scope="module")
def usual() -> dict[str, Any]:
    return played("none", cameras=True)


@pytest.mark.parametrize(
    ("axis", "changed"),
    [
        ("look", {"images"}),
        ("camera", {"images"}),
        ("instruction", {"instruction"}),
        ("sensing", {"images", "numbers"}),
        ("latency", set()),
        ("layout", {"layout", "states", "numbers", "images"}),
        ("physics", {"states", "model"}),
    ],
)
def test_an_axis_changes_what_it_says_and_nothing_else(
    axis: str, changed: set[str], usual: dict[str, Any]
) -> None:
    found = played(f"{axis}-5", cameras=True)
    differing = {name for name in usual if not equal(found[name], usual[name])}
    follows = {"numbers", "images"} if axis == "physics" else set()  # from other states
    assert changed <= differing <= changed | follows
    if axis == "physics":
        model = {name for name in MODEL if not equal(found["model"][name], usual["model"][name])}
        assert model == {
            *("body_mass", "body_inertia", "geom_friction", "jnt_stiffness", "dof_damping"),
            "dof_invweight0",
        }


def test_all_axes_together_have_the_physics_and_words_of_each() -> None:
    together, physics, words = (played(f"{axis}-4") for axis in ("all", "physics", "instruction"))
    assert equal(together["model"], physics["model"])
    assert together["instruction"] == words["instruction"]
    assert together["layout"] == played("layout-4")["layout"]


def test_an_episode_is_a_function_of_its_seed_whatever_was_before() -> None:
    env = duobench.make(TASK, cameras=False, shift="all-5")
    model = env.unwrapped.simulation.model
    found = []
    for seed in (SEED, 6, SEED):
        _, info = env.reset(seed=seed)
        found.append((info, model.body_mass.copy(), env.get_wrapper_attr("state_hash")()))
    env.close()
    assert equal(found[0][1], found[2][1])
    assert not equal(found[0][1], found[1][1])
    assert found[0][2] == found[2][2] != found[1][2]


def test_a_saved_state_brings_the_physics_of_its_episode() -> None:
    envs = [duobench.make(TASK, cameras=False, shift="physics-5") for _ in range(2)]
    first, second = envs
    first.reset(seed=SEED)
    second.reset(seed=SEED + 1)
    second.get_wrapper_attr("restore_state")(first.get_wrapper_attr("save_state")())
    action = first.get_wrapper_attr("hold_action")()
    action[1] += 0.05
    for env in envs:
        env.step(action)
    assert len({env.get_wrapper_attr("state_hash")() for env in envs}) == 1
    for env in envs:
        env.close()


def test_the_compiled_model_comes_back_to_the_bit() -> None:
    env = duobench.make(TASK, cameras=False)
    simulation = env.unwrapped.simulation
    before = arrays(simulation.model)
    statistics = [simulation.model.stat.meaninertia, simulation.model.stat.meanmass]
    simulation.scale_physics(mass=2.0, friction=0.5, spring=3.0)
    assert simulation.model.body_mass.tobytes() != before["body_mass"]
    simulation.scale_physics()
    assert arrays(simulation.model) == before
    assert [simulation.model.stat.meaninertia, simulation.model.stat.meanmass] == statistics
    env.close()


def frames(cameras: Any, shown: set[int]) -> Iterator[tuple[int, Any]]:
    env: gym.Env = duobench.make(TASK, cameras=cameras, image_size=32, shift="sensing-5")
    env.reset(seed=SEED)
    action = env.get_wrapper_attr("hold_action")()
    for number in range(STEPS):
        action[1] += 0.03
        env.get_wrapper_attr("set_rendering")(number in shown)
        observation = env.step(action)[0]
        if number in shown:
            yield number, observation["pixels"]["head"]
    env.close()


def test_dropped_frames_do_not_depend_on_who_looks_and_when() -> None:
    every = dict(frames(POLICY_CAMERAS, set(range(STEPS))))
    few = dict(frames(("head",), {3, 10}))
    assert np.array_equal(few[3], every[3])
    assert np.array_equal(few[10], every[10])


@pytest.mark.parametrize(
    "given", ["look-3", {"axis": "look", "level": 3}, Shift(axis="look", level=3)]
)
def test_a_shift_is_given_by_name_by_fields_or_as_it_is(given: Any) -> None:
    assert EnvConfig.from_options({"shift": given}).shift == Shift(axis="look", level=3)


@pytest.mark.parametrize("given", ["look", 3, {"axis": "look", "levle": 3}, {"axis": "look"}])
def test_what_is_no_shift_is_refused(given: Any) -> None:
    with pytest.raises((OptionError, UnknownNameError)):
        EnvConfig.from_options({"shift": given})
