"""Random resets, stages and the time limit: each alone, and what they promise together."""

import itertools
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from duobench.core.errors import (
    ActionError,
    DuoBenchError,
    LayoutError,
    OptionError,
    UnknownNameError,
)
from duobench.core.spatial import SE3
from duobench.core.types import CONTROL_HZ, Array
from duobench.envs import RandomizedReset, TaskStages, TimeLimit
from duobench.envs.duo_env import ResetNeededError
from duobench.envs.sim_env import SimEnv
from duobench.tasks import catalog
from duobench.tasks.stages.logic import all_of, any_of
from duobench.tasks.stages.predicates import touching
from duobench.tasks.stages.progress import LOST_SECONDS, Stage
from duobench.world.sim import placement
from duobench.world.sim.layout import Layout
from tests.envs.tools import TASK, Make, equal, make_small, sim_of, wave


@pytest.fixture(scope="module")
def env() -> Iterator[gym.Env]:
    env = make_small()
    yield env
    env.close()


def state_hash(env: gym.Env) -> str:
    return sim_of(env).state_hash()


def solved() -> dict[str, SE3]:
    """Poses in which both cubes lie in the bowls of their colours."""
    poses = dict(next(catalog.get(TASK).layouts(0)).poses)
    for colour in ("white", "black"):
        poses[f"{colour}_cube"] = poses[f"{colour}_bowl"].moved(z=0.0201)
    return poses


_LYING = [touching(f"{colour}_cube", f"{colour}_bowl") for colour in ("white", "black")]
LYING = replace(
    catalog.get(TASK),
    stages=(
        Stage(name="a cube lies in its bowl", instruction="Do one.", holds=any_of(*_LYING)),
        Stage(name="both lie in their bowls", instruction="Do both.", holds=all_of(*_LYING)),
    ),
)
"""The same objects with stages that hold wherever cubes come from."""
AWAY = SE3.at(0.4, 0.0, 0.016)


def begin(env: gym.Env, **others: SE3) -> Array:
    """Both cubes lie in their bowls, or elsewhere; returns the action that holds the arms."""
    env.reset(options={"layout": Layout(poses={**solved(), **others})})
    return sim_of(env).simulation.duo.command().flat


def test_the_layout_is_the_first_valid_one_that_the_task_draws(env: gym.Env) -> None:
    _, info = env.reset(seed=7)
    task, simulation = catalog.get(TASK), sim_of(env).simulation
    drawn = placement.first_valid(simulation, task.layouts(7), task.id)
    assert info["layout"] == drawn.to_json()


def test_a_seeded_reset_decides_the_resets_after_it(env: gym.Env) -> None:
    runs = []
    for _ in range(2):
        env.reset(seed=3)
        runs.append([env.reset()[1]["seed"] for _ in range(3)])
    assert runs[0] == runs[1]
    assert len(set(runs[0])) == 3
    _, info = env.reset(seed=runs[0][1])
    assert info["seed"] == runs[0][1]


def test_a_reset_samples_from_the_split_of_its_environment_or_options(
    env: gym.Env, make: Make
) -> None:
    _, on_eval = env.reset(seed=7)
    _, on_train = env.reset(seed=7, options={"split": "train"})
    assert (on_eval["split"], on_train["split"]) == ("eval", "train")
    assert on_eval["layout"] != on_train["layout"]
    task, simulation = catalog.get(TASK), sim_of(env).simulation
    sampled = placement.first_valid(simulation, task.layouts(7, "train"), task.id)
    assert on_train["layout"] == sampled.to_json()
    _, of_given = env.reset(options={"layout": on_train["layout"]})
    assert of_given["split"] is None

    train = make(split="train")
    assert train.get_wrapper_attr("config").split == "train"
    for options, expected in (({}, on_train), ({"split": "eval"}, on_eval)):
        _, info = train.reset(seed=7, options=options)
        assert (info["split"], info["layout"]) == (expected["split"], expected["layout"])


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"lok": "dark"}, UnknownNameError, "option of a reset 'lok'.*Did you mean 'look'"),
        ({"splitt": "train"}, UnknownNameError, "'splitt'.*Did you mean 'split'"),
        ({"layouts": {}}, UnknownNameError, "'layouts'.*Did you mean 'layout'"),
        ({"look": 5}, OptionError, "A look is a name, a Look or its JSON form; got 5"),
        ({"split": 1}, UnknownNameError, "split 1"),
        ({"split": "test"}, UnknownNameError, "split 'test'.*Known: eval, salted, train"),
        ({"instruction": " "}, OptionError, "text that can be printed, got ' '"),
        ({"instruction": "a\x00b"}, OptionError, "text that can be printed"),
        ({"instruction": 11}, OptionError, "a number from 0 to 10: .*; got 11"),
        ({"instruction": True}, OptionError, "a number from 0 to 10: .*; got True"),
        ({"layout_seed": "7"}, OptionError, "A seed is a whole number from 0 on, got '7'"),
    ],
    ids=str,
)
def test_options_that_are_none_are_refused(
    env: gym.Env, options: dict[str, object], error: type[DuoBenchError], words: str
) -> None:
    for one in (env, sim_of(env)):
        with pytest.raises(error, match=words):
            one.reset(seed=7, options=options)


def test_options_of_others_are_left_to_them(env: gym.Env) -> None:
    """LeRobot hands one of its own wrappers' on to every environment."""
    _, info = env.reset(seed=7, options={"lerobot_new_rollout": True, "look": "dark"})
    assert info["seed"] == 7
    with pytest.raises(UnknownNameError, match=r"'nonsense'\. Known: instruction, layout"):
        env.reset(seed=7, options={"lerobot_new_rollout": True, "nonsense": 1})


def test_a_misspelt_option_takes_no_seed_from_the_environment(env: gym.Env) -> None:
    seeds = []
    for options in ({}, {"lok": "dark"}):
        env.reset(seed=3)
        with suppress(UnknownNameError):
            env.reset(options=options)
        seeds.append(env.reset()[1]["seed"])
    env.reset(seed=3)
    assert env.reset()[1]["seed"] == seeds[1] != seeds[0]


def test_a_seed_of_the_layout_can_be_given(env: gym.Env) -> None:
    _, info = env.reset(seed=np.int64(7))  # type: ignore[arg-type]
    before = state_hash(env)
    _, again = env.reset(seed=8, options={"layout_seed": np.int64(7)})
    assert (again["seed"], type(again["seed"])) == (info["seed"], int) == (7, int)
    assert state_hash(env) == before


def test_what_goes_in_and_what_comes_out_is_the_users_own(env: gym.Env) -> None:
    options: dict[str, object] = {"look": "default"}
    _, info = env.reset(seed=7, options=options)
    assert options == {"look": "default"}
    given = info["layout"]
    _, again = env.reset(options={"layout": given})
    again["layout"]["poses"]["white_cube"][0] = 99.0
    assert given["poses"]["white_cube"][0] != 99.0
    again["stage_to_subinstructions"].clear()
    assert env.step(wave(0))[-1]["stage_to_subinstructions"]


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda poses: poses.pop("white_cube"), "missing.*white_cube"),
        (lambda poses: poses.update(ghost=[0.5, 0, 0, 0, 0, 0, 1]), "unknown.*ghost"),
        (lambda poses: poses.update(white_cube=[0.5, 0.0]), "no layout"),
        (lambda poses: poses.update(white_cube=poses["black_cube"]), "overlap"),
        (lambda poses: poses.update(white_cube=[2.0, 0, 0.016, 0, 0, 0, 1]), "out of reach"),
    ],
)
def test_an_impossible_layout_is_refused(env: gym.Env, spoil: Any, words: str) -> None:
    layout = env.reset(seed=5)[1]["layout"]
    spoil(layout["poses"])
    with pytest.raises(LayoutError, match=words):
        env.reset(options={"layout": layout})
    with pytest.raises(ResetNeededError):
        env.step(wave(0))
    env.reset(seed=0)
    env.step(wave(0))


def test_info_says_where_the_episode_stands(env: gym.Env) -> None:
    task = catalog.get(TASK)
    _, at_reset = env.reset(seed=0)
    _, *outcome, info = env.step(wave(0))
    assert outcome == [0.0, False, False]
    expected = {
        **dict.fromkeys(("success", "is_success", "success_at_end"), False),
        **{"stage": 0, "max_stage": 5, "instruction": task.instruction},
        "stage_to_subinstructions": dict(enumerate(stage.instruction for stage in task.stages)),
        "current_subinstruction": task.stages[0].instruction,
    }
    for told in (at_reset, info):
        assert {name: told[name] for name in expected} == expected
    assert isinstance(info["success"], bool)


def test_the_last_stage_terminates_with_full_reward(make: Make) -> None:
    env = make(LYING)
    hold = begin(env)
    _, *outcome, info = env.step(hold)
    assert outcome == [1.0, True, False]
    assert [info[name] for name in ("success", "is_success", "success_at_end")] == [True] * 3
    assert info["stage"] == info["max_stage"]
    assert info["current_subinstruction"] == LYING.stages[-1].instruction
    with pytest.raises(ResetNeededError, match="over"):
        env.step(hold)


def test_success_at_end_is_about_now_while_success_stays() -> None:
    env = TaskStages(SimEnv(LYING))
    hold = begin(env)
    assert env.step(hold)[4]["success_at_end"]
    env.base.simulation.place("white_cube", AWAY)
    env.base.simulation.forward()
    _, reward, terminated, _, info = env.step(hold)
    assert (reward, terminated, info["success"]) == (1.0, True, True)
    assert not info["success_at_end"]


def test_what_is_to_be_done_now_is_said_after_a_slip_and_in_a_restored_episode() -> None:
    lies = any_of(*_LYING)
    slipping = replace(LYING, stages=(replace(LYING.stages[0], stays=lies), LYING.stages[1]))
    env = TaskStages(SimEnv(slipping))
    hold = begin(env, black_cube=AWAY)
    assert env.step(hold)[4]["current_subinstruction"] == "Do both."
    env.base.simulation.place("white_cube", SE3.at(0.4, 0.1, 0.016))
    infos = [env.step(hold)[4] for _ in range(round(LOST_SECONDS * CONTROL_HZ))]
    assert [info["stage"] for info in infos] == [1] * len(infos)
    said = [info["current_subinstruction"] for info in infos]
    assert said == ["Do both."] * (len(infos) - 1) + ["Do one."]
    saved = env.save_state()
    env.reset(seed=0)
    assert env.restore_state(saved)[1]["current_subinstruction"] == "Do one."


def test_partial_progress_is_rewarded_and_on_request_it_is_said_what_is_missing() -> None:
    env = TaskStages(SimEnv(LYING))
    hold = begin(env, black_cube=AWAY)
    _, reward, terminated, _, info = env.step(hold)
    assert (info["stage"], reward, terminated) == (1, 1 / 2, False)
    assert env.unmet is None
    env.explain_stages()
    env.step(hold)
    assert env.unmet == ("black_cube does not touch black_bowl",)
    with pytest.raises(DuoBenchError):
        env.step(np.full(16, np.nan))
    assert env.unmet is None  # the simulation may be anywhere
    begin(env)
    assert env.unmet is None
    env.step(hold)
    assert env.unmet == ()
    env.explain_stages(on=False)
    assert env.unmet is None


def test_asking_why_changes_no_judgement() -> None:
    env = TaskStages(SimEnv(catalog.get(TASK)))
    episodes = []
    for asked in (False, True):
        env.explain_stages(asked)
        env.reset(seed=0)
        stages = []
        for k in range(20):
            info = env.step(wave(k))[4]
            assert (env.unmet is not None) == asked
            stages.append((info["stage"], info["success_at_end"]))
        episodes.append((stages, env.save_state().progress, state_hash(env)))
    assert episodes[0] == episodes[1]


def test_the_horizon_ends_an_episode_which_can_be_played_on_to_a_later_one() -> None:
    env = TimeLimit(SimEnv(catalog.get(TASK)), horizon=2)
    for _ in range(2):  # the limit is that of one episode
        env.reset(seed=0)
        with pytest.raises(ActionError):  # and does not count
            env.step(np.full(16, np.nan))
        for limit in (4, None):
            assert [env.step(wave(k))[3] for k in range(2)] == [False, True]
            with pytest.raises(ResetNeededError, match="over"):
                env.step(wave(0))
            if limit:
                env.play_on(limit)


@pytest.mark.parametrize("order", list(itertools.permutations(range(3))))
def test_any_order_gives_the_same_episode(env: gym.Env, order: tuple[int, ...]) -> None:
    wrap = (RandomizedReset, TaskStages, lambda inner: TimeLimit(inner, 216))
    other: gym.Env = SimEnv(catalog.get(TASK))
    for number in order:
        other = wrap[number](other)
    assert equal(env.reset(seed=5), other.reset(seed=5))
    for k in range(3):
        assert equal(env.step(wave(k)), other.step(wave(k)))
