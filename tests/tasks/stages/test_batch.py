"""The judge of many episodes knows at every step what the judge of one knows."""

from __future__ import annotations

import random
from collections.abc import Iterable
from functools import cache
from typing import Any

import numpy as np
import pytest

from duobench.tasks import catalog
from duobench.tasks.stages.batch import ProgressBatch
from duobench.tasks.stages.logic import Predicate, all_of, any_of, held_for, since
from duobench.tasks.stages.predicates import at_least
from duobench.tasks.stages.progress import Progress, Stage
from duobench.world.objects.blocks import RED, cube
from duobench.world.objects.prop import Prop
from duobench.world.sim.simulation import Simulation
from duobench.world.sim.thread_batch import ThreadBatch
from tests.task_harness import TaskHarness
from tests.tasks.experts.baseline_episodes import baseline
from tests.tasks.stages.batched import Judged, mismatches
from tests.ways.play import control_steps, ways_of
from tests.ways.way import Way, WayFailedError

COUNT, STEPS = 24, 60


@pytest.mark.parametrize("task", catalog.names())
def test_golden_episodes_are_judged_the_same(task: str) -> None:
    episodes = [
        Judged(
            variants=dict(episode.states[0].layout.variants),
            physics=[state.physics for state in episode.states],
            progress=[state.progress for state in episode.states if state.progress is not None],
        )
        for episode in baseline(task)
    ]
    assert mismatches(catalog.get(task), episodes) == []


def judged(bench: TaskHarness, way: Way) -> Judged:
    """A way's first episode, whether its deed is done or not."""
    layout = bench.start(way.seed)
    physics, progress = [bench.sim.get_state()], [bench.progress.get_state()]
    try:
        for _ in control_steps(bench, way, way.seed):
            physics.append(bench.sim.get_state())
            progress.append(bench.progress.get_state())
    except WayFailedError:
        pass
    return Judged(variants=dict(layout.variants), physics=physics, progress=progress)


def check_ways(task: str, ways: Iterable[Way]) -> None:
    bench = TaskHarness(catalog.get(task))
    assert mismatches(bench.task, [judged(bench, way) for way in ways]) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    "task",
    [
        pytest.param(name, marks=[pytest.mark.long] * (name != "bin_sort"))
        for name in catalog.names()
    ],
)
def test_adversaries_are_judged_the_same(task: str) -> None:
    check_ways(task, ways_of(task).ADVERSARIES.values())


@pytest.mark.long
@pytest.mark.parametrize("task", catalog.names())
def test_sincere_ways_are_judged_the_same(task: str) -> None:
    check_ways(task, ways_of(task).SINCERE.values())


class Facts:
    """Facts of many episodes that change at random, and questions made of them."""

    def __init__(self, seed: int) -> None:
        self.sampler = random.Random(seed)
        self.world: int | None = None
        """Which episode is asked about; None is all of them."""
        self.now: dict[str, Any] = {}
        self.facts = [self.fact(name, vectorized=name in "abc") for name in "abcde"]

    def fact(self, name: str, *, vectorized: bool) -> Predicate:
        def test(state: Any) -> Any:
            if vectorized and self.world is None:
                return self.now[name]
            # One by one, a fact is asked of the simulation that shows which episode it is.
            world = round(float(state.simulation.data.time)) if self.world is None else self.world
            return bool(self.now[name][world])

        return Predicate(name, test, vectorized=vectorized)

    def question(self, depth: int) -> Predicate:
        choose = self.sampler
        if depth == 0:
            return choose.choice(self.facts)
        parts = [self.question(depth - 1) for _ in range(3)]
        one, other, third = parts
        return choose.choice(
            [
                lambda: ~one,
                lambda: all_of(*parts),
                lambda: any_of(*parts),
                lambda: all_of(one, any_of(~other, third)),
                lambda: at_least(2, *parts),
                lambda: since(one, reset=choose.choice([None, other])),
                lambda: held_for(
                    one, choose.choice([0.1, 0.2]), reset=choose.choice([None, other])
                ),
                lambda: one.called("in other words"),
            ]
        )()


@cache
def empty_batch() -> tuple[Simulation, ThreadBatch]:
    sim = Simulation([Prop(name="cube", solid=cube(RED))])
    batch = ThreadBatch(sim, COUNT, 1)
    states = []
    for world in range(COUNT):
        sim.data.time = world
        states.append(sim.get_state())
    batch.load(np.arange(COUNT), [{}] * COUNT, states)
    return sim, batch


@pytest.mark.parametrize("seed", range(25))
def test_whatever_stages_are_made_of_is_judged_the_same(seed: int) -> None:
    facts = Facts(seed)
    stages = tuple(
        Stage(
            name=str(number),
            instruction="Do it.",
            holds=facts.question(3),
            stays=facts.question(2) if number % 2 else None,
        )
        for number in range(3)
    )
    sim, batch = empty_batch()
    alone = [Progress(stages) for _ in range(COUNT)]
    together = ProgressBatch(stages, batch)
    for number, progress in enumerate(alone):
        progress.reset(sim, {})
        together.set_state(number, progress.get_state())
    rng = np.random.default_rng(seed)
    for _ in range(STEPS):
        facts.now = {name: rng.random(COUNT) < 0.6 for name in "abcde"}
        where = rng.random(COUNT) < 0.8  # some of them do not move
        facts.world = None
        together.update(where)
        for number in np.flatnonzero(where).tolist():
            facts.world = number
            alone[number].update(sim)
        assert [together.get_state(n) for n in range(COUNT)] == [p.get_state() for p in alone]
        assert together.standing.tolist() == [progress.standing for progress in alone]


def test_combinations_of_nothing_are_judged_the_same() -> None:
    sim, batch = empty_batch()
    stages = [Stage(name=p.name, instruction="Do it.", holds=p) for p in (all_of(), any_of())]
    alone, together = Progress(tuple(stages)), ProgressBatch(tuple(stages), batch)
    alone.reset(sim, {})
    for number in range(COUNT):
        together.set_state(number, alone.get_state())
    together.update(np.ones(COUNT, dtype=np.bool_))
    assert alone.update(sim) == 1
    assert [together.get_state(n) for n in range(COUNT)] == [alone.get_state()] * COUNT
