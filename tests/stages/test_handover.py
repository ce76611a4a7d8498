"""Handovers as sequences of moments, each of which two arms really brought about."""

import numpy as np
import pytest

from duobench.experts.handover import let_go, pick_bar
from duobench.experts.motion import Arms, Script
from duobench.experts.transfer_cube import BAR, MEETING_POINT, RECEIVER_GRIP, RISE, SLANT
from duobench.objects.blocks import CUBE_EDGE
from duobench.sim.layout import Layout
from duobench.spatial import SE3
from duobench.stages.handover import handover
from duobench.stages.predicates import Predicate, touching
from duobench.tasks.transfer_cube import TASK
from duobench.types import Side
from tests.handovers import bring, drop, meet
from tests.predicate_probe import PredicateProbe
from tests.task_harness import TaskHarness

LEFT, RIGHT = Side.LEFT, Side.RIGHT
LAYOUT = Layout(
    poses={
        "cube": SE3.at(0.45, -0.1, CUBE_EDGE / 2, yaw=0.3),
        "bowl": SE3.at(0.55, 0.15),
    }
)
LOW_IN_BOWL = np.array([0.55, 0.15, 0.033])

Moments = dict[str, np.ndarray]


@pytest.fixture(scope="module")
def bench() -> TaskHarness:
    return TaskHarness(TASK)


@pytest.fixture(scope="module")
def moments(bench: TaskHarness) -> Moments:
    """States by letter: on the (t)able, held by (r)ight, (b)oth, (l)eft alone, by left against the
    bowl (i), in the bowl and (f)ree, in the air and held by (n)obody.
    """
    saved: Moments = {}

    def keep(letter: str) -> None:
        saved[letter] = bench.sim.get_state()

    def whole_way(arms: Arms) -> Script:
        keep("t")
        yield from pick_bar(arms, BAR)
        keep("r")
        yield from meet_again(arms)
        keep("b")
        yield from let_go(arms, RIGHT)
        keep("l")
        yield from bring(arms, LEFT, "cube", LOW_IN_BOWL)
        keep("i")
        yield from drop(arms, LEFT)
        keep("f")
        bench.sim.place("cube", SE3.at(0.9, 0.0, 0.3))
        bench.sim.forward()
        keep("n")

    def meet_again(arms: Arms) -> Script:
        yield from meet(arms, BAR, MEETING_POINT, rise=RISE, grip_at=RECEIVER_GRIP, slant=SLANT)

    bench.start(layout=LAYOUT)
    bench.act(whole_way)
    return saved


def answer(bench: TaskHarness, moments: Moments, letters: str, question: Predicate) -> bool:
    """Whether a predicate holds at the end of a sequence of moments."""
    bench.start(layout=LAYOUT)
    lowest = {"cube": bench.sim.min_height("cube")}
    probe = PredicateProbe(question)
    yes = False
    for letter in letters:
        bench.sim.set_state(moments[letter])
        yes = probe.ask(bench.sim, lowest)
    return yes


def test_the_moments_are_what_they_are_called(bench: TaskHarness, moments: Moments) -> None:
    hands = {
        "t": (),
        "r": (RIGHT,),
        "b": (LEFT, RIGHT),
        "l": (LEFT,),
        "i": (LEFT,),
        "f": (),
        "n": (),
    }
    supports = {"t": "table", "i": "bowl", "f": "bowl"}
    for letter, state in moments.items():
        bench.sim.set_state(state)
        contacts = bench.sim.contacts
        for side in Side:
            assert contacts.grasped(side, "cube") == (side in hands[letter]), letter
        for support in ("table", "bowl"):
            touches = contacts.between("cube", support)
            assert touches == (supports.get(letter) == support), letter


@pytest.mark.parametrize(
    ("letters", "receiver"),
    [
        ("trbl", LEFT),
        ("trrbbll", LEFT),
        ("trlbl", LEFT),
        ("trl", None),  # caught: never in both hands
        ("tbl", None),  # nobody gave it
        ("tl", None),
        ("trb", None),
        ("trbr", None),  # the giver keeps it
        ("trbtl", None),  # dropped while both had it
        ("trbnl", LEFT),  # contacts that are lost for one step
        ("trbnnnl", None),  # let go, and caught
        ("trnbl", LEFT),
        ("trbrl", None),
        ("trbtrl", None),
        ("trblbr", None),  # handed back
        ("trblr", None),
        ("trblbrbl", LEFT),  # and handed over again
        ("trblbrtrbl", LEFT),
        ("tlbrtrbl", LEFT),  # a new one, after one the other way round was put down
        ("tlbr", RIGHT),
        ("tlbrbl", None),
        ("trbrblblbrbl", LEFT),  # contacts that flicker
        ("trbt" * 9 + "rbl", LEFT),
        ("trbt" * 9 + "l", None),
    ],
)
def test_who_received(
    bench: TaskHarness, moments: Moments, letters: str, receiver: Side | None
) -> None:
    received = handover("cube", "bowl").received
    assert [s for s, p in received.items() if answer(bench, moments, letters, p)] == (
        [receiver] if receiver else []
    )


@pytest.mark.parametrize(
    ("letters", "put"),
    [
        ("trblif", True),
        ("trbliff", True),
        ("trblbrblif", True),  # handed back and over again
        ("tlbrtrblif", True),
        ("trblbif", False),  # the giver touches it once more
        ("trblblif", True),
        ("trbltlif", True),  # dropped by the receiver and picked up again
        ("trbltif", False),  # dropped by the receiver and pinched in the bowl
        ("trblfffif", False),
        ("trblfff", False),  # dropped from afar
        ("trblnif", True),
        ("trblnnnif", False),
        ("trbltrtlif", False),  # given back by way of the table
        ("trblbrif", False),  # handed back
        ("trblrif", False),
        ("trlif", False),
        ("trbliftt", False),  # out of the bowl again
        ("trbliftf", False),
    ],
)
def test_what_was_put_there(bench: TaskHarness, moments: Moments, letters: str, put: bool) -> None:
    in_bowl = touching("cube", "bowl")
    words = handover("cube", "bowl")
    assert answer(bench, moments, letters, words.put(in_bowl, until=~in_bowl)) == put


@pytest.mark.parametrize(
    ("letters", "put"), [("trblif", True), ("trblitf", False), ("trblibf", False)]
)
def test_what_was_put_there_is_not_touched_again(
    bench: TaskHarness, moments: Moments, letters: str, put: bool
) -> None:
    """By the other arm, or by the table."""
    never = touching("cube", "bowl") & ~touching("cube", "bowl")
    words = handover("cube", "bowl")
    question = words.put(touching("cube", "bowl"), until=never)
    assert answer(bench, moments, letters, question) == put
