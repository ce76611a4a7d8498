"""Handovers as sequences of moments, each of which two arms really brought about."""

from collections.abc import Callable

import numpy as np
import pytest

from duobench.core.spatial import SE3
from duobench.core.types import Side
from duobench.tasks.experts.handover import let_go, pick_bar
from duobench.tasks.experts.motion import Arms, Script
from duobench.tasks.experts.scripts.transfer_cube import (
    BAR,
    MEETING_POINT,
    RECEIVER_GRIP,
    RISE,
    SLANT,
)
from duobench.tasks.stages.handover import handover
from duobench.tasks.stages.logic import Predicate, since
from duobench.tasks.stages.passage import Passage
from duobench.tasks.stages.predicates import raised, touching
from duobench.tasks.transfer_cube import TASK
from duobench.world.objects.blocks import CUBE_EDGE
from duobench.world.sim.layout import Layout
from tests.steps import bring, drop, meet
from tests.task_harness import Moments, TaskHarness

LEFT, RIGHT = Side.LEFT, Side.RIGHT
LAYOUT = Layout(
    poses={
        "cube": SE3.at(0.45, -0.1, CUBE_EDGE / 2, yaw=0.3),
        "bowl": SE3.at(0.55, 0.15),
    }
)
RAISED = 0.012
LOW_IN_BOWL = np.array([0.55, 0.15, 0.033])


@pytest.fixture(scope="module")
def moments() -> Moments:
    """States by letter: on the (t)able, held by (r)ight, (b)oth, (l)eft alone, by left against the
    bowl (i), (c)lear of it, in the bowl and (f)ree, in the air and held by (n)obody.
    """
    moments = Moments(TaskHarness(TASK), LAYOUT)
    keep = moments.keep

    def whole_way(arms: Arms) -> Script:
        keep("t")
        yield from pick_bar(arms, BAR)
        keep("r")
        yield from meet(arms, BAR, MEETING_POINT, rise=RISE, grip_at=RECEIVER_GRIP, slant=SLANT)
        keep("b")
        yield from let_go(arms, RIGHT)
        keep("l")
        yield from bring(arms, LEFT, "cube", LOW_IN_BOWL)
        keep("i")
        yield from drop(arms, LEFT)
        keep("f")

    moments.start()
    moments.bench.act(whole_way)
    held = moments.at("i").pose("cube")
    moments.edit("c", "i", lambda sim: sim.place("cube", held.moved(z=RAISED)))
    moments.edit("n", "f", lambda sim: sim.place("cube", SE3.at(0.9, 0.0, 0.3)))
    return moments


def receivers(
    moments: Moments, letters: str, *, before: Callable[[int], None] | None = None, **way: Passage
) -> list[Side]:
    received = handover("cube", "bowl", **way).received
    return [side for side, word in received.items() if moments.answer(letters, word, before)]


def test_the_moments_are_what_they_are_called(moments: Moments) -> None:
    hands = {"r": {RIGHT}, "b": {LEFT, RIGHT}, "l": {LEFT}, "i": {LEFT}, "c": {LEFT}}
    supports = {"t": {"table"}, "i": {"bowl"}, "f": {"bowl"}}
    for letter in moments.states:
        contacts = moments.at(letter).contacts
        grasping = {side for side in Side if contacts.grasped(side, "cube")}
        touching = {other for other in ("table", "bowl") if contacts.between("cube", other)}
        assert grasping == hands.get(letter, set()), letter
        assert touching == supports.get(letter, set()), letter


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
def test_who_received(moments: Moments, letters: str, receiver: Side | None) -> None:
    assert receivers(moments, letters) == ([receiver] if receiver else [])


def test_why_both_did_not_hold_it_is_told_of_the_step_at_which_both_had_it(
    moments: Moments,
) -> None:
    x, y, z = moments.at("b").position("cube")
    moments.edit("leaning", "b", lambda sim: sim.place("bowl", SE3.at(x, y, z - 0.03)))
    moments.start()
    bench = moments.bench
    bench.progress.explain()
    for letter in ("t", "r", "leaning", "r"):
        moments.at(letter)
        bench.judge()
    del moments.states["leaning"]
    assert bench.stage == 1
    assert bench.progress.unmet == ("when both arms last grasped cube: cube touches bowl",)


def ring(where: dict[str, str]) -> Passage:
    """A way whose places are letters: (n)ear and far from the hole, in the hole with the middle on
    the near side (w) or the far side (W), (f)ar, and (a)round it.
    """

    def at(places: str) -> Predicate:
        return Predicate(f"is at {places}", lambda _: where["place"] in places)

    near = at("nw")
    crossing = at("Wf") & since(near, reset=~near)
    through = at("Wf") & (crossing | since(crossing, reset=at("nwa")))
    return Passage(crossing=crossing, through=through, within=at("wW"))


@pytest.mark.parametrize(
    ("letters", "places", "receiver"),
    [
        ("trrrbl", "nnnWWW", LEFT),
        ("trrrbll", "nnnWWWf", LEFT),
        ("trrrblll", "nnwwwwWf", LEFT),  # handed over in the hole, and drawn through
        ("trrrbblll", "nnwwwWWWf", LEFT),  # drawn through while both hold it
        ("trrrbbrbll", "nnwwwwwwWf", LEFT),  # contacts that flicker
        ("trrrbll", "nnwwwww", None),  # not through yet
        ("trrblll", "nnnnwWf", None),  # handed over before the hole
        ("trrrbrrrbll", "nnwwwwnaaff", None),  # both had it in the hole, and then around
        ("trrrbrrbll", "nnwwwwwWff", LEFT),  # the giver took it back, and gave it again
        ("trrrbnnnll", "nnwwwwwwWf", None),  # dropped in the hole, and caught
        ("trrrbtlll", "nnwwwwwWf", None),
        ("trrrbr", "nnWWWW", None),
        ("trlllbr", "nnnwWff", RIGHT),  # the other one brought it
    ],
)
def test_who_received_on_the_way(
    moments: Moments, letters: str, places: str, receiver: Side | None
) -> None:
    where = {"place": ""}

    def go(step: int) -> None:
        where["place"] = places[step]

    assert receivers(moments, letters, before=go, way=ring(where)) == (
        [receiver] if receiver else []
    )


IN_BOWL = touching("cube", "bowl")
ANYWHERE = IN_BOWL | ~IN_BOWL
LOW = ~raised("cube", 0.08)


@pytest.mark.parametrize(
    ("place", "letters", "put"),
    [
        (IN_BOWL, "trblif", True),
        (IN_BOWL, "trbliff", True),
        (IN_BOWL, "trblbrblif", True),  # handed back and over again
        (IN_BOWL, "tlbrtrblif", True),
        (IN_BOWL, "trblbif", False),  # the giver touches it once more
        (IN_BOWL, "trblblif", True),
        (IN_BOWL, "trbltlif", True),  # dropped by the receiver and picked up again
        (IN_BOWL, "trbltif", False),  # dropped by the receiver and pinched in the bowl
        (IN_BOWL, "trblfffif", False),
        (IN_BOWL, "trblfff", False),  # dropped from afar
        (IN_BOWL, "trblnif", True),
        (IN_BOWL, "trblnnnif", False),
        (IN_BOWL, "trbltrtlif", False),  # given back by way of the table
        (IN_BOWL, "trblbrif", False),  # handed back
        (IN_BOWL, "trblrif", False),
        (IN_BOWL, "trlif", False),
        (IN_BOWL, "trbliftt", False),  # out of the bowl again
        (IN_BOWL, "trbliftf", False),
        (ANYWHERE, "trblf", True),  # let go a little above it, never touched and in the hand
        (ANYWHERE, "trblnf", True),
        (ANYWHERE, "trbf", False),
        (ANYWHERE, "trbrf", False),
        (ANYWHERE, "trblif", True),
        (ANYWHERE, "trblitf", False),  # touched again by the table
        (ANYWHERE, "trblibf", False),  # and by the other arm
    ],
)
def test_what_was_put_there(moments: Moments, place: Predicate, letters: str, put: bool) -> None:
    assert moments.answer(letters, handover("cube", "bowl").put(place)) == put


def test_what_lies_on_something_flat_is_raised_above_that(moments: Moments) -> None:
    put = handover("cube", "bowl", top=0.010).put(LOW)
    assert moments.answer("trblcf", put)
    assert not moments.answer("trblnnncf", put), "dropped, and parted from it for a step"
    assert moments.answer("trblnnnlcf", put), "dropped, and brought again"
