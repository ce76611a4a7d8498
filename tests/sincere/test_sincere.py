"""What a person would call done counts, whichever way it was done."""

from __future__ import annotations

from functools import lru_cache

import pytest

from duobench.tasks import catalog
from tests.sincere.play import play, ways_of
from tests.sincere.sincere import Way
from tests.task_harness import TaskHarness, marked

TRIES = 6
"""Seeds that are tried until the task is done: a way may fail by physics, but not on all."""


@lru_cache(maxsize=2)
def bench_of(task: str) -> TaskHarness:
    return TaskHarness(catalog.get(task))


CASES = [
    marked(task, way, name=f"{task}: {way.name}")
    for task in catalog.names()
    for way in ways_of(task).WAYS
]


@pytest.mark.parametrize(("task", "way"), CASES)
def test_what_is_done_counts(task: str, way: Way) -> None:
    bench = bench_of(task)
    for seed in range(way.seed, way.seed + TRIES):
        judgement = play(bench, way, seed)
        if judgement.done:
            assert judgement.stage == catalog.get(task).max_stage
            return
    pytest.fail(f"the task was done on none of {TRIES} seeds")
