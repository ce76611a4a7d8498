"""Carrying with both arms as sequences of moments, each of which two arms really brought about."""

import pytest

from duobench.core.spatial import SE3
from duobench.core.types import CONTROL_HZ, SIDES, DuoCommand, Side
from duobench.tasks.carry_pot import HANDLES, LIFT, TASK
from duobench.tasks.experts.handling import carry
from duobench.tasks.experts.motion import Arms, Script, wait
from duobench.tasks.experts.scripts.carry_pot import carry_over, land, let_go, lift
from duobench.tasks.stages.coordination import HOP_HEIGHT, TIP_SECONDS, carriage
from duobench.tasks.stages.placing import PUT_HEIGHT
from duobench.tasks.stages.predicates import FLICKER_SECONDS, BoxRegion, inside
from duobench.world.objects.pot import HEIGHT, PLATE, RADIUS
from duobench.world.sim.layout import Layout
from tests.task_harness import Moments, TaskHarness, take_away

LEFT, RIGHT = Side.LEFT, Side.RIGHT
STOVE = SE3.at(0.5, 0.3)
LAYOUT = Layout(poses={"pot": SE3.at(0.5, -0.05, HEIGHT / 2), "stove": STOVE})
PLACE = inside("pot", BoxRegion(body="stove", low=(-0.1, -0.1, 0.0), high=(0.1, 0.1, 0.2)))
CARRIAGE = carriage("pot", HANDLES, "stove", place=PLACE, top=PLATE[2], height=LIFT)
FLICKER, TIP = (round(seconds * CONTROL_HZ) for seconds in (FLICKER_SECONDS, TIP_SECONDS))


def push(arms: Arms) -> Script:
    """Hold the pot against the stove's side."""
    yield from carry_over(arms, 0.5, 0.3 - PLATE[1] / 2 - RADIUS - 0.03)
    beside = arms.sim.pose("pot").moved(z=-0.057)
    yield from carry(arms, "pot", beside, speed=0.1)
    yield from wait(10)
    for _ in carry(arms, "pot", beside.moved(y=0.06), speed=0.05):
        if arms.sim.contacts.between("pot", "stove"):
            break
        yield


def rise(arms: Arms, height: float) -> Script:
    """Hold the pot so that it really is at a height above the stove, in metres."""
    for _ in range(2):
        short = PLATE[2] + height - arms.sim.min_height("pot")
        yield from carry(arms, "pot", arms.sim.pose("pot").moved(z=short), speed=0.1)
        yield from wait(10)


@pytest.fixture(scope="module")
def moments() -> Moments:
    """States by letter: on the (t)able, (c)arried by both, in the air in the (l)eft hand alone or
    in (n)o hand, in both hands against the stove's (s)ide, on the stove in (b)oth hands or (f)ree,
    a (j)olt there that takes one pad of each hand off its handle, (h)opping above the stove, just
    (u)p from it again in both hands; and so little above the stove that it is put down when it is
    let go, in (m)any hands or in (o)ne, or just too (w)ide above it.
    """
    moments = Moments(TaskHarness(TASK), LAYOUT)
    bench, keep = moments.bench, moments.keep

    def without(*sides: Side) -> None:
        """Open grippers, until they no longer touch the pot, from how it is carried."""
        moments.at("c")
        command = bench.sim.duo.command()
        openings = command.openings.copy()
        openings[[side.index for side in sides]] = 0.5
        while any(bench.sim.contacts.gripper(side, f"pot/{side}_handle") for side in sides):
            bench.sim.step(DuoCommand(joints=command.joints, openings=openings))

    def whole_way(arms: Arms) -> Script:
        keep("t")
        yield from lift(arms)
        keep("c")
        yield from push(arms)
        keep("s")
        yield from carry(arms, "pot", arms.sim.pose("pot").moved(z=0.08), speed=0.1)
        yield from carry_over(arms, 0.5, 0.3)
        yield from land(arms)
        keep("b")
        landed = arms.sim.pose("pot")
        yield from rise(arms, 0.8 * PUT_HEIGHT)
        keep("m")
        yield from rise(arms, PUT_HEIGHT + 0.6 * HOP_HEIGHT)
        keep("w")
        yield from rise(arms, 1.8 * PUT_HEIGHT)
        keep("u")
        yield from carry(arms, "pot", landed, speed=0.1)
        yield from let_go(arms)
        keep("f")

    moments.start()
    bench.act(whole_way)
    landed = moments.at("b").pose("pot")
    moments.edit("j", "b", lambda sim: sim.place("pot", landed.moved(y=0.0008)))
    moments.edit("h", "f", lambda sim: sim.place("pot", landed.moved(z=PUT_HEIGHT - 0.002)))
    without(RIGHT)
    keep("l")
    without(LEFT, RIGHT)
    keep("n")
    take_away(moments.at("m"), RIGHT, moments.states["t"])
    bench.sim.data.qvel[:] = 0.0
    bench.sim.forward()
    keep("o")
    return moments


def test_the_moments_are_what_they_are_called(moments: Moments) -> None:
    hands = {**dict.fromkeys("csbumw", SIDES), **dict.fromkeys("lo", (LEFT,))}
    supports = {"t": {"table"}, **{key: {"stove"} for key in "sbjf"}}
    for letter in moments.states:
        contacts = moments.at(letter).contacts
        for side, handle in zip(SIDES, HANDLES, strict=True):
            assert contacts.grasped(side, handle) == (side in hands.get(letter, ())), letter
        assert contacts.partners("pot") == supports.get(letter, set()), letter
    for letter, least, most in (("u", 1, 2), ("w", 1, 1.25), ("m", 0, 1), ("o", 0, 1), ("h", 0, 1)):
        above = moments.at(letter).min_height("pot") - PLATE[2]
        assert least * PUT_HEIGHT < above < most * PUT_HEIGHT, letter
    assert 0.005 < moments.at("s").min_height("pot") < PLATE[2] - 0.005


@pytest.mark.parametrize(
    ("letters", "counts"),
    [
        ("tcbf", True),
        ("tccbbff", True),
        ("tbf", False),  # both had it, and never carried it
        ("tctbf", False),  # put back, and pushed
        ("tctcbf", True),
        ("tcnf", False),  # dropped onto the stove
        ("tcnff", False),
        ("tcnfbf", False),  # dropped, then grasped
        ("tclcbf", True),  # a contact that flickers
        ("tcllcbf", True),
        ("tclllcbf", False),  # carried by one hand for a while
        ("tclllccccbf", False),
        ("tclllctcbf", True),  # begun anew
        ("tlllcbf", False),
        ("tcnnncbf", False),
        ("tclf", False),
        ("tclbf", True),
        ("tcuhhhhff", False),  # slipped at its place
        ("tcuhhhhfbbff", False),  # and taken again, not lifted
        ("tcuhhhhfbuubf", True),  # lifted there again, and put down
        ("tcuhhhhfbuhhhhfbubf", True),  # twice
        ("tcuhhhhftcubf", True),
        ("tcnnnnfbubf", False),  # slipped before it came there
        ("tllllfbubf", False),  # brought there by one hand
        ("tcllllfbubf", False),
        ("tcbhf", True),  # hops when it is let go
        ("tcbhhhhhf", True),
        ("tcb" + "u" * FLICKER + "f", False),  # lifted again, and dropped
        ("tcb" + "u" * FLICKER + "bf", True),
        ("tcbubf", True),
        ("tcmf", True),  # let go a little above the stove
        ("tcmhf", True),
        ("tcuf", False),  # let go higher
        ("tcm" + "o" * (TIP - 1) + "f", True),  # first by one hand
        ("tcm" + "o" * TIP + "f", False),  # carried on by the other one
        ("tcm" + "o" * TIP + "bf", False),
        ("tctmf", False),
        ("tcbulllbf", False),
        ("tcjbf", True),  # shaken as it lands
        ("tcfbf", True),
        ("tcjjbf", True),
        ("tcwjjjbf", True),
        ("tcwjf", True),  # fingers opened between two steps
        ("tcjjjbf", False),  # from higher up
        ("tcjf", False),
        ("tcsf", False),  # it touched the stove, and did not stand on it
        ("tcsbf", True),
        ("tcsnfffbf", False),  # and was let go there
        ("tcbtf", False),
        ("tcbtbf", False),
    ],
)
def test_what_was_put_down(moments: Moments, letters: str, counts: bool) -> None:
    assert moments.answer(letters, CARRIAGE.put_down) == counts


@pytest.mark.parametrize("letter", "tclnsbjufhmo")
def test_what_is_carried(moments: Moments, letter: str) -> None:
    assert moments.answer(letter, CARRIAGE.carried) == (letter in "cu")
