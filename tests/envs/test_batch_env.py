"""Episodes side by side on threads are those of `make`, to the last bit."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import replace
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import duobench
from duobench import Camera
from duobench.core.errors import (
    ActionError,
    DuoBenchError,
    OptionError,
    SimulationError,
    UnknownNameError,
)
from duobench.core.randomness import around
from duobench.core.types import SIDES
from duobench.envs.batch_env import BatchEnv
from duobench.tasks import catalog, object_state
from duobench.tasks.object_state import Numbers
from duobench.tasks.stages.logic import Predicate, held_for, since
from duobench.tasks.stages.predicates import touches
from duobench.tasks.stages.progress import Stage
from duobench.tasks.task import Placement
from duobench.world.objects.blocks import RED
from duobench.world.objects.cup import square_mark
from duobench.world.objects.prop import Prop
from duobench.world.sim import simulation, thread_batch
from tests.envs.test_vector import one_of
from tests.envs.tools import TASK, equal, make_small, vectors, waves
from tests.quick_first import quick_first
from tests.task_harness import marked
from tests.tasks.experts.baseline_episodes import SEEDS, baseline

COUNT, SEED = 2, 11
SAME = ("stage", "max_stage", "success", "is_success", "success_at_end", "clipped", "sent")
SAID = ("instruction", "current_subinstruction")
ASYNC = {"vectorization_mode": "async", "vector_kwargs": {"context": "spawn"}}


@pytest.fixture
def several() -> Iterator[Callable[..., BatchEnv]]:
    """Makes vector environments on threads."""
    yield from vectors(threads=2)


def check_same(result: Any, number: int, alone: Any) -> None:
    """One episode of a vector environment's reset or step is what a single one gave."""
    assert equal(one_of(result[0], number), alone[0])
    assert [values[number] for values in result[1:-1]] == list(alone[1:-1])
    info, expected = result[-1], alone[-1]
    for key in (*SAME, *SAID):
        assert np.array_equal(info[key][number], expected[key]), key


@pytest.mark.parametrize("task", [marked(task) for task in catalog.names()])
@pytest.mark.parametrize("threads", quick_first([2, 1]))
def test_golden_episodes_are_the_same(
    several: Callable[..., BatchEnv], task: str, threads: int
) -> None:
    episodes = baseline(task)
    vector = several(task, threads=threads)
    result: Any = vector.reset(seed=list(SEEDS))
    result = (result[0], np.zeros(COUNT), *np.zeros((2, COUNT), bool), result[1])
    for step in range(max(len(episode.states) for episode in episodes)):
        for number, episode in enumerate(episodes):
            if step < len(episode.states):
                assert vector.save_state(number).hash == episode.states[step].hash
                check_same(result, number, episode.results[step])
        last = [min(step, len(episode.actions) - 1) for episode in episodes]
        rows = zip(episodes, last, strict=True)
        result = vector.step(np.stack([episode.actions[at] for episode, at in rows]))


SIDE = Camera(name="side", position=(0.5, 1.2, 0.6), look_at=(0.5, 0.0, 0.0))
OPTIONS: Mapping[str, Mapping[str, Any]] = {
    "poses": {"action_mode": "cartesian", "binary_gripper": True, "reward": "dense"},
    "shifts of poses": {"action_mode": "cartesian_relative", "speed_fraction": 0.5},
    "chunks": {"chunk": 3, "horizon": 7, "reward": "dense"},
    "chunks of poses": {"action_mode": "cartesian", "chunk": 9, "binary_gripper": True},
    "chunks of shifts": {"action_mode": "cartesian_relative", "chunk": 2},
    "displacements": {"action_mode": "joint_relative", "speed_fraction": 0.3, "reward": "progress"},
    "grippers": {"binary_gripper": True, "object_state": True, "split": "train"},
    "images": {"cameras": ("head", "left_wrist"), "image_size": (24, 32), "look": "dark"},
    "flat images": {"cameras": "head", "image_size": 24, "flat_obs": True, "shift": "look-3"},
    "eyes": {
        "cameras": ("head", SIDE),
        "image_size": (24, 32),
        "image_sizes": {"head": (9, 12)},
        "depth": ("right_wrist", "side"),
        "segmentation": True,
        "shift": "camera-3",
    },
    "flat depth": {"cameras": False, "depth": "head", "image_size": 24, "flat_obs": True},
    "words": {"instructions": "varied", "horizon": 4, "shift": "layout-2"},
}


@pytest.mark.slow
@pytest.mark.parametrize("options", OPTIONS.values(), ids=OPTIONS)
@pytest.mark.parametrize("task", ["ball_maze", "pour_marbles"])
def test_options_mean_the_same(
    several: Callable[..., BatchEnv], task: str, options: dict[str, Any]
) -> None:
    vector = several(task, **options)
    result: Any = vector.reset(seed=SEED)
    assert result[0] in vector.observation_space
    actions = [vector.action_space.sample() for _ in range(3)]
    results = [result, *map(vector.step, actions)]
    for number in range(COUNT):
        with closing(make_small(task, **options)) as env:
            episode = [env.reset(seed=SEED + number)]
            episode += [env.step(action[number]) for action in actions]
            for batched, alone in zip(results, episode, strict=True):
                check_same(batched, number, alone)


def test_cameras_of_all_episodes_are_where_those_of_each_are(
    several: Callable[..., BatchEnv],
) -> None:
    options = OPTIONS["eyes"]
    vector = several("ball_maze", **options)
    vector.reset(seed=SEED)
    vector.step(np.stack([waves(1)[0]] * COUNT))
    found = vector.cameras
    assert set(found) == {"head", "right_wrist", "side"}
    for number in range(COUNT):
        with closing(make_small("ball_maze", **options)) as env:
            env.reset(seed=SEED + number)
            env.step(waves(1)[0])
            assert vector.segmentation_ids == env.segmentation_ids
            for name, seen in env.cameras.items():
                assert np.array_equal(found[name].matrix[number], seen.matrix)
                place = found[name].table_from_camera[number]
                assert np.array_equal(place, seen.table_from_camera)


@pytest.mark.parametrize("task", catalog.names())
def test_numbers_of_objects_are_the_same(several: Callable[..., BatchEnv], task: str) -> None:
    vector = several(task, object_state=True)
    vector.reset(seed=SEED)
    actions = vector.action_space.sample()
    seen = vector.step(actions)[0]
    for number in range(COUNT):
        with closing(make_small(task, object_state=True)) as env:
            env.reset(seed=SEED + number)
            assert equal(one_of(seen, number), env.step(actions[number])[0])


def test_episodes_follow_each_other_as_those_of_one_environment(
    several: Callable[..., BatchEnv],
) -> None:
    vector = several(horizon=3)
    vector.reset(seed=SEED)
    env = make_small(horizon=3)
    env.reset(seed=SEED + 1)
    over = False
    for action in waves(9):
        result = vector.step(np.tile(action, (COUNT, 1)))
        if over:
            alone = env.reset()
            assert result[4]["seed"][1] == alone[1]["seed"]
            check_same((result[0], result[4]), 1, alone)
            assert result[1][1] == 0.0
        else:
            alone = env.step(action)
            check_same(result, 1, alone)
        over = not over and (result[2] | result[3])[1]
        assert vector.save_state(1).hash == env.get_wrapper_attr("state_hash")()
    env.close()


def test_some_begin_anew_and_the_others_stay(several: Callable[..., BatchEnv]) -> None:
    vector = several()
    vector.reset(seed=SEED)
    vector.step(np.tile(waves(3)[2], (COUNT, 1)))
    before = vector.save_state(0).hash
    observation, info = vector.reset(seed=4, options={"reset_mask": np.array([False, True])})
    assert vector.save_state(0).hash == before
    assert info["seed"].tolist() == [SEED, 5]
    again, _ = vector.reset(options={"reset_mask": np.zeros(COUNT, dtype=bool)})
    assert equal(again, observation)
    with closing(make_small()) as env:
        assert equal(one_of(observation, 1), env.reset(seed=5)[0])


def test_episodes_go_on_from_states_of_demonstrations(several: Callable[..., BatchEnv]) -> None:
    episode = baseline("transfer_cube")[0]
    middle = len(episode.actions) // 2
    vector = several("transfer_cube", reward="progress")
    _, info = vector.reset(seed=SEED, options={"states": [episode.states[middle], None]})
    assert info["seed"].tolist() == [-1, SEED + 1]
    result: Any = ()
    for step in range(middle, len(episode.actions)):
        assert vector.save_state(0).hash == episode.states[step].hash
        result = vector.step(np.tile(episode.actions[step], (COUNT, 1)))
        gain = episode.results[step + 1][1] - (episode.results[step][1] if step else 0.0)
        assert result[1][0] == pytest.approx(gain)
    assert equal(one_of(result[0], 0), episode.results[-1][0])
    assert result[2].tolist() == [True, False]
    with closing(make_small("transfer_cube")) as env:
        env.get_wrapper_attr("restore_state")(vector.save_state(1))
        assert env.get_wrapper_attr("state_hash")() == vector.save_state(1).hash


def test_a_state_has_the_look_of_its_episode_whatever_was_shown_before(
    several: Callable[..., BatchEnv],
) -> None:
    vector = several(cameras="head", image_size=24)
    usual, _ = vector.reset(seed=SEED)
    states = [vector.save_state(number) for number in range(COUNT)]
    dark, _ = vector.reset(seed=SEED, options={"look": "dark"})
    darkly = [vector.save_state(number) for number in range(COUNT)]
    again, _ = vector.reset(options={"states": states})
    assert equal(again, usual)
    assert not equal(again, dark)
    again, _ = vector.reset(options={"states": darkly})
    assert equal(again, dark)


def test_steps_that_are_not_solved_are_repeated_as_alone(
    several: Callable[..., BatchEnv], monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in (simulation, thread_batch):
        monkeypatch.setattr(module, "SOLVED", 1e-9)  # so that every step counts as unsolved
    vector = several("pour_marbles")
    vector.reset(seed=SEED)
    env = make_small("pour_marbles")
    env.reset(seed=SEED + 1)
    for action in waves(3):
        vector.step(np.tile(action, (COUNT, 1)))
        env.step(action)
    assert vector.save_state(1).hash == env.get_wrapper_attr("state_hash")()
    env.close()


def test_an_episode_without_a_horizon_is_the_same(several: Callable[..., BatchEnv]) -> None:
    episode = baseline(TASK)[0]
    vector = several(max_episode_steps=-1)
    with closing(make_small(max_episode_steps=-1)) as env:
        env.reset(seed=SEED + 1)
        vector.reset(seed=SEED, options={"layout_seed": None})
        for action in episode.actions[:5]:
            env.step(action)
            vector.step(np.tile(action, (COUNT, 1)))
        assert vector.save_state(1).hash == env.get_wrapper_attr("state_hash")()


def test_what_is_over_waits_where_it_does_not_begin_by_itself(
    several: Callable[..., BatchEnv],
) -> None:
    vector = several(horizon=1, vector_kwargs={"autoreset_mode": AutoresetMode.DISABLED})
    vector.reset(seed=SEED)
    action = np.tile(waves(1)[0], (COUNT, 1))
    assert vector.step(action)[3].all()
    with pytest.raises(gym.error.ResetNeeded, match="by reset_mask"):
        vector.step(action)
    vector.reset(options={"reset_mask": np.array([True, False])})
    with pytest.raises(gym.error.ResetNeeded):
        vector.step(action)
    vector.reset(options={"reset_mask": np.array([False, True])})
    assert vector.step(action)[3].all()


def test_a_few_layouts_come_again_and_again(several: Callable[..., BatchEnv]) -> None:
    vector = several(count=12, layouts=3, horizon=1, split="train")
    seeds = vector.reset()[1]["seed"].tolist()
    for action in waves(4):
        seeds += vector.step(np.tile(action, (12, 1)))[4]["seed"].tolist()
    assert set(seeds) == {0, 1, 2}


def test_words_of_ones_own_take_one_simulation_at_a_time(
    several: Callable[..., BatchEnv],
) -> None:
    asked = touches(SIDES[0], "table")
    open_hands = Predicate(
        "hands are open", lambda state: float(state.simulation.duo.read().openings.min()) > 0.5
    )
    both = Predicate(
        "both", lambda state: open_hands(state) and since(~open_hands)(state), (since(~open_hands),)
    )
    stages = tuple(
        Stage(name=name, instruction="Do it.", holds=holds, stays=stays)
        for name, holds, stays in (("shut", ~open_hands | asked, None), ("again", both, open_hands))
    )
    height = Numbers(names=("height",), read=lambda sim: [float(sim.position("white_cube")[2])])
    fixed = object_state.velocity("mark")
    mark = Prop(name="mark", solid=lambda: square_mark(0.02, RED), fixed=True)
    usual = catalog.get(TASK)
    task = replace(
        usual,
        id="own",
        stages=stages,
        object_numbers=(height, fixed),
        props=(*usual.props, mark),
        placements={**usual.placements, "mark": Placement(x=around(0.3, 0.0), y=around(0.0, 0.0))},
    )
    vector = several(task, object_state=True)
    vector.reset(seed=SEED)
    with closing(make_small(task, object_state=True)) as env:
        alone: Any = env.reset(seed=SEED + 1)
        for action in waves(30):
            together, alone = vector.step(np.tile(action, (COUNT, 1))), env.step(action)
            check_same(together, 1, alone)
            if alone[2]:
                break
        assert alone[2]


@pytest.mark.parametrize("remembers", [since, partial(held_for, seconds=0.2)])
def test_words_of_ones_own_that_take_many_remember_each_of_its_own(
    several: Callable[..., BatchEnv], remembers: Callable[[Predicate], Predicate]
) -> None:
    left = Predicate(
        "left of the middle",
        lambda state: state.simulation.origin("white_cube")[1] > 0.1,
        vectorized=True,
    )
    once, both = remembers(left), left & ~left
    asks = Predicate("once", once.ask, (once,), vectorized=True)
    never = Predicate("never", both.ask, (both,), vectorized=True)
    stages = (Stage(name=one.name, instruction="Do it.", holds=one) for one in (asks, never))
    task = replace(catalog.get(TASK), id="own", stages=tuple(stages))
    vector, action = several(task, 6), waves(1)[0]
    vector.reset(seed=SEED)
    for _ in range(10):
        *_, info = vector.step(np.tile(action, (6, 1)))
    assert len(set(info["stage"])) == 2
    with closing(make_small(task)) as env:
        for number, stage in enumerate(info["stage"]):
            env.reset(seed=SEED + number)
            for _ in range(10):
                *_, alone = env.step(action)
            assert alone["stage"] == stage


def test_what_never_held_has_not_held_for_a_hundredth_second(
    several: Callable[..., BatchEnv],
) -> None:
    never = Predicate("never", lambda _state: False)
    stage = Stage(name="never", instruction="Do it.", holds=held_for(never, 0.01))
    vector = several(replace(catalog.get(TASK), id="own", stages=(stage,)), reward="dense")
    vector.reset(seed=SEED)
    _, rewards, *_, info = vector.step(np.tile(waves(1)[0], (COUNT, 1)))
    assert np.isfinite(rewards).all()
    assert not info["stage"].any()


def test_numbers_of_ones_own_are_as_many_as_their_names(several: Callable[..., BatchEnv]) -> None:
    short = Numbers(names=("a", "b"), read=lambda _simulation: [1.0])
    task = replace(catalog.get(TASK), id="own", object_numbers=(short,))
    vector = several(task, object_state=True)
    with pytest.raises(OptionError, match="names 2 numbers, a, b, but 1 were read"):
        vector.reset(seed=SEED)


def test_it_says_what_was_chosen_and_what_numbers_are(several: Callable[..., BatchEnv]) -> None:
    vector = several(object_state=True)
    assert vector.config.object_state
    assert vector.object_state_names == catalog.get(TASK).object_state.names


def test_a_state_of_shifted_physics_is_refused(several: Callable[..., BatchEnv]) -> None:
    vector = several()
    vector.reset(seed=SEED)
    with closing(make_small(shift="physics-3")) as env:
        env.reset(seed=SEED)
        state = env.get_wrapper_attr("save_state")()
    with pytest.raises(OptionError, match="environment 1 is of a shift of physics"):
        vector.reset(options={"states": [None, state]})


def test_diverged_physics_is_an_error_until_a_reset(several: Callable[..., BatchEnv]) -> None:
    vector = several()
    vector.reset(seed=SEED)
    state = vector.save_state(1)
    hot = state.physics.copy()
    hot[1 + vector.simulations.simulation.model.nq :][:3] = 1e30
    vector.reset(options={"states": [None, replace(state, physics=hot)]})
    with pytest.raises(SimulationError, match=r"in environments \[1\]: bad.*reset"):
        vector.step(np.tile(waves(1)[0], (COUNT, 1)))
    with pytest.raises(gym.error.ResetNeeded):
        vector.step(np.tile(waves(1)[0], (COUNT, 1)))
    vector.reset(seed=SEED)
    assert vector.step(np.tile(waves(1)[0], (COUNT, 1)))[0] in vector.observation_space


def test_rendering_shows_each_episode(several: Callable[..., BatchEnv]) -> None:
    vector = several(render_mode="rgb_array", render_size=(24, 32))
    vector.reset(seed=SEED)
    with closing(make_small(render_mode="rgb_array", render_size=(24, 32))) as env:
        env.reset(seed=SEED + 1)
        assert np.array_equal(vector.render()[1], env.render())


@pytest.mark.parametrize("chunk", [None, 2])
@pytest.mark.parametrize("mode", AutoresetMode)
def test_gymnasium_finds_what_it_finds_in_environments_of_their_own(
    several: Callable[..., BatchEnv], mode: AutoresetMode, chunk: int | None
) -> None:
    options: dict[str, Any] = {
        "horizon": 3,
        "chunk": chunk,
        "cameras": False,
        "action_mode": "cartesian_relative",
        "vector_kwargs": {"autoreset_mode": mode},
    }
    vectors: list[Any] = [
        several(threads=None, **options),
        duobench.make_vec(TASK, COUNT, "sync", **options),
    ]
    results = [[vector.reset(seed=SEED)] for vector in vectors]
    action = np.tile(vectors[1].call("hold_action")[0], (COUNT, chunk or 1, 1))
    is_over = False
    for step in range(5):
        action[1, :, :3] = 0.004 * step
        for vector, seen in zip(vectors, results, strict=True):
            if is_over and mode is AutoresetMode.DISABLED:
                seen.append(vector.reset(options={"reset_mask": np.ones(COUNT, dtype=bool)}))
            else:
                seen.append(vector.step(action.reshape(vector.action_space.shape)))
        is_over = bool(results[0][-1][3].all()) if len(results[0][-1]) > 2 else False
        assert vectors[0].call("state_hash") == vectors[1].call("state_hash")
    for batched, own in zip(*results, strict=True):
        assert equal(batched[0], own[0])
        assert equal(batched[1:-1], own[1:-1])
        check_info(batched[-1], own[-1])
    for name in ("task_description", "segmentation_ids", "_max_episode_steps"):
        assert vectors[0].get_attr(name) == vectors[1].get_attr(name)
    vectors[1].close()


def check_info(found: Any, expected: Any) -> None:
    """Info says what that of environments of their own says; the seed more often."""
    for key, value in expected.items():
        if isinstance(value, Mapping):
            check_info(found[key], value)
        elif key == "final_obs":
            assert all(map(equal, found[key], value))
        elif not str(key).startswith("_"):
            told = expected[f"_{key}"]
            assert np.array_equal(found.get(f"_{key}", told), told), key
            assert np.array_equal(found[key][told], value[told]), key


def test_what_one_environment_stands_for_cannot_be_told_apart(
    several: Callable[..., BatchEnv],
) -> None:
    vector = several()
    assert vector.call("task_description") == (catalog.get(TASK).instruction,) * COUNT
    vector.reset(seed=SEED)
    before = vector.save_state(1).hash
    with pytest.raises(OptionError, match=r"step moves an episode.*sync"):
        vector.call("step", waves(3)[2])
    assert vector.save_state(1).hash == before
    vector.set_attr("note", ["a"] * COUNT)
    assert vector.get_attr("note") == ("a",) * COUNT
    for wrong in ([1, 2], [1]):
        with pytest.raises(OptionError, match="note is one value for all 2 episodes"):
            vector.set_attr("note", wrong)


@pytest.mark.parametrize(
    ("options", "kind"),
    [
        ({}, BatchEnv),
        ({"action_mode": "cartesian", "chunk": 3, "layouts": 2}, BatchEnv),
        ({"cameras": (name for name in ["head"]), "shift": "look-2"}, BatchEnv),
        ({"shift": "physics-1"}, gym.vector.SyncVectorEnv),
        ({"cameras": (name for name in ["head"]), "shift": "sensing-1"}, gym.vector.SyncVectorEnv),
        ({"vector_kwargs": {"copy": False}}, gym.vector.SyncVectorEnv),
        ({"vectorization_mode": "sync"}, gym.vector.SyncVectorEnv),
    ],
)
def test_the_usual_way_is_the_fastest_that_the_options_allow(
    options: dict[str, Any], kind: type[gym.vector.VectorEnv]
) -> None:
    with closing(duobench.make_vec(TASK, COUNT, **{"cameras": False, **options})) as vector:
        assert type(vector) is kind


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"threads": 0}, "threads is a whole number from 1 on"),
        ({"threads": 2, "layouts": 0}, "layouts is a whole number from 1 on"),
        ({"layouts": 3, "vectorization_mode": "sync"}, "belongs to threads"),
        ({"layouts": 3, "shift": "sensing-1"}, "belongs to threads"),
        ({"threads": 1, "vectorization_mode": "async"}, "leave vectorization_mode"),
        ({"threads": 1, "vector_kwargs": {"context": "fork"}}, "leave vectorization_mode"),
        ({"threads": 1, "vector_kwargs": {"autoreset_mode": "disabled"}}, "an AutoresetMode"),
        ({"threads": 1, "shift": "physics-1"}, "leave threads and engine out"),
        ({"threads": 1, "shift": "sensing-1"}, "leave threads and engine out"),
        ({"engine": "wrap"}, "one of mujoco, warp, .* got 'wrap'"),
        ({"engine": "warp", "threads": 2}, "warp takes no threads"),
    ],
    ids=str,
)
def test_what_threads_do_not_take_is_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(OptionError, match=words):
        duobench.make_vec(TASK, COUNT, **options)


def test_an_engine_that_is_not_installed_says_how(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco_warp", None)
    with pytest.raises(OptionError, match=r"Warp is missing .*\[warp\]"):
        duobench.make_vec(TASK, COUNT, engine="warp")


def test_wrong_calls_are_refused_and_move_nothing(several: Callable[..., BatchEnv]) -> None:
    vector = several()
    actions = np.tile(waves(1)[0], (COUNT, 1))
    early: tuple[tuple[Callable[[], Any], str], ...] = (
        (lambda: vector.step(actions), "call reset"),
        (lambda: vector.save_state(0), "call reset"),
        (vector.render, "nothing to see before the first reset"),
        (lambda: vector.reset(options={"reset_mask": np.array([True, False])}), "leave reset_mask"),
    )
    for call, words in early:
        with pytest.raises(gym.error.ResetNeeded, match=words):
            call()
    vector.reset(seed=SEED)
    before, start = vector.save_state(1).hash, vector.save_state(0).layout
    nothing = np.where(np.arange(COUNT)[:, None] == 1, np.nan, actions)
    posing = several(action_mode="cartesian", chunk=2)
    posing.reset(seed=SEED)
    poses = np.stack([np.tile(posing.call("hold_action")[0], (2, 1))] * COUNT)
    poses[1, 1, 3:7] = 0.0
    wrong: tuple[tuple[Callable[[], Any], type[DuoBenchError], str], ...] = (
        (lambda: vector.step(nothing), ActionError, r"environments \[1\]"),
        (lambda: vector.step(actions[0]), ActionError, r"shape \(2, 16\)"),
        (lambda: posing.step(poses), ActionError, r"quaternions .* of environments \[1\]"),
        (lambda: vector.reset(seed=[1]), OptionError, "one entry for each"),
        (lambda: vector.reset(seed=-1), OptionError, "from 0 on"),
        (lambda: vector.reset(options={"reset_mask": [1, 0]}), OptionError, "booleans"),
        (lambda: vector.reset(seed=2**63), OptionError, r"below 2\*\*63"),
        (lambda: vector.reset(options={"states": []}), OptionError, "one entry for each"),
        (lambda: vector.reset(options={"states": None}), OptionError, "list of states"),
        (lambda: vector.save_state(COUNT), OptionError, "Episodes are 0 to"),
        (lambda: vector.save_state(-1), OptionError, "Episodes are 0 to"),
        (lambda: vector.save_state(1.0), OptionError, "Episodes are 0 to"),  # type: ignore[arg-type]
        (lambda: vector.reset(options={"statse": []}), UnknownNameError, "states"),
        (lambda: vector.reset(options={"nonsense": 1}), UnknownNameError, "Known: .*reset_mask"),
    )
    for call, error, words in wrong:
        with pytest.raises(error, match=words):
            call()
    assert vector.save_state(1).hash == before
    vector.reset(seed=np.array(SEED))  # type: ignore[arg-type]
    assert vector.save_state(0).layout == start


@pytest.mark.slow
@pytest.mark.parametrize("task", ["ball_maze", "pour_marbles"])
@pytest.mark.parametrize("kind", [{}, ASYNC, {"threads": 1}], ids=["sync", "async", "threads"])
def test_info_says_the_same_however_episodes_are_made(task: str, kind: dict[str, Any]) -> None:
    alone = [make_small(task, cameras=False, horizon=2) for _ in range(COUNT)]
    vector = duobench.make_vec(task, COUNT, cameras=False, horizon=2, **kind)
    actions = np.stack([waves(1)[0]] * COUNT)
    with closing(vector):
        told = [vector.reset(seed=SEED)[1]]
        told += [vector.step(actions)[-1] for _ in range(3)]  # the last one begins anew
    for number, env in enumerate(alone):
        expected = [env.reset(seed=SEED + number)[1]]
        expected += [env.step(actions[number])[-1] for _ in range(2)]
        expected.append(env.reset()[1])
        for batch, info in zip(told, expected, strict=True):
            assert {"layout", "split"} <= info.keys() or "seed" not in info
            of_one = told_of(batch, number)
            assert of_one.keys() - {"seed"} == info.keys() - {"seed"}
            assert equal({key: of_one[key] for key in info}, info)
        env.close()


def told_of(infos: Mapping[Any, Any], number: int) -> dict[Any, Any]:
    """What the info of several episodes says of one."""
    return {
        key: told_of(value, number) if isinstance(value, Mapping) else value[number]
        for key, value in infos.items()
        if not str(key).startswith("_") and infos.get(f"_{key}", [True] * COUNT)[number]
    }
