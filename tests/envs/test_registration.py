"""Ids, and tasks of one's own."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import pytest
from gymnasium.envs.registration import EnvSpec

import duobench
from duobench.core.errors import DuoBenchError, OptionError
from duobench.envs import ActionChunks, ResetNeededError
from duobench.envs.registration import env_id
from duobench.results.suite import find_tasks
from duobench.tasks import catalog
from duobench.tasks.task import Task
from tests.children import printed
from tests.envs.tools import TASK, Make, sim_of

MODULE = """
from dataclasses import replace
import duobench
from duobench.tasks import catalog
TASK = replace(catalog.get("bin_sort"), id="my_sort")
duobench.register(TASK)
"""


@pytest.fixture
def mine() -> Iterator[Task]:
    task = replace(catalog.get(TASK), id="my_sort", horizon=5)
    yield task
    gym.registry.pop(env_id("my_sort"), None)


def test_a_task_is_named_by_each_spelling_of_its_id(make: Make, mine: Task) -> None:
    duobench.register(mine)
    for name in (TASK, mine.id):
        for spelling in (name, env_id(name), f"duobench:{env_id(name)}"):
            env = make(spelling)
            assert (env.task, env.spec.id) == (name, env_id(name))
    assert {task.reference for task in find_tasks([env_id(TASK)])} == {TASK}


@pytest.mark.parametrize("name", catalog.names())
def test_a_spec_has_the_horizon(name: str) -> None:
    env_spec = gym.spec(f"duobench/{name}-v1")
    assert env_spec.max_episode_steps == catalog.get(name).horizon


@pytest.mark.parametrize("option", ["horizon", "max_episode_steps"])
@pytest.mark.parametrize("horizon", [2, 1000])
def test_there_is_one_time_limit(make: Make, mine: Task, horizon: int, option: str) -> None:
    env = make(replace(mine, horizon=5), **{option: horizon})
    for made in (env, env.spec.make(), gym.make(env.spec)):
        limits = [made.spec.max_episode_steps, made.get_wrapper_attr("config").horizon]
        limits += [made.get_wrapper_attr("_max_episode_steps"), sim_of(made).definition.horizon]
        assert (limits, str(made).count("TimeLimit")) == ([horizon] * 4, 1)
    env.reset(seed=0)
    action = env.action_space.sample()
    ends = [env.step(action)[3] for _ in range(min(horizon, 7))]
    assert ends.count(True) == (horizon == 2)
    if horizon == 2:
        with pytest.raises(ResetNeededError, match="episode is over"):
            env.step(action)


def test_two_time_limits_are_refused(make: Make, mine: Task) -> None:
    with pytest.raises(OptionError, match="two names of one number"):
        make(replace(mine, horizon=5), horizon=4, max_episode_steps=3)


def test_a_limit_of_gymnasium_counts_control_steps_and_is_part_of_the_state(make: Make) -> None:
    env = make(chunk=4, max_episode_steps=6)
    env.reset(seed=0)
    action = env.action_space.sample()
    outcomes = [env.step(action)[3:]]
    state = env.save_state()
    for _ in range(2):
        outcomes.append(env.step(action)[3:])
        env.restore_state(state)
    ends = [(truncated, info["executed"]) for truncated, info in outcomes]
    assert ends == [(False, 4), (True, 2), (True, 2)]


def test_without_a_time_limit_an_episode_goes_on(make: Make, mine: Task) -> None:
    env = make(mine, max_episode_steps=-1)
    assert env.spec.max_episode_steps is None
    for made in (env, env.spec.make()):
        made.reset(seed=0)
        action = made.action_space.sample()
        assert not any(made.step(action)[3] for _ in range(mine.horizon + 2))


def test_a_spec_survives_its_text(make: Make) -> None:
    for env_spec in (gym.spec(f"duobench/{TASK}-v1"), make().spec):
        again = gym.make(EnvSpec.from_json(env_spec.to_json()))
        assert again.spec.max_episode_steps == catalog.get(TASK).horizon
        assert str(again).count("TimeLimit") == 1


def test_the_spec_of_a_wrapper_added_by_hand_makes_it_again(make: Make) -> None:
    env = ActionChunks(make(), 3)
    again = env.spec.make()
    assert (str(again), again.action_space) == (str(env), env.action_space)


def test_the_unversioned_id_is_the_newest_version() -> None:
    with pytest.warns(UserWarning, match="latest versioned"):
        env = gym.make(f"duobench/{TASK}", cameras=False)
    assert env.spec.id == f"duobench/{TASK}-v1"


@pytest.mark.parametrize("give", ["object", "path"])
def test_a_task_needs_no_registration(make: Make, mine: Task, give: str) -> None:
    env = make(mine if give == "object" else "duobench.tasks.bin_sort:TASK")
    expected = mine if give == "object" else catalog.get(TASK)
    assert sim_of(env).definition is expected
    assert env.spec.id == env_id(expected.id)
    assert env.reset(seed=0)[1]["stage"] == 0
    assert env_id("my_sort") not in gym.registry


def test_a_registered_task_is_found_by_id_until_another_one_is(make: Make, mine: Task) -> None:
    assert duobench.register(mine) == "duobench/my_sort-v1"
    for env in (gym.make("duobench/my_sort-v1", cameras=False), make("my_sort")):
        assert sim_of(env).definition is mine
        assert env.get_wrapper_attr("_max_episode_steps") == 5
    duobench.register(replace(mine, horizon=9))
    assert make("my_sort").get_wrapper_attr("_max_episode_steps") == 9


def test_registering_by_path_stays_a_string(
    mine: Task, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "paths_to_sort.py").write_text(MODULE.replace("duobench.register(TASK)", ""))
    monkeypatch.syspath_prepend(str(tmp_path))
    assert duobench.register("paths_to_sort:TASK") == env_id(mine.id)
    assert gym.spec(env_id(mine.id)).kwargs == {"task": "paths_to_sort:TASK"}
    assert sim_of(gym.make(env_id(mine.id), cameras=False)).task == mine.id


def test_a_module_that_registers_is_found_in_a_fresh_process(tmp_path: Path) -> None:
    (tmp_path / "sorting_module.py").write_text(MODULE)
    code = (
        "import gymnasium as gym\n"
        "env = gym.make('sorting_module:duobench/my_sort-v1', cameras=False)\n"
        "print(env.unwrapped.task)"
    )
    assert printed(code, cwd=tmp_path) == "my_sort\n"


def test_the_benchmarks_ids_are_taken() -> None:
    with pytest.raises(DuoBenchError, match="another id"):
        duobench.register(replace(catalog.get(TASK), horizon=5))


@pytest.mark.parametrize("what", [3, None, Task])
def test_what_is_no_task_is_refused(what: Any) -> None:
    for use in (duobench.make, duobench.register):
        with pytest.raises(OptionError, match=r"A task is an id, an import path.*got "):
            use(what)
