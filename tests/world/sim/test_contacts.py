"""Who touches whom, against the engine's own list."""

from itertools import combinations_with_replacement

import mujoco
import pytest

from duobench.core.errors import UnknownNameError
from duobench.core.types import SIDES, Side
from duobench.world.robot.frames import ROBOT
from duobench.world.scene.naming import TABLE
from duobench.world.sim.contacts import Contacts, HingeAxis, Limb, limb_owner
from duobench.world.sim.simulation import Simulation
from tests.world.sim.props import EDGE, hold, scene

# Two arms of nothing but the parts that contacts tell apart, and two balls on a table; the second
# ball is held 1 mm above it, within its geoms' margin.
TOY = """
<mujoco>
  <option gravity="0 0 0"/>
  <worldbody>
    <body name="table"><geom type="plane" size="1 1 1"/></body>
    <body name="ball" pos="0 0 0.0999"><freejoint/><geom size="0.1"/></body>
    <body name="lid" pos="9 9 9"><freejoint/><geom type="box" size="0.1 0.1 0.005"/></body>
    <body name="hover" pos="0.5 0 0.101"><freejoint/><geom size="0.1" margin="0.02"/></body>
    {arms}
  </worldbody>
</mujoco>
"""
ARM = """
<body name="{side}/link" pos="{x} 0 3"><geom size="0.1"/>
  <body name="{side}/gripper/base" pos="0 0 0.5"><geom size="0.1"/>
    <body name="{side}/gripper/left_pad" pos="0 0.3 0.5"><geom size="0.1"/></body>
    <body name="{side}/gripper/right_pad" pos="0 -0.3 0.5"><geom size="0.1"/></body>
  </body>
</body>
"""


class Toy:
    """A small model, and its contacts with the ball, or something else that is free, at a place."""

    def __init__(self, xml: str, arm: str, **names: str) -> None:
        arms = "".join(arm.format(side=side, x=2 * side.index - 1, **names) for side in SIDES)
        self.model = mujoco.MjModel.from_xml_string(xml.format(arms=arms))
        self.data = mujoco.MjData(self.model)
        self.contacts = Contacts(self.model, self.data, ROBOT.gripper)
        self.place()

    def place(self, *position: float, body: str = "ball") -> Contacts:
        start = self.model.joint(self.model.body(body).jntadr[0]).qposadr[0]
        self.data.qpos[start : start + len(position)] = position
        mujoco.mj_forward(self.model, self.data)
        self.contacts.update()
        return self.contacts


@pytest.fixture
def toy() -> Toy:
    return Toy(TOY, ARM)


def test_every_part_has_its_owner(toy: Toy) -> None:
    limbs = {limb_owner(side, limb) for side in SIDES for limb in Limb}
    assert set(toy.contacts.owners) == {TABLE, "ball", "lid", "hover"} | limbs


def test_contact_is_symmetric_and_of_the_moment_and_no_margin(toy: Toy) -> None:
    assert toy.data.ncon == 2, "the engine lists both balls"
    contacts = toy.contacts
    assert contacts.between(TABLE, "ball")
    assert not contacts.between("hover", TABLE)
    assert (contacts.partners(TABLE), contacts.partners("ball")) == ({"ball"}, {TABLE})
    toy.place(0.0, 0.0, 0.4)
    assert not contacts.between(TABLE, "ball")
    assert contacts.partners("ball") == frozenset()


@pytest.mark.parametrize(
    ("x", "y", "z", "arm", "gripper"),
    [
        (-1.15, 0.0, 3.0, True, False),
        (-1.15, 0.0, 3.5, True, True),
        (-1.15, 0.0, 4.0, False, False),
        (-1.15, 0.0, 4.5, False, False),
        (-1.0, 0.3, 4.19, True, True),  # one of the pads
        (-1.0, -0.3, 4.19, True, True),
    ],
)
def test_limbs_are_told_apart_and_an_arm_is_all_of_it_and_pads_are_both(
    toy: Toy, x: float, y: float, z: float, arm: bool, gripper: bool
) -> None:
    contacts = toy.place(x, y, z)
    assert contacts.arm(Side.LEFT, "ball") is arm
    assert contacts.gripper(Side.LEFT, "ball") is gripper
    assert not contacts.grasped(Side.LEFT, "ball")
    assert not contacts.arm(Side.RIGHT, "ball")
    assert not contacts.gripper(Side.RIGHT, "ball")


def test_deepest_names_what_overlaps(toy: Toy) -> None:
    contacts = toy.place(0.0, 0.0, 0.09)
    ((one, other, depth),) = contacts.deepest(0.005)
    assert {one, other} == {TABLE, "ball"}
    assert depth == pytest.approx(0.01)
    assert contacts.deepest(0.02) == []


def with_lid(
    toy: Toy, gap: float, *, above: bool = True, aside: float = 0.0, hinge: float = 0.1
) -> HingeAxis:
    """A level lid over a pad of the left hand, or below it, and its hinge; it opens upwards.

    In metres: the gap between surfaces, how far the lid is moved along its hinge, and how far the
    hinge is from the pad's middle.
    """
    x, y, z = toy.data.body("left/gripper/left_pad").xpos.tolist()
    height = z + (gap + 0.105) * (1 if above else -1)
    toy.place(x, y + aside, height, body="lid")
    return HingeAxis([x + hinge, y, height], [0.0, 1.0, 0.0])


@pytest.mark.parametrize(
    ("gap", "above", "hinge", "pushes"),
    [
        (-1e-4, True, 0.1, True),
        (-1e-4, False, 0.1, False),  # from outside: it presses the lid shut
        (1e-4, True, 0.1, False),  # no contact
        (-1e-4, True, 0.021, True),
        (-1e-4, True, 0.019, False),  # next to the hinge it turns nothing
        (-1e-4, True, -0.1, False),  # on the other side of the hinge it shuts
    ],
)
def test_what_pushes_open_has_a_lever_about_the_hinge(
    toy: Toy, gap: float, above: bool, hinge: float, pushes: bool
) -> None:
    axis = with_lid(toy, gap, above=above, hinge=hinge)
    assert [toy.contacts.pushes(side, "lid", lambda: axis) for side in SIDES] == [pushes, False]


@pytest.mark.parametrize(
    ("gap", "above", "aside", "backs"),
    [
        (0.03, True, 0.0, True),
        (0.059, True, 0.0, True),
        (0.061, True, 0.0, False),
        (0.03, True, 0.09, True),
        (0.03, True, 0.15, False),  # beside it
        (0.03, False, 0.0, False),  # on the outside
    ],
)
def test_a_hand_backs_a_lid_that_would_turn_onto_it(
    toy: Toy, gap: float, above: bool, aside: float, backs: bool
) -> None:
    axis = with_lid(toy, gap, above=above, aside=aside)
    found = [any(toy.contacts.behind(side, "lid", axis, 0.060)) for side in SIDES]
    assert found == [backs, False]
    for between, radius in toy.contacts.behind(Side.LEFT, "lid", axis, 0.060):
        assert between == pytest.approx(gap, abs=1e-6)
        assert 0.1 <= radius < 0.2


@pytest.mark.parametrize("hinge", [0.1, 0.05, -0.1])
@pytest.mark.parametrize("above", [True, False])
def test_the_moment_of_an_arm_is_its_force_times_its_lever(
    toy: Toy, above: bool, hinge: float
) -> None:
    axis = with_lid(toy, -1e-3, above=above, hinge=hinge)
    pushed = toy.data.qfrc_constraint[toy.model.joint(1).dofadr[0] + 2]
    assert (pushed > 0.0) == above
    moment = toy.contacts.moment(Side.LEFT, "lid", axis)
    assert moment == pytest.approx(pushed * hinge, rel=1e-6)
    assert toy.contacts.moment(Side.RIGHT, "lid", axis) == 0.0


@pytest.mark.parametrize(
    ("question", "first"),
    [
        ("between", ["ball"]),
        ("partners", []),
        ("gripper", [Side.LEFT]),
        ("arm", [Side.LEFT]),
        ("grasped", [Side.LEFT]),
    ],
)
def test_an_unknown_owner_is_an_error(toy: Toy, question: str, first: list[str]) -> None:
    with pytest.raises(UnknownNameError, match=r"'bal'.*'ball'"):
        getattr(toy.contacts, question)(*first, "bal")


# Two pads 60 mm apart, and a ball that both may touch: from between them, or from below.
PADS = """
<mujoco>
  <option gravity="0 0 0"/>
  <worldbody>
    <body name="ball"><freejoint/><geom size="RADIUS"/></body>
    <body name="other" pos="0 0 9"><geom size="0.1"/></body>
    {arms}
  </worldbody>
</mujoco>
"""
PAD_ARM = """
<body name="{side}/link" pos="{x} 0 3"><geom size="0.001" contype="0" conaffinity="0"/>
  <body name="{side}/gripper/base"><geom size="0.001" contype="0" conaffinity="0"/>
    <body name="{side}/gripper/left_{part}" pos="0 0.032 0">
      <geom type="box" size="0.01 0.002 0.01"/><pad/>
    </body>
    <body name="{side}/gripper/right_pad" pos="0 -0.032 0">
      <geom type="box" size="0.01 0.002 0.01"/>
    </body>
  </body>
</body>
"""


@pytest.mark.parametrize(
    ("radius", "below", "grasped"),
    [
        (0.0301, 0.0, True),  # from side to side, 0.1 mm into each pad
        (0.0301, 0.009, True),
        (0.032, 0.019, True),
        (0.055, 0.0559, True),  # from above, 57 degrees off
        (0.065, 0.0675, False),  # 63 degrees off
        (0.20, 0.2069, False),  # nearly flat
    ],
)
@pytest.mark.parametrize("part", ["pad", "follower"])
def test_fingers_grasp_only_what_they_press_on_from_both_sides(
    radius: float, below: float, grasped: bool, part: str
) -> None:
    """A finger is its pad or its linkage."""
    pad = "" if part == "pad" else '<body name="{side}/gripper/left_pad"/>'
    toy = Toy(PADS.replace("RADIUS", str(radius)), PAD_ARM.replace("<pad/>", pad), part=part)
    contacts = toy.place(-1.0, 0.0, 3.0 - below)
    touched = [contacts.between("ball", f"left/{side}_finger") for side in SIDES]
    assert touched == [True, True], "the ball is not where both fingers touch it"
    assert contacts.grasped(Side.LEFT, "ball") is grasped
    assert not contacts.grasped(Side.RIGHT, "ball")


# --- the real robot ------------------------------------------------------------------------------


def held_cube(depth: float = 0.0) -> Simulation:
    """The left gripper closes on a cube that was put between its fingers, so deep in metres."""
    sim = scene()
    hold(sim, "cube", steps=15, depth=depth)
    for _ in range(5):
        sim.step(sim.duo.command())
    return sim


def test_a_real_gripper_pinches_and_lets_go() -> None:
    sim = held_cube()
    assert sim.contacts.grasped(Side.LEFT, "cube")
    assert sim.contacts.gripper(Side.LEFT, "cube")
    assert not sim.contacts.gripper(Side.RIGHT, "cube")
    assert not sim.contacts.between("cube", TABLE)
    pads = {limb_owner(Side.LEFT, Limb.LEFT_FINGER), limb_owner(Side.LEFT, Limb.RIGHT_FINGER)}
    assert pads <= sim.contacts.partners("cube")
    for _ in range(20):
        sim.step(ROBOT.home_command)
    assert not sim.contacts.gripper(Side.LEFT, "cube")
    assert sim.position("cube")[2] == pytest.approx(EDGE / 2, abs=0.03)


@pytest.mark.parametrize("depth", [-0.010, 0.0, 0.012, 0.024, 0.036])
def test_a_real_gripper_grasps_at_its_tips_and_deep_in_its_fingers(depth: float) -> None:
    sim = held_cube(depth)
    for _ in range(10):
        assert sim.contacts.grasped(Side.LEFT, "cube")
        sim.step(sim.duo.command())


def test_the_set_is_the_engines_list() -> None:
    sim = held_cube()
    bodies = [sim.model.body(body).name for body in sim.model.geom_bodyid]
    listed = {
        frozenset(owner_of(bodies[geom]) for geom in contact.geom)
        for contact in sim.data.contact
        if contact.dist <= 0
    }
    assert listed
    pairs = combinations_with_replacement(sim.contacts.owners, 2)
    assert {frozenset(pair) for pair in pairs if sim.contacts.between(*pair)} == listed


def owner_of(body: str) -> str:
    for side in SIDES:
        for finger in SIDES:
            if body.startswith(f"{side}/gripper/{finger}_"):
                return f"{side}/{finger}_finger"
        if body.startswith(f"{side}/gripper/"):
            return f"{side}/hand"
        if body.startswith(f"{side}/"):
            return f"{side}/arm"
    return body
