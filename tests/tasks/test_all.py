"""What holds for every task of the catalog."""

from __future__ import annotations

import inspect
import json
import re
from collections.abc import Iterator
from dataclasses import replace
from importlib import import_module
from itertools import product

import gymnasium as gym
import pytest

import duobench
from duobench.core.errors import UnknownNameError
from duobench.core.types import SIDES
from duobench.envs.registration import NAMESPACE, env_id
from duobench.tasks import catalog
from duobench.tasks.stages.predicates import STILL_ANGULAR_SPEED, STILL_SPEED
from duobench.tasks.stages.progress import check_names
from duobench.tasks.task import Task
from duobench.world.scene.naming import TABLE
from duobench.world.sim.placement import REACH_X, REACH_Y
from duobench.world.sim.simulation import Simulation
from tests.envs.tools import sim_of

SEEDS = range(5)
HEADINGS = ("Task:", "Randomization:", "Success:")
MAX_SETTLING, MAX_SETTLING_TURN = 0.001, 0.01
"""How far an object may move while it settles, in metres and radians."""
MAX_DEPTH = 0.0005
"""Deepest contact after it, in metres."""
PARAPHRASES, KEPT = 10, 3
"""Paraphrases of a task's instruction, and those that are kept out of demonstrations."""
MAX_COMMON = 0.4
"""Share of words that one of these and one of those may have in common."""
CONTAINERS = {"pour_marbles": {"left_cup", "right_cup"}, "ball_maze": {"board"}}
"""What an episode begins with something in; everything else stands on the table, by itself."""


@pytest.fixture(scope="module", params=catalog.names())
def task(request: pytest.FixtureRequest) -> Task:
    return catalog.get(request.param)


@pytest.fixture(scope="module")
def env(task: Task) -> Iterator[gym.Env]:
    env = duobench.make(task.id, cameras=False)
    yield env
    env.close()


@pytest.fixture
def sim(env: gym.Env) -> Simulation:
    return sim_of(env).simulation


def test_a_task_says_what_it_is(task: Task) -> None:
    docstring = inspect.getdoc(import_module(f"duobench.tasks.{task.id}")) or ""
    places = [docstring.find(f"\n{heading}\n    ") for heading in HEADINGS]
    assert -1 not in places, f"the docstring needs the headings {HEADINGS}, each with a text"
    assert places == sorted(places)


def test_stages_have_names_and_instructions_of_their_own(task: Task) -> None:
    for told in ([s.name for s in task.stages], [s.instruction for s in task.stages]):
        assert len(set(told)) == len(told)
        assert all(text == text.strip() != "" for text in told)
    assert all(stage.instruction.endswith(".") for stage in task.stages)


def test_instructions_leave_no_variant_open(task: Task) -> None:
    drawn: dict[str, set[str]] = {name: set() for name in task.variants}
    for seed in range(60):
        layout = next(task.layouts(seed))
        assert layout.variants.keys() >= task.variants.keys()
        numbers = range(len(task.instructions))
        texts = [task.instruct(layout, number) for number in numbers]
        texts += task.subinstructions(layout).values()
        assert not any("{" in text or "}" in text for text in texts)
        for name, values in drawn.items():
            values.add(layout.variants[name])
    for name, choice in task.variants.items():
        assert drawn[name] == set(choice.options), f"60 seeds do not draw every {name}"


def _words(text: str) -> set[str]:
    return set(re.findall(r"\w+", text.lower()))


def test_instructions_come_in_other_words_and_some_are_kept(task: Task) -> None:
    varied, kept = task.instructions, task.kept_paraphrases
    assert (len(varied), len(kept)) == (1 + PARAPHRASES, KEPT)
    everything = [*varied, *kept]
    assert len({tuple(re.findall(r"\w+", text.lower())) for text in everything}) == len(everything)
    for text in everything:
        assert set(re.findall("{.*?}", text)) == set(re.findall("{.*?}", task.instruction)), text
        assert re.fullmatch(r"[A-Z][^.]*\.", text), "one sentence"
        assert 5 <= len(text.split()) <= 40, text
    for text, other in product(kept, varied):
        common = len(_words(text) & _words(other)) / len(_words(text) | _words(other))
        assert common < MAX_COMMON, f"{common:.2f}: {text} / {other}"


def test_the_stages_name_every_object_and_a_misspelt_one_is_an_error(task: Task) -> None:
    """One object at a time is called something else than what the stages call it."""
    variants = next(task.layouts(0)).variants
    for number, prop in enumerate(task.props):
        props = list(task.props)
        props[number] = replace(prop, name=f"{prop.name}x")
        with pytest.raises(UnknownNameError, match=rf"'{prop.name}.*Did you mean .*'{prop.name}x"):
            check_names(task.stages, Simulation(props), variants, {})


def test_a_reset_leaves_everything_apart_within_reach_and_at_rest(
    env: gym.Env, sim: Simulation, task: Task
) -> None:
    containers = CONTAINERS.get(task.id, set())
    for seed in SEEDS:
        env.reset(seed=seed)
        layout = sim_of(env).layout
        assert sim.contacts.deepest(MAX_DEPTH) == []
        for name, prop in sim.props.items():
            parts = {name, *(prop.part_name(part.name) for part in prop.parts)}
            for part in parts & set(sim.contacts.owners) - containers:
                assert sim.contacts.partners(part) <= {TABLE} | containers, part
            speed, turn = sim.speed(name)
            assert speed < STILL_SPEED, name
            assert turn < STILL_ANGULAR_SPEED, name
            moved, turned = sim.pose(name).distance(layout.poses[name])
            assert moved < MAX_SETTLING, f"{name} moved by {moved:.4f} m while it settled"
            assert turned < MAX_SETTLING_TURN, name
            if not prop.fixed:
                x, y, z = sim.position(name)
                assert REACH_X[0] <= x <= REACH_X[1], name
                assert REACH_Y[0] <= y <= REACH_Y[1], name
                assert z > -0.001, name
        for container in containers & set(sim.contacts.owners):
            robot = tuple(f"{side}/" for side in SIDES)
            assert not any(owner.startswith(robot) for owner in sim.contacts.partners(container))
        assert sim.data.time == 0.0


def test_a_given_layout_begins_the_same_episode(env: gym.Env) -> None:
    for seed in (0, 1, 2):
        _, info = env.reset(seed=seed)
        before = sim_of(env).state_hash()
        text = json.dumps(info["layout"])
        _, again = env.reset(seed=seed + 100, options={"layout": json.loads(text)})
        assert sim_of(env).state_hash() == before
        assert again["seed"] is None
        assert again["layout"] == info["layout"]
        assert again["instruction"] == info["instruction"]


def test_a_task_is_found_by_id_and_by_path() -> None:
    assert catalog.get("bin_sort") is catalog.get("duobench.tasks.bin_sort:TASK")


def test_the_id_of_an_environment_names_its_task_too(task: Task) -> None:
    for spelling in (task.id, env_id(task.id), f"{NAMESPACE}:{env_id(task.id)}"):
        assert catalog.plain(spelling) == task.id
    assert catalog.plain("mine:TASK") == "mine:TASK"
