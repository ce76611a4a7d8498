"""What a step pays: with "progress" finishing returns more than waiting, with "stage" it does not.

That environments pay it in whole episodes of every task is in `tests.tasks.experts.test_episodes`.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import duobench
from duobench.core.errors import UnknownNameError
from duobench.envs import TaskStages
from duobench.envs.rewards import PROGRESS, REWARDS, STAGE, reward_of
from duobench.envs.sim_env import SimEnv
from duobench.tasks import catalog
from tests.envs.test_resets_stages_limit import AWAY, LYING, begin
from tests.envs.tools import TASK, Make, equal, waves
from tests.golden import episodes as golden

DISCOUNTS = (0.9, 0.95, 0.99, 1.0)
RECORDED = [(task, str(seed)) for task in catalog.names() for seed in golden.SEEDS]


def stages_of(task: str, seed: str) -> list[int]:
    """The stage of a recorded episode of an expert, at its reset and after each of its steps."""
    changes = golden.read()["tasks"][task][seed]["stages"]
    stages = [0] * (changes[-1][0] + 1)
    for step, stage in changes:
        stages[step:] = [stage] * (len(stages) - step)
    return stages


def waiting(stages: Sequence[int], stage: int, horizon: int) -> list[int]:
    """The same episode, in which nothing more is done once a stage is reached."""
    until = next(step for step, reached in enumerate(stages) if reached >= stage)
    return [*stages[: until + 1], *[stages[until]] * (horizon - until)]


def returned(form: str, stages: Sequence[int], last: int, discount: float) -> float:
    paid = [reward_of(form, before, after, last) for before, after in pairwise(stages)]
    return float(np.dot(paid, discount ** np.arange(len(paid))))


@pytest.mark.parametrize(("task", "seed"), RECORDED)
def test_with_progress_finishing_returns_more_than_waiting_at_any_stage(
    task: str, seed: str
) -> None:
    stages, (last, horizon) = stages_of(task, seed), facts_of(task)
    assert stages[-1] == last
    earlier = set(stages) - {last}
    assert len(earlier) > 1
    for discount in DISCOUNTS:
        finished = returned(PROGRESS, stages, last, discount)
        assert 0 < finished <= 1 + 1e-12
        for stage in earlier:
            waited = returned(PROGRESS, waiting(stages, stage, horizon), last, discount)
            assert finished > waited
    assert returned(PROGRESS, stages, last, 1.0) == pytest.approx(1.0)


def facts_of(task: str) -> tuple[int, int]:
    """The last stage and the horizon of a task."""
    definition = catalog.get(task)
    return definition.max_stage, definition.horizon


@pytest.mark.parametrize(("task", "seed"), RECORDED)
def test_with_stage_waiting_at_the_last_stage_but_one_returns_more(task: str, seed: str) -> None:
    stages, (last, horizon) = stages_of(task, seed), facts_of(task)
    waited = waiting(stages, max(set(stages) - {last}), horizon)
    for discount in DISCOUNTS:
        assert returned(STAGE, stages, last, discount) < returned(STAGE, waited, last, discount)


@pytest.mark.parametrize("last", range(1, 12))
def test_a_return_is_the_final_progress_whatever_the_way(last: int) -> None:
    rng = np.random.default_rng(last)
    for _ in range(20):
        stages = [0, *rng.integers(0, last + 1, size=30).tolist()]  # a person may take them back
        total = returned(PROGRESS, stages, last, 1.0)
        assert total == pytest.approx(stages[-1] / last, abs=1e-12)


def test_a_step_pays_what_it_adds_also_in_a_restored_episode_and_after_its_end() -> None:
    env = TaskStages(SimEnv(LYING), reward=PROGRESS)
    hold = begin(env, black_cube=AWAY)
    start = env.save_state()
    assert [env.step(hold)[1] for _ in range(2)] == [0.5, 0.0]
    half = env.save_state()
    begin(env)
    assert [env.step(hold)[1] for _ in range(2)] == [1.0, 0.0]
    for state, expected in ((half, [0.0, 0.0]), (start, [0.5, 0.0])):
        env.restore_state(state)
        assert [env.step(hold)[1] for _ in range(2)] == expected
    env.restore_state(start)
    with pytest.raises(duobench.DuoBenchError):
        env.step(np.full(16, np.nan))
    assert env.step(hold)[1] == 0.5, "a step that was refused paid nothing"


@pytest.mark.parametrize(("reward", "expected"), [(STAGE, 3 * 0.5), (PROGRESS, 0.5)])
def test_a_chunk_pays_the_sum(make: Make, reward: str, expected: float) -> None:
    env = make(LYING, chunk=3, reward=reward)
    hold = begin(env, black_cube=AWAY)
    _, total, *_, info = env.step(np.tile(hold, (3, 1)))
    assert (total, info["rewards"].sum(), info["stage"]) == (expected, expected, 1)


def test_only_the_reward_differs(make: Make) -> None:
    runs = []
    for form in REWARDS:
        env = make(LYING, reward=form)
        assert env.get_wrapper_attr("config").reward == form
        hold = begin(env, black_cube=AWAY)
        steps = [env.step(hold) for _ in range(2)]
        runs.append([(seen, *rest) for seen, _, *rest in steps] + [env.state_hash()])
    assert all(equal(run, runs[0]) for run in runs)


@pytest.mark.parametrize("mode", ["sync", "async"])
def test_vector_environments_pay_the_chosen_reward(mode: str) -> None:
    options: dict[str, Any] = {"cameras": False, "reward": PROGRESS, "horizon": 3}
    if mode == "async":
        options["vector_kwargs"] = {"context": "spawn"}
    vector: Any = gym.make_vec(f"duobench/{TASK}-v1", 2, mode, **options)
    assert [config.reward for config in vector.get_attr("config")] == [PROGRESS] * 2
    vector.reset(seed=0)
    for action in waves(4):
        assert vector.step(np.tile(action, (2, 1)))[1].tolist() == [0.0, 0.0]
    vector.close()


@pytest.mark.parametrize(
    "made",
    [
        lambda make: make(reward="progres"),
        lambda _make: TaskStages(SimEnv(LYING), reward="progres"),
    ],
)
def test_a_reward_that_is_not_there_is_refused(make: Make, made: Callable[[Make], object]) -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'progress'"):
        made(make)
    with pytest.raises(UnknownNameError, match="Known: dense, progress, stage"):
        make(reward=None)
