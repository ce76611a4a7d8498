"""The rule: stages never fall, jumps are allowed, and memory is of earlier steps only."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from duobench.core.errors import TaskError
from duobench.core.spatial import SE3
from duobench.core.types import CONTROL_HZ, SIDES
from duobench.tasks.stages.logic import (
    AllOf,
    Predicate,
    StateView,
    all_of,
    any_of,
    held_for,
    since,
)
from duobench.tasks.stages.predicates import (
    at_least,
    grasped,
    raised,
    released,
    touching,
    variant,
)
from duobench.tasks.stages.progress import LOST_SECONDS, Progress, Stage, check_names
from duobench.world.robot.frames import ROBOT
from duobench.world.scene.naming import TABLE
from duobench.world.sim.simulation import Simulation
from tests.tasks.stages.bench import Bench


def reference(steps: tuple[str, ...], letters: str) -> list[int]:
    """The rule of the paper, word for word."""
    stages, stage = [], 0
    for step in steps:
        stage = max({stage} | {k for k, letter in enumerate(letters, 1) if letter in step})
        stages.append(stage)
    return stages


STEPS = ["", "a", "b", "c", "ab", "ac", "bc", "abc"]


def test_the_rule_of_the_paper(bench: Bench) -> None:
    for played in itertools.product(STEPS, repeat=3):
        progress = bench.begin(*map(bench.fact, "abc"))
        for now, step in enumerate(played, 1):
            assert bench.play(progress, step) == reference(played[:now], "abc")[-1:], played
            assert progress.final_holds == ("c" in step)
            assert progress.success == any("c" in earlier for earlier in played[:now])
        assert progress.max_stage == 3


def test_a_reset_forgets(bench: Bench) -> None:
    progress = bench.begin(bench.fact("a"), bench.fact("b") & since(bench.fact("a")))
    bench.play(progress, "a", "b")
    assert progress.success
    progress.reset(bench.sim, {})
    assert (progress.stage, progress.success, progress.final_holds) == (0, False, False)
    assert bench.play(progress, "b") == [0]


# --- memory --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("steps", "ever", "never"),
    [
        (["ab"], [0], [1]),  # not the same step
        (["ab", "b"], [0, 1], [1, 1]),  # it counts from the next one on
        (["a", "b"], [0, 1], [0, 0]),
        (["b", "b"], [0, 0], [1, 1]),
    ],
)
def test_ever_means_an_earlier_step(
    bench: Bench, steps: list[str], ever: list[int], never: list[int]
) -> None:
    a, b = bench.fact("a"), bench.fact("b")
    assert bench.play(bench.begin(b & since(a)), *steps) == ever
    assert bench.play(bench.begin(b & ~since(a)), *steps) == never


@pytest.mark.parametrize(
    ("steps", "stages"),
    [
        (["a", "b", "c"], [0, 0, 1]),
        (["b", "a", "c"], [0, 0, 0]),
        (["a", "bc", ""], [0, 0, 0]),  # c came with b
        (["ab", "c", "c"], [0, 0, 0]),  # b came with a
        (["ab", "b", "c"], [0, 0, 1]),
        (["a", "", "b", "", "c"], [0, 0, 0, 0, 1]),
    ],
)
def test_nested_memories_see_events_in_order(
    bench: Bench, steps: list[str], stages: list[int]
) -> None:
    a, b, c = map(bench.fact, "abc")
    assert bench.play(bench.begin(c & since(b & since(a))), *steps) == stages


def test_four_events_in_a_row(bench: Bench) -> None:
    a, b, c, d = map(bench.fact, "abcd")
    ordered = d & since(c & since(b & since(a)))
    for order in itertools.permutations("abcd"):
        expected = 1 if order == ("a", "b", "c", "d") else 0
        assert bench.play(bench.begin(ordered), *order)[-1] == expected, order


def test_memories_are_found_wherever_they_are_written(bench: Bench) -> None:
    a, b = bench.fact("a"), bench.fact("b")
    for constraint in (b & (b | since(a)) & since(a), b & ~~since(a), since(a) & b):
        assert bench.play(bench.begin(constraint), "b", "a", "b") == [0, 0, 1]


def test_a_step_is_judged_the_same_whatever_the_step_before_was_judged_by(bench: Bench) -> None:
    a, b, c, d = map(bench.fact, "abcd")
    long = held_for(a | b, 0.1)
    summed = held_for(b & ~c, 0.15, reset=c & d)
    told = since(a & long, reset=d & held_for(~a, 0.05))
    mixed = Predicate("d or for long", lambda state: long.ask(state) or "d" in bench.true, (long,))
    constraints = (c & d & long & ~told, mixed & summed & told, at_least(2, a, mixed, told) & ~b)
    stages = tuple(
        Stage(name=str(number), instruction="", holds=holds, stays=mixed | ~holds)
        for number, holds in enumerate(constraints)
    )
    rng = np.random.default_rng(0)
    for _ in range(20):
        progress, other = Progress(stages), Progress(stages)
        progress.reset(bench.sim, {})
        facts = set[str]()
        for _ in range(200):
            facts ^= {letter for letter in "abcd" if rng.random() < 0.1}
            bench.true = set(facts)
            other.set_state(progress.get_state(), {})  # and so forgets every earlier step
            bench.asked.clear()
            progress.update(bench.sim)
            assert len(bench.asked) == len(set(bench.asked))
            other.update(bench.sim)
            assert progress.get_state() == other.get_state()


def test_what_combines_is_asked_anew_only_where_something_looks_different(bench: Bench) -> None:
    a, b = bench.fact("a"), bench.fact("b")
    asked: list[str] = []

    def both(state: StateView) -> bool:
        asked.append("both")
        return a.ask(state) and b.ask(state)

    progress = bench.begin(AllOf("a and b", both, (a, b), looks=False))
    bench.play(progress, "", "b", "", "a", "a", "a")
    assert len(asked) == 2
    assert bench.asked == ["a"] * 3 + ["a", "b"] * 3
    progress.set_state(progress.get_state(), {})
    bench.play(progress, "a")
    assert len(asked) == 3


def test_what_flickers_is_judged_as_it_was_the_last_time(bench: Bench) -> None:
    a, b = bench.fact("a"), bench.fact("b")
    asked: list[str] = []

    def either(state: StateView) -> bool:
        asked.append("either")
        return a.ask(state) and b.ask(state)

    whole = AllOf("a and b", either, (a, b), looks=False)
    clocks = held_for(a, 0.1), held_for(b, 0.2, reset=a & b)
    progress = bench.begin(whole, clocks[0] & clocks[1])
    bench.play(progress, "a", "", "a", "", "", "a", "a", "")
    assert len(asked) == 2
    assert progress.get_state().lasted == (0, 0)
    bench.play(progress, "a", "a")
    assert progress.get_state().lasted == (2, 0)


def test_contacts_are_compared_before_anything_is_asked(sim: Simulation) -> None:
    asked: list[bool] = []

    def counted(predicate: Predicate) -> Predicate:
        def test(state: StateView) -> bool:
            asked.append(predicate.test(state))
            return asked[-1]

        return replace(predicate, test=test)

    lies = counted(touching("cube", TABLE))
    held = [counted(grasped(side, "cube")) for side in SIDES]
    free = counted(released("cube"))
    stages = (
        Stage(name="held", instruction="", holds=held[0] | (held[1] & lies)),
        Stage(name="up", instruction="", holds=held_for(~lies & free, 0.1) & ~free),
    )
    progress, other = Progress(stages), Progress(stages)
    sim.reset_data()
    progress.reset(sim, {})
    answers: list[int] = []
    for height in (0.016, 0.016, 0.3, 0.016, 0.3, 0.3, 0.3, 0.3, 0.016):
        sim.place("cube", SE3.at(0.5, 0.0, height))
        sim.forward()
        other.set_state(progress.get_state(), {})
        other.update(sim)
        asked.clear()
        progress.update(sim)
        answers.append(len(asked))
        assert progress.get_state() == other.get_state()
    assert answers[1] == answers[3] == answers[4] == 0
    assert answers[0] > 0


def test_poses_are_looked_at_after_memories_and_contacts(sim: Simulation) -> None:
    high, lies = raised("cube", 0.1), touching("cube", TABLE)
    sim.reset_data()
    sim.place("cube", SE3.at(0.5, 0.0, 0.016))
    sim.forward()
    for whole, holds in (
        (all_of(high, ~lies, ~since(high)), False),
        (any_of(high, lies, since(high)), True),
    ):
        assert whole.parts[0] is high, "words, memories and rewards keep to the task's order"
        state = StateView(
            simulation=sim, start_heights={"cube": 0.0}, variants={}, remembered=frozenset()
        )
        assert whole.ask(state) is holds
        assert list(state.answers) == [lies]
        assert since(high) in state.conclusions


def test_two_episodes_at_once_do_not_share_memory(bench: Bench) -> None:
    constraint = bench.fact("b") & since(bench.fact("a"))
    one, other = bench.begin(constraint), bench.begin(constraint)
    bench.play(one, "a")
    assert bench.play(other, "b") == [0]
    assert bench.play(one, "b") == [1]


def test_a_memory_that_is_certain_is_not_asked_again(bench: Bench) -> None:
    progress = bench.begin(bench.fact("z") & since(bench.fact("a")))
    bench.play(progress, "", "a", "", "")
    assert bench.asked.count("a") == 2


# --- held for a time -----------------------------------------------------------------------------


def test_held_for_needs_every_step_of_the_time_in_an_episode(bench: Bench) -> None:
    progress = bench.begin(held_for(bench.fact("a"), 0.1))
    assert bench.play(progress, "a", "a", "", "a", "a", "a") == [0, 0, 0, 0, 0, 1]
    progress.reset(bench.sim, {})
    bench.play(progress, "a", "a")
    progress.reset(bench.sim, {})
    assert bench.play(progress, "a", "a", "a") == [0, 0, 1]


def counting(bench: Bench, progress: Progress, *steps: str) -> str:
    """Whether a clock that is awaited has counted in each step, as letters."""
    found = ""
    for step in steps:
        before = progress.get_state()
        bench.play(progress, step)
        found += "+" if progress.counts_since(before) else "-"
    return found


def test_a_clock_counts_until_nothing_is_awaited_of_it(bench: Bench) -> None:
    a, b, c = map(bench.fact, "abc")
    progress = bench.begin(held_for(a, 0.1), held_for(b, 0.1, reset=c))
    assert counting(bench, progress, *("", "a", "a", "", "a", "a", "a", "a")) == "-++-++--"
    assert counting(bench, progress, *("b", "", "b", "c", "b", "b")) == "+-+-++"
    both = bench.begin(held_for(a, 0.1), held_for(a, 0.2))
    assert counting(bench, both, *["a"] * 8) == "+++++---", "the longer time is awaited still"


def test_what_may_soon_be_lost_counts(bench: Bench) -> None:
    progress = two_stages(bench)
    bench.play(progress, "ax")
    assert counting(bench, progress, *[""] * (LONG_LOST + 2)) == "+" * (LONG_LOST - 1) + "---"


# --- what is lost ---------------------------------------------------------------------------------


def standing_after(bench: Bench, progress: Progress, *steps: str) -> list[int]:
    found = []
    for step in steps:
        bench.play(progress, step)
        found.append(progress.standing)
    return found


def two_stages(bench: Bench) -> Progress:
    """Stage 1 is a, of which x must stay; 2 is b, of which y must; 3 is c."""
    a, b, c, x, y = map(bench.fact, "abcxy")
    stages = (
        Stage(name="a", instruction="do a", holds=a, stays=x),
        Stage(name="b", instruction="do b", holds=b, stays=y),
        Stage(name="c", instruction="do c", holds=c),
    )
    progress = Progress(stages)
    progress.reset(bench.sim, {})
    return progress


LONG_LOST = round(LOST_SECONDS * CONTROL_HZ)


def test_what_is_lost_for_long_is_to_be_done_again_and_the_stage_stays(bench: Bench) -> None:
    progress = two_stages(bench)
    assert standing_after(bench, progress, "", "ax", "bxy") == [0, 1, 2]
    assert standing_after(bench, progress, *["x"] * LONG_LOST) == [2] * (LONG_LOST - 1) + [1]
    assert progress.stage == 2
    assert standing_after(bench, progress, "xy") == [2], "it was done again"
    assert standing_after(bench, progress, *["y"] * LONG_LOST)[-1] == 0, "the lowest that is lost"


def test_what_is_back_in_time_was_never_lost(bench: Bench) -> None:
    progress = two_stages(bench)
    bench.play(progress, "ax")
    almost = [""] * (LONG_LOST - 1)
    assert standing_after(bench, progress, *almost, "x", *almost) == [1] * (2 * LONG_LOST - 1)


def test_a_stage_that_is_not_reached_cannot_be_lost(bench: Bench) -> None:
    progress = two_stages(bench)
    bench.play(progress, *["x"] * 2 * LONG_LOST)
    assert standing_after(bench, progress, "bx") == [2], "and stage 2 is not lost at once"


def test_what_is_lost_goes_with_the_state(bench: Bench) -> None:
    progress, other = two_stages(bench), two_stages(bench)
    bench.play(progress, "ax", *[""] * LONG_LOST)
    other.set_state(progress.get_state(), {})
    assert (other.stage, other.standing) == (1, 0)
    other.reset(bench.sim, {})
    assert (other.stage, other.standing) == (0, 0)


# --- what an episode brings along ----------------------------------------------------------------


def test_heights_count_from_the_start_of_the_episode(sim: Simulation) -> None:
    progress = Progress((Stage(name="up", instruction="up", holds=raised("cube", 0.03)),))
    sim.reset_data()
    for start in (0.016, 0.216):
        for height, stage in ((0.0, 0), (0.029, 0), (0.031, 1)):
            sim.place("cube", SE3.at(0.5, 0.0, start + height))
            sim.forward()
            if height == 0.0:
                progress.reset(sim, {})
            assert progress.update(sim) == stage


def test_variants_are_those_of_the_layout(bench: Bench) -> None:
    assert bench.play(bench.begin(variant("full", "left"), full="left"), "") == [1]
    assert bench.play(bench.begin(variant("full", "left"), full="right"), "") == [0]


def test_judging_changes_nothing_in_the_simulation(sim: Simulation) -> None:
    progress = Progress((Stage(name="up", instruction="up", holds=raised("cube", 0.03)),))
    progress.reset(sim, {})
    sim.step(ROBOT.home_command)
    before = sim.get_state().tobytes()
    progress.update(sim)
    assert sim.get_state().tobytes() == before


@pytest.mark.parametrize(
    "combined", [lambda p, q: p and q, lambda p, q: p or q, lambda p, _: not p]
)
def test_the_words_of_python_do_not_combine(
    bench: Bench, combined: Callable[[Predicate, Predicate], object]
) -> None:
    with pytest.raises(TaskError, match="neither true nor false"):
        combined(bench.fact("a"), bench.fact("b"))


def test_a_predicate_names_what_it_asks_and_must_remember(bench: Bench) -> None:
    was = since(bench.fact("a"))
    mine = Predicate("mine", was.__call__)
    stages = [Stage(name="one", instruction="do", holds=mine | bench.fact("b"))]
    with pytest.raises(TaskError, match="'mine' asks 'since a'"):
        check_names(stages, bench.sim, {}, {})
    check_names([replace(stages[0], holds=replace(mine, parts=(was,)))], bench.sim, {}, {})
    now = Predicate("now", bench.fact("a").__call__)  # which needs no memory
    check_names([replace(stages[0], holds=now)], bench.sim, {}, {})
