"""Every axis changes exactly what it says: everything else is equal, physics to the bit."""

from typing import Any

import pytest

from duobench.core.errors import OptionError, UnknownNameError
from duobench.envs.config import EnvConfig
from duobench.tasks.shifts.shift import Shift
from duobench.world.robot.cameras import POLICY_CAMERAS
from tests.envs.tools import Make, arrays, equal, make_small, sim_of

TASK, SEED, STEPS = "spring_door", 5, 12
MODEL = (
    "body_mass",
    "body_inertia",
    "geom_friction",
    "jnt_stiffness",
    "dof_damping",
    "geom_size",
    "geom_pos",
    "body_pos",
    "geom_rgba",
    "actuator_gainprm",
    "dof_invweight0",
)


def played(shift: str, cameras: Any = False) -> dict[str, Any]:
    """What an episode of fixed actions shows."""
    env = make_small(TASK, cameras=cameras, image_size=32, object_state=True, shift=shift)
    observation, info = env.reset(seed=SEED)
    seen, states = [observation], [env.state_hash()]
    action = env.get_wrapper_attr("hold_action")()
    for number in range(STEPS):
        action[1] += 0.02
        action[7] = number % 2
        observation, *_, last = env.step(action)
        seen.append(observation)
        states.append(env.state_hash())
    model = sim_of(env).simulation.model
    env.close()
    return {
        "states": states,
        "layout": info["layout"],
        "instruction": info["instruction"],
        "stage": last["stage"],
        "images": [each.pop("pixels", None) for each in seen],
        "numbers": seen,
        "model": {name: getattr(model, name).copy() for name in MODEL},
    }


@pytest.fixture(scope="module")
def usual() -> dict[str, Any]:
    return played("none", cameras=True)


@pytest.mark.slow
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
            "body_mass",
            "body_inertia",
            "geom_friction",
            "jnt_stiffness",
            "dof_damping",
            "dof_invweight0",
        }


def test_all_axes_together_have_the_physics_and_words_of_each() -> None:
    together, physics, words = (played(f"{axis}-4") for axis in ("all", "physics", "instruction"))
    assert equal(together["model"], physics["model"])
    assert together["instruction"] == words["instruction"]
    assert together["layout"] == played("layout-4")["layout"]


def test_an_episode_is_a_function_of_its_seed_whatever_was_before(make: Make) -> None:
    env = make(TASK, shift="all-5")
    masses, hashes = [], []
    for seed in (SEED, 6, SEED):
        env.reset(seed=seed)
        masses.append(sim_of(env).simulation.model.body_mass.tolist())
        hashes.append(env.state_hash())
    for found in (masses, hashes):
        assert found[0] == found[2] != found[1]


def test_a_saved_state_brings_the_physics_of_its_episode(make: Make) -> None:
    first, second = (make(TASK, shift="physics-5") for _ in range(2))
    first.reset(seed=SEED)
    second.reset(seed=SEED + 1)
    second.restore_state(first.save_state())
    action = first.get_wrapper_attr("hold_action")()
    action[1] += 0.05
    first.step(action)
    second.step(action)
    assert first.state_hash() == second.state_hash()


def test_a_state_that_is_restored_twice_is_sensed_the_same(make: Make) -> None:
    env = make(TASK, shift="sensing-5", cameras="head", depth="left_wrist", image_size=32)
    env.reset(seed=SEED)
    action = env.get_wrapper_attr("hold_action")()
    action[1] += 0.05
    env.step(action)
    state, found = env.get_wrapper_attr("save_state")(), []
    for seed in (1, 2):
        first, _ = env.get_wrapper_attr("restore_state")(state)
        found.append([first, *(env.step(action)[0] for _ in range(3))])
        env.reset(seed=seed)
    assert equal(*found)


def test_the_compiled_model_comes_back_to_the_bit(make: Make) -> None:
    simulation = sim_of(make(TASK)).simulation

    def compiled() -> tuple[dict[str, bytes], float, float]:
        statistics = simulation.model.stat
        return arrays(simulation.model), statistics.meaninertia, statistics.meanmass

    before = compiled()
    simulation.scaler.apply(mass=2.0, friction=0.5, spring=3.0)
    assert simulation.model.body_mass.tobytes() != before[0]["body_mass"]
    simulation.scaler.apply()
    assert compiled() == before


def test_light_and_colours_leave_depth_and_parts_alone_and_moved_cameras_do_not(make: Make) -> None:
    found = {}
    for shift in ("none", "look-3", "camera-3", "sensing-3"):
        env = make(TASK, cameras=True, depth=True, segmentation=True, image_size=32, shift=shift)
        found[shift] = env.reset(seed=SEED)[0], env.cameras
    usual, places = found["none"]
    for shift, same in (("look-3", True), ("camera-3", False), ("sensing-3", None)):
        seen, moved = found[shift]
        assert not equal(seen["pixels"], usual["pixels"])
        assert equal(seen["segmentation"], usual["segmentation"]) == (same is not False)
        assert equal(seen["depth"], usual["depth"]) == (same is True)
        for name, place in places.items():
            stays = equal(moved[name].table_from_camera, place.table_from_camera)
            assert stays == equal(moved[name].matrix, place.matrix) == (same is not False)


def frames(env: Any, shown: set[int]) -> dict[int, Any]:
    env.reset(seed=SEED)
    action, found = env.get_wrapper_attr("hold_action")(), {}
    for number in range(STEPS):
        action[1] += 0.03
        env.get_wrapper_attr("set_rendering")(number in shown)
        observation = env.step(action)[0]
        if number in shown:
            found[number] = observation["pixels"]["head"]
    return found


def test_dropped_frames_do_not_depend_on_who_looks_and_when(make: Make) -> None:
    sensing = {"image_size": 32, "shift": "sensing-5"}
    every = frames(make(TASK, cameras=POLICY_CAMERAS, **sensing), set(range(STEPS)))
    few = frames(make(TASK, cameras="head", **sensing), {3, 10})
    assert equal(few, {number: every[number] for number in (3, 10)})


@pytest.mark.parametrize(
    "given", ["look-3", {"axis": "look", "level": 3}, Shift(axis="look", level=3)]
)
def test_a_shift_is_given_by_name_by_fields_or_as_it_is(given: Any) -> None:
    assert EnvConfig.from_options({"shift": given}).shift == Shift(axis="look", level=3)


@pytest.mark.parametrize("given", ["look", 3, {"axis": "look", "levle": 3}, {"axis": "look"}])
def test_what_is_no_shift_is_refused(given: Any) -> None:
    with pytest.raises((OptionError, UnknownNameError)):
        EnvConfig.from_options({"shift": given})
