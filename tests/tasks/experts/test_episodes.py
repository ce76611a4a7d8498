"""Episodes of every expert, each played once and asked everything that tests want to know of it."""

from itertools import pairwise

import gymnasium as gym
import numpy as np
import pytest

import duobench
from duobench.envs import TaskStages
from duobench.envs.rewards import DENSE, PROGRESS, STAGE, reward_of
from duobench.tasks import catalog
from tests.envs.tools import equal
from tests.golden import episodes as golden
from tests.tasks.experts.baseline_episodes import baseline, make

SAVES = 3
"""Random control steps of an episode at which its state is restored."""
AFTERWARDS = 60
"""Control steps for which the arms stay where they were last told to be."""
TASKS = pytest.mark.parametrize("name", catalog.names())


@TASKS
def test_an_episode_is_the_golden_one(name: str) -> None:
    expected = golden.read()["tasks"][name]
    for seed, episode in zip(golden.SEEDS, baseline(name), strict=True):
        found = golden.summary(episode)
        assert list(golden.episode_differences(f"seed {seed}", expected[str(seed)], found)) == []
        assert found["stages"][-1][1] == catalog.get(name).max_stage
        assert episode.results[-1][-1]["success"]


@pytest.mark.long
@TASKS
def test_a_saved_state_goes_on_as_it_did(name: str) -> None:
    _, episode = baseline(name)
    hashes = [state.hash for state in episode.states]
    assert len(set(hashes)) == len(hashes)
    env = make(name)
    rng = np.random.default_rng(0)
    for start in sorted(rng.integers(len(episode.actions), size=SAVES), reverse=True):
        env.reset(seed=2)
        observation, info = env.get_wrapper_attr("restore_state")(episode.states[start])
        assert env.get_wrapper_attr("state_hash")() == hashes[start]
        before, *_, told = episode.results[start]
        assert equal(observation, before)
        for key in ("stage", "success", "instruction", "current_subinstruction", "sent"):
            assert equal(info[key], told[key]), key
        for number in range(start, len(episode.actions)):
            assert equal(env.step(episode.actions[number]), episode.results[number + 1])
        assert env.get_wrapper_attr("state_hash")() == hashes[-1]
    env.close()


@TASKS
def test_each_form_of_the_reward_is_paid(name: str) -> None:
    _, episode = baseline(name)
    last = catalog.get(name).max_stage
    stages = [info["stage"] for *_, info in episode.results]
    assert [result[1] for result in episode.results] == [
        reward_of(STAGE, stage, stage, last) for stage in stages
    ]
    env = duobench.make(name, cameras=False, reward=PROGRESS)
    env.reset(seed=2)
    paid = []
    for step in range(len(stages) - 1):
        if stages[step + 1] > stages[step]:
            env.get_wrapper_attr("restore_state")(episode.states[step])
            paid.append(env.step(episode.actions[step])[1])
    env.close()
    assert paid == [(after - before) / last for before, after in pairwise(stages) if after > before]
    assert sum(paid) == pytest.approx(1.0)


@pytest.mark.long
@TASKS
def test_what_is_nearer_is_paid_and_taken_back_alone_or_on_threads(name: str) -> None:
    _, episode = baseline(name)
    last, middle = catalog.get(name).max_stage, len(episode.actions) // 2
    stages = [info["stage"] for *_, info in episode.results]
    env = duobench.make(name, cameras=False, reward=DENSE)
    restore, judge = (env.get_wrapper_attr(word) for word in ("restore_state", "judge"))
    restore(episode.states[0])
    start = judge.near()
    paid = [env.step(action)[1] for action in episode.actions]
    assert sum(paid) == pytest.approx(1.0 - start / last)
    assert 0.0 <= start < 0.9
    worth = start / last + np.cumsum(paid)
    for stage, so_far in zip(stages[1:], worth, strict=True):
        assert stage / last <= so_far + 1e-12 < (stage + 1) / last or stage == last
    assert np.count_nonzero(paid) > len(paid) / 4
    restore(episode.states[middle])
    again = [env.step(action)[1] for action in episode.actions[middle:]]
    assert again == paid[middle:], "it follows from the state alone"
    vector = duobench.make_vec(name, 2, threads=1, cameras=False, reward=DENSE)
    vector.reset(options={"states": [episode.states[0], episode.states[middle]]})
    for first, second in enumerate(range(middle, len(paid))):
        both = vector.step(np.stack([episode.actions[first], episode.actions[second]]))[1]
        assert both.tolist() == [paid[first], paid[second]]
    vector.close()
    env.close()


@TASKS
def test_what_an_expert_leaves_goes_on_counting(name: str) -> None:
    here, _ = baseline(name)
    env = make(name)
    env.reset(seed=2)
    env.get_wrapper_attr("restore_state")(here.states[-1])
    stages: gym.Env = env
    while not isinstance(stages, TaskStages):
        stages = stages.env  # type: ignore[attr-defined]
    for _ in range(AFTERWARDS):
        assert stages.step(here.actions[-1])[-1]["success_at_end"]
    env.close()
