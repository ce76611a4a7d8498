"""What an episode's policy is told: the task's instruction, another one, or a sampled one."""

from dataclasses import replace
from typing import Any

import pytest

from duobench.core.errors import OptionError
from duobench.tasks import catalog
from duobench.world.sim.layout import Layout
from tests.envs.tools import Make, sim_of, wave

TASK = catalog.get("pour_marbles")  # its instructions name variants
SEEDS = range(12)


def told(env: Any, seed: int, **options: Any) -> str:
    _, info = env.reset(seed=seed, options=options)
    assert info["instruction"] == env.task_description
    return info["instruction"]


def test_a_reset_may_choose_what_its_episode_is_about_and_a_state_keeps_it(make: Make) -> None:
    env = make(TASK)
    own = told(env, 0)
    before = env.state_hash()
    third = TASK.instruct(sim_of(env).layout, 3)
    assert told(env, 0, instruction=3) == third != own
    assert told(env, 0, instruction="Pour, {please}!") == "Pour, {please}!", "text is literal"
    assert env.state_hash() == before, "words move nothing"
    state = env.save_state()
    assert told(env, 0) == own
    _, info = env.restore_state(state)
    assert info["instruction"] == env.step(wave(0))[-1]["instruction"] == "Pour, {please}!"
    _, info = env.restore_state(replace(state, instruction=None))
    assert info["instruction"] == own


def test_instructions_that_vary_are_sampled_by_the_seed(make: Make) -> None:
    env, fixed = (make(TASK, instructions=kind) for kind in ("varied", "fixed"))
    texts = [told(env, seed) for seed in SEEDS]
    assert len(set(texts)) > len(SEEDS) / 3
    assert [told(env, seed) for seed in reversed(SEEDS)] == texts[::-1]
    assert [told(env, seed, split="train") for seed in SEEDS] != texts
    for seed, text in zip(SEEDS, texts, strict=True):
        layout = Layout.from_json(fixed.reset(seed=seed)[1]["layout"])
        assert text in {TASK.instruct(layout, number) for number in range(11)}
    assert told(env, 3, instruction=0) == told(fixed, 3)
    assert told(env, 3, layout=sim_of(fixed).layout) == told(fixed, 3), "no seed, nothing sampled"


def test_a_task_without_paraphrases_has_none_to_vary(make: Make) -> None:
    with pytest.raises(OptionError, match=r"'pour_marbles' has no paraphrases.*`paraphrases`"):
        make(replace(TASK, paraphrases=()), instructions="varied")
