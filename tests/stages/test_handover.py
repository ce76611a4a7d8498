"""Handovers as sequences of moments, each of which two arms really brought about."""

import numpy as np
import pytest

from duobench.experts.handover import let_go, pick_bar
from duobench.experts.motion import Arms, Script
from duobench.experts.transfer_cube import BAR, MEETING_POINT
from duobench.sim.layout import Layout
from duobench.solids.blocks import CUBE_EDGE
from duobench.spatial import SE3
from duobench.stages.handover import handover
from duobench.tasks.transfer_cube import TASK
from duobench.types import Side
from tests.handovers import bring, drop, meet
from tests.recall import Recall
from tests.stageplay import Stageplay

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
def bench() -> Stageplay:
    return Stageplay(TASK)


@pytest.fixture(scope="module")
def moments(bench: Stageplay) -> Moments:
    """States by letter: on the (t)able, held by (r)ight, (b)oth, (l)eft alone, by left against the
    bowl (i), in the bowl and (f)ree.
    """
    saved: Moments = {}

    def keep(letter: str) -> None:
        saved[letter] = bench.sim.save()

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

    def meet_again(arms: Arms) -> Script:
        yield from meet(arms, BAR, MEETING_POINT, grip_at=0.022, slant=0.5)

    bench.start(layout=LAYOUT)
    bench.act(whole_way)
    return saved


def delivered(bench: Stageplay, moments: Moments, letters: str) -> dict[Side, bool]:
    """Who has delivered the cube at the end of a sequence of moments."""
    bench.start(layout=LAYOUT)
    lowest = {"cube": bench.sim.lowest("cube")}
    recalls = {side: Recall(p) for side, p in handover("cube", "bowl").delivered.items()}
    answers: dict[Side, bool] = {}
    for letter in letters:
        bench.sim.restore(moments[letter])
        answers = {side: recall.ask(bench.sim, lowest) for side, recall in recalls.items()}
    return answers


def test_the_moments_are_what_they_are_called(bench: Stageplay, moments: Moments) -> None:
    hands = {"t": (), "r": (RIGHT,), "b": (LEFT, RIGHT), "l": (LEFT,), "i": (LEFT,), "f": ()}
    supports = {"t": "table", "i": "bowl", "f": "bowl"}
    for letter, state in moments.items():
        bench.sim.restore(state)
        contacts = bench.sim.contacts
        for side in Side:
            assert contacts.pads(side, "cube") == (side in hands[letter]), letter
        for support in ("table", "bowl"):
            touches = contacts.between("cube", support)
            assert touches == (supports.get(letter) == support), letter


@pytest.mark.parametrize(
    ("letters", "receiver"),
    [
        ("trblif", LEFT),
        ("trrbblliff", LEFT),
        ("trlif", None),  # caught: never in both hands
        ("tbllif", None),  # nobody gave it
        ("tlif", None),
        ("trbrif", None),  # the giver keeps it
        ("trbtlif", None),  # dropped while both had it
        ("trblbrif", None),  # handed back
        ("trblrif", None),
        ("trblbrblif", LEFT),
        ("trblbrtrblif", LEFT),
        ("tlbrtrblif", LEFT),  # a new one, after one the other way round was put down
        ("tlbrf", RIGHT),
        ("tlbrblf", None),
        ("trbltlif", LEFT),  # dropped by the receiver and picked up again
        ("trbltif", None),  # dropped by the receiver and pushed
        ("trblbif", None),  # the giver touches it once more
        ("trblblif", LEFT),
        ("trbt" * 9 + "rblif", LEFT),
        ("trbt" * 9 + "lif", None),
    ],
)
def test_who_delivered(
    bench: Stageplay, moments: Moments, letters: str, receiver: Side | None
) -> None:
    answers = delivered(bench, moments, letters)
    assert [side for side, yes in answers.items() if yes] == ([receiver] if receiver else [])
