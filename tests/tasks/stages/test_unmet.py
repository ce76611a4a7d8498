"""What an episode says about why its next stage is not reached."""

from __future__ import annotations

import pytest

from duobench.core.spatial import SE3
from duobench.core.types import CONTROL_HZ
from duobench.tasks.stages.logic import Predicate, any_of, held_for, since
from duobench.tasks.stages.predicates import at_least, raised, variant
from duobench.tasks.stages.progress import Progress, Stage
from duobench.world.sim.simulation import Simulation
from tests.tasks.stages.bench import Bench

Facts = dict[str, Predicate]


@pytest.fixture
def facts(bench: Bench) -> Facts:
    """Letters that say what is so where they do not hold."""
    return {
        letter: Predicate(letter, bench.fact(letter).test, otherwise=lambda _s, n=letter: f"no {n}")
        for letter in "abcd"
    }


def why(bench: Bench, constraint: Predicate, *steps: str, **variants: str) -> tuple[str, ...]:
    """What is said after these steps; a step is the facts that hold, one letter each."""
    progress = bench.begin(constraint, **variants)
    progress.explain()
    bench.play(progress, *steps)
    return progress.unmet


# --- logic ---------------------------------------------------------------------------------------


def test_a_conjunction_names_only_what_does_not_hold(bench: Bench, facts: Facts) -> None:
    a, b, c = (facts[letter] for letter in "abc")
    assert why(bench, (a & b).called("both") & (b & c), "c") == ("no a", "no b")
    assert why(bench, a & ~b & ~(b & c), "abc") == ("b", "(b and c)")
    assert why(bench, a & b, "ab") == ()


def test_a_disjunction_says_that_none_holds_and_what_all_lack(bench: Bench, facts: Facts) -> None:
    a, b, c, d = (facts[letter] for letter in "abcd")
    assert why(bench, a | (b | c), "") == ("neither a nor b nor c",)
    either = (a & b).called("left") | (a & c).called("right")
    assert why(bench, either, "") == ("no a", "neither left nor right")
    assert why(bench, either, "b") == ("no a",), "the left one lacks nothing else"
    assert why(bench, either & d, "a") == ("neither left nor right", "no d")
    assert why(bench, ~(a | b), "b") == ("b",)


def test_what_the_layout_rules_out_is_no_alternative(bench: Bench, facts: Facts) -> None:
    chosen = any_of(variant("full", "left") & facts["a"], variant("full", "right") & facts["b"])
    assert why(bench, chosen, "", full="right") == ("no b",)
    assert why(bench, variant("full", "left"), "", full="right") == ("full is right, not left",)


def test_a_predicate_without_words_of_its_own_is_named(bench: Bench) -> None:
    assert why(bench, bench.fact("a"), "") == ("it is not so that a",)
    count = at_least(2, *map(bench.fact, "abc"))
    assert why(bench, count, "b") == ("it is not so that at least 2 of (a, b, c)",)


# --- memory --------------------------------------------------------------------------------------


def test_held_for_says_what_is_missing_or_for_how_long_it_held(bench: Bench, facts: Facts) -> None:
    lasting = held_for(facts["a"], 0.5)
    assert why(bench, lasting, "a", "") == ("no a",)
    steps = ["", *["a"] * 6]
    assert why(bench, lasting, *steps) == (f"only for {6 / CONTROL_HZ:.2f} s, not for 0.5 s: a",)


def test_since_says_what_was_never_so_or_what_undid_it(bench: Bench, facts: Facts) -> None:
    kept = facts["d"] & since(facts["a"], reset=facts["b"])
    assert why(bench, kept, "d", "d") == ("not so far: a",)
    assert why(bench, kept, "a", "b", "d") == ("undone: a (b)",)
    assert why(bench, kept, "a", "b", "a", "") == ("no d",)
    undone_by_loss = since(facts["a"], reset=~facts["c"])
    assert why(bench, undone_by_loss & facts["d"], "ac", "", "d") == ("undone: a (no c)",)


def test_since_tells_of_the_last_step_at_which_something_held(bench: Bench, facts: Facts) -> None:
    hand, low, _, done = facts.values()
    put = since((hand & low).called("put"), reset=~low).told_of("when let go", hand)
    assert why(bench, done & put, "a", "a", "b", "bd") == ("when let go: no b",)
    assert why(bench, done & put, "a", "ad") == ("no b",), "it is still in the hand"
    assert why(bench, done & put, "b", "bd") == ("not so far: put",)
    assert why(bench, done & put, "ab", "", "d") == ("undone: put (no b)",)
    assert why(bench, done & put, "ab", "b", "b") == ("no d",)


def test_of_several_alternatives_those_that_were_tried_speak(bench: Bench, facts: Facts) -> None:
    a, b, low, _ = facts.values()
    by = [since(one & low, reset=~low).told_of(f"when {one} let go", one) for one in (a, b)]
    assert why(bench, by[0] | by[1], "a", "") == ("when a let go: no c",)
    named = by[0].called("A put it") | by[1].called("B put it")
    assert why(bench, named, "a", "b", "") == (
        "neither A put it (when a let go: no c) nor B put it (when b let go: no c)",
    )


# --- episodes ------------------------------------------------------------------------------------


def test_it_is_about_the_next_stage_and_ends_with_success(bench: Bench) -> None:
    progress = bench.begin(*map(bench.fact, "ab"))
    progress.explain()
    said = []
    for step in ("", "a", "", "b"):
        bench.play(progress, step)
        said.append(progress.unmet)
    assert said == [("it is not so that a",), *[("it is not so that b",)] * 2, ()]


def test_a_reset_and_another_state_forget_what_was_said(bench: Bench, facts: Facts) -> None:
    progress = bench.begin(facts["d"] & since(facts["a"], reset=facts["b"]))
    progress.explain()
    bench.play(progress, "a", "b")
    progress.reset(bench.sim, {})
    assert progress.unmet == ()
    bench.play(progress, "d")
    assert progress.unmet == ("not so far: a",)
    bench.play(progress, "a", "b")
    progress.set_state(progress.get_state(), {})
    bench.play(progress, "d")
    assert progress.unmet == ("not so far: a",)


def test_nothing_is_asked_unless_somebody_wants_to_know(bench: Bench) -> None:
    said = []
    a = Predicate("a", bench.fact("a").test, otherwise=lambda _state: said.append("a") or "no a")
    watched = since(a & bench.fact("b")).told_of("when c", bench.fact("c"))
    progress = bench.begin(a & bench.fact("b") & watched)
    bench.play(progress, "", "b", "c")
    assert not said
    assert "c" not in bench.asked
    assert progress.unmet == ()
    progress.explain()
    bench.play(progress, "c")
    assert said
    said.clear()
    progress.explain(on=False)
    bench.play(progress, "c")
    assert not said
    assert progress.unmet == ()


def test_a_number_that_was_missed_is_in_millimetres(sim: Simulation) -> None:
    progress = Progress((Stage(name="up", instruction="up", holds=raised("cube", 0.03)),))
    sim.reset_data()
    sim.place("cube", SE3.at(0.5, 0.0, 0.016))
    sim.forward()
    progress.reset(sim, {})
    progress.explain()
    for height, text in ((0.016, "0 mm"), (0.0202, "4.2 mm"), (0.01598, "0 mm")):
        sim.place("cube", SE3.at(0.5, 0.0, height))
        sim.forward()
        progress.update(sim)
        assert progress.unmet == (f"cube is raised by {text}, not by 30 mm",)
