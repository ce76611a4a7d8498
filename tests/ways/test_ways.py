"""What a person would call done counts, whichever way it was done; adversaries do their deed, keep
to the arms that they may use, and get no more than they may.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from typing import Any

import pytest

from duobench.tasks import catalog
from duobench.tasks.task import Category
from duobench.world.robot.frames import robot_with
from duobench.world.robot.gripper import DEFAULT_GRIPPER
from tests.task_harness import TaskHarness, marked
from tests.ways.play import play, ways_of
from tests.ways.way import Hands, Way

TRIES = 6
"""Seeds that are tried until the deed is done: it may fail by physics, but not on all."""
SEEDS, MOST = range(5), 4
"""Seeds of layouts on which some ways are all tried, and of how many the deed is done at least."""
USUAL, OFTEN_PLAYED = 3, 4
"""Adversaries and sincere ways of a task that `make test` plays, and that CI does; the others are
long."""
OFTEN = {
    "ball_maze": ("put down", "loses its grip", "loosens"),
    "block_balance": ("hops", "raised, and put on again"),
    "carry_pot": ("slipped", "then both lift it"),
    "hinge_chest": (
        "waits below it",
        "stays right below",
        "hovers",
        "pinches",
        "straight down, its camera aside",
        "lies on the hand",
    ),
    "spring_door": ("pulls it shut", "presses it shut", "at the back of the floor", "to 0.92 rad"),
}
"""Parts of the names of those, by task."""


HAND = {
    "ball_maze": "both arms begin, one goes on alone",
    "bin_sort": "and grasped where they lie",
    "block_balance": "a balance held by a gripper",
    "carry_pot": "both let go 2 cm above the plate",
    "hinge_chest": "presses it shut by 0.40 rad",
    "join_blocks": "joined, pulled apart",
    "pour_marbles": "put down beside their squares",
    "spring_door": "pulls it shut by 0.10 rad",
    "transfer_cube": "handed back",
    "transfer_gate": "and is pinched there",
    "transfer_reorient": "and is pinched there",
}
"""Part of the name of an adversary that does its deed with the Franka Hand too, by task."""


@lru_cache(maxsize=2)
def bench_of(task: str, gripper: str = DEFAULT_GRIPPER) -> TaskHarness:
    return TaskHarness(catalog.get(task), robot_with(gripper))


def marks_at(place: int) -> tuple[pytest.MarkDecorator, ...]:
    if place < USUAL:
        return ()
    return (pytest.mark.slow if place < OFTEN_PLAYED else pytest.mark.long,)


def cases() -> Iterator[Any]:
    """Every way of every task; those beyond the first few of a task are slow."""
    for task in catalog.names():
        ways = ways_of(task)
        for place, (name, way) in enumerate(ways.ADVERSARIES.items()):
            marks = marks_at(place)
            yield pytest.param(task, way, id=f"{task}: {name}", marks=marks)
        for place, (name, way) in enumerate(ways.SINCERE.items()):
            case = marked(task, way, name=f"{task}: {name}")
            marks = marks_at(place)
            yield pytest.param(task, way, id=case.id, marks=(*case.marks, *marks))


@pytest.mark.parametrize(("task", "way"), list(cases()))
def test_a_way_gets_what_it_deserves(task: str, way: Way) -> None:
    check_way(bench_of(task), way)


@pytest.mark.long
@pytest.mark.parametrize("task", HAND)
def test_an_adversary_gets_no_more_with_another_gripper(task: str) -> None:
    named = ways_of(task).ADVERSARIES.items()
    way = next(way for name, way in named if HAND[task] in name)
    slowness = 2 if task == "transfer_reorient" else 1  # faster, the peg swivels in the hand
    check_way(bench_of(task, "franka_hand"), replace(way, lacks="", slowness=slowness))


def check_way(bench: TaskHarness, way: Way) -> None:
    gets = bench.task.max_stage if way.gets is None else way.gets
    for seed in range(way.seed, way.seed + TRIES):
        played = play(bench, way, seed)
        if way.hands is Hands.ONE:
            assert len(played.moved) == 1
        if way.hands is Hands.TURNS:
            assert len(played.moved) > 1
            assert not played.together
        if played.done:
            assert played.stage == gets
            if way.gets is not None:
                check_words(bench.progress.unmet, way.lacks)
            return
        assert played.stage <= gets
    pytest.fail(f"the deed was done on none of {TRIES} seeds")


@pytest.mark.long
@pytest.mark.parametrize(
    ("task", "way"),
    [
        pytest.param(task, way, id=f"{task}: {name}")
        for task, parts in OFTEN.items()
        for name, way in (ways_of(task).ADVERSARIES | ways_of(task).SINCERE).items()
        if any(part in name for part in parts)
    ],
)
def test_a_way_gets_the_same_on_every_seed(task: str, way: Way) -> None:
    bench = bench_of(task)
    gets = bench.task.max_stage if way.gets is None else way.gets
    played = [judgement for seed in SEEDS if (judgement := play(bench, way, seed)).done]
    assert [judgement.stage for judgement in played] == [gets] * len(played)
    assert len(played) >= MOST


def check_words(unmet: tuple[str, ...], expected: str) -> None:
    """It is said why the next stage was not reached, in words and not as a formula."""
    assert unmet
    assert any(expected in reason for reason in unmet), unmet
    for reason in unmet:
        assert not any(sign in reason for sign in ("((", "since ")), reason


@pytest.mark.parametrize("task", catalog.names())
def test_every_task_has_adversaries(task: str) -> None:
    hands = {way.hands for way in ways_of(task).ADVERSARIES.values()}
    assert hands
    if catalog.get(task).category is not Category.PARALLEL_EXECUTION:
        assert {Hands.ONE, Hands.TURNS} <= hands
