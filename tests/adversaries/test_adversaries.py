"""Adversaries do their deed, keep to the arms that they may use, and get no more than they may."""

from __future__ import annotations

from functools import lru_cache
from importlib import import_module

import numpy as np
import pytest

from duobench.sim.simulation import Simulation
from duobench.tasks import catalog
from duobench.tasks.task import Category
from duobench.types import SIDES, Side
from tests.adversaries.adversary import Adversary, Hands
from tests.task_harness import TaskHarness

TRIES = 6
"""Seeds that are tried until the deed is done: a deed may fail by physics, but not on all."""
MOVED = 1e-3
"""Change of a commanded joint (radians) or opening by which an arm was told to move."""


def adversaries(task: str) -> tuple[Adversary, ...]:
    return import_module(f"tests.adversaries.{task}").ADVERSARIES


@lru_cache(maxsize=2)
def bench_of(task: str) -> TaskHarness:
    return TaskHarness(catalog.get(task))


def hands_on(sim: Simulation) -> set[Side]:
    """The sides whose grippers touch an object."""
    objects = [
        body
        for prop in sim.props.values()
        for body in (prop.name, *(prop.part_name(part.name) for part in prop.parts))
        if body in sim.contacts.owners
    ]
    return {side for side in SIDES if any(sim.contacts.gripper(side, body) for body in objects)}


CASES = [
    pytest.param(task, adversary, id=f"{task}: {adversary.name}")
    for task in catalog.names()
    for adversary in adversaries(task)
]


@pytest.mark.parametrize(("task", "adversary"), CASES)
def test_an_adversary_gets_no_more_than_it_may(task: str, adversary: Adversary) -> None:
    bench = bench_of(task)
    for seed in range(adversary.seed, adversary.seed + TRIES):
        if play(bench, adversary, seed):
            assert bench.stage == adversary.gets
            check_words(bench.progress.unmet, adversary.lacks)
            return
        assert bench.stage <= adversary.gets
    pytest.fail(f"the adversary did what it is meant to do on none of {TRIES} seeds")


def play(bench: TaskHarness, adversary: Adversary, seed: int) -> bool:
    """Play an adversary, check that it keeps to its arms, and return whether its deed was done."""
    bench.start(seed)
    bench.progress.explain()
    start = bench.sim.duo.command().flat.reshape(len(SIDES), -1)
    done, together, moved = False, False, set[Side]()
    for _ in bench.steps(adversary.script, then=adversary.settle):
        done = done or adversary.deed(bench.sim)
        together = together or len(hands_on(bench.sim)) > 1
        now = bench.sim.duo.command().flat.reshape(len(SIDES), -1)
        moved |= {side for side in SIDES if np.abs(now - start)[side.index].max() > MOVED}
    if adversary.hands is Hands.ONE:
        assert len(moved) == 1
    if adversary.hands is Hands.TURNS:
        assert len(moved) > 1
        assert not together
    return done


def check_words(unmet: tuple[str, ...], expected: str) -> None:
    """It is said why the next stage was not reached, in words and not as a formula."""
    assert unmet
    assert any(expected in reason for reason in unmet), unmet
    for reason in unmet:
        assert not any(sign in reason for sign in ("((", "since ")), reason


@pytest.mark.parametrize("task", catalog.names())
def test_every_task_has_adversaries(task: str) -> None:
    hands = {one.hands for one in adversaries(task)}
    assert hands
    if catalog.get(task).category is not Category.PARALLEL_EXECUTION:
        assert {Hands.ONE, Hands.TURNS} <= hands
