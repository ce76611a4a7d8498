"""Every adversary does its deed, keeps to the arms that it may use, and gets no more than it may."""

from __future__ import annotations

from functools import lru_cache
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from duobench.tasks import catalog
from duobench.types import SIDES
from tests.adversaries.adversary import Adversary, Hands
from tests.stageplay import Stageplay

TASKS = sorted(
    path.stem for path in Path(__file__).parent.glob("*.py") if path.stem in catalog.NAMES
)


def adversaries(task: str) -> tuple[Adversary, ...]:
    return import_module(f"tests.adversaries.{task}").ADVERSARIES


@lru_cache(maxsize=2)
def bench_of(task: str) -> Stageplay:
    return Stageplay(catalog.get(task))


CASES = [
    pytest.param(task, one, id=f"{task}: {one.name}") for task in TASKS for one in adversaries(task)
]


@pytest.mark.parametrize(("task", "adversary"), CASES)
def test_an_adversary_gets_no_more_than_it_may(task: str, adversary: Adversary) -> None:
    bench = bench_of(task)
    bench.start(adversary.seed)
    start = bench.sim.duo.command().joints
    moved, together, done = set(), 0, False
    objects = [
        body
        for prop in bench.sim.props.values()
        for body in (prop.name, *map(prop.part_name, (p.name for p in prop.parts)))
    ]
    touchable = [body for body in objects if body in bench.sim.contacts.owners]
    for _ in bench.steps(adversary.script, then=adversary.settle):
        done = done or adversary.deed(bench.sim)
        command = bench.sim.duo.command()
        moved |= {side for side in SIDES if np.any(command.joints[side.index] != start[side.index])}
        hands = [
            any(bench.sim.contacts.gripper(side, body) for body in touchable) for side in SIDES
        ]
        together += all(hands)
    assert done, "the adversary did not do what it is meant to do"
    assert bench.stage == adversary.gets
    if adversary.hands is Hands.ONE:
        assert len(moved) <= 1
    if adversary.hands is Hands.TURNS:
        assert together == 0


@pytest.mark.parametrize("task", catalog.NAMES)
def test_every_task_has_adversaries(task: str) -> None:
    hands = {one.hands for one in adversaries(task)}
    assert len(adversaries(task)) >= 1
    if catalog.get(task).category != "parallel execution":
        assert {Hands.ONE, Hands.TURNS} <= hands
