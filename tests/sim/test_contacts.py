"""Who touches whom, against the engine's own list."""

import mujoco
import numpy as np
import pytest

from duobench.errors import UnknownNameError
from duobench.scene.naming import TABLE, tcp_name
from duobench.sim.contacts import Contacts, HingeAxis, Limb, limb_owner
from duobench.sim.duo import HOME
from duobench.sim.simulation import Simulation
from duobench.spatial import SE3
from duobench.types import SIDES, DuoCommand, Side
from tests.sim.props import EDGE, scene

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
    <body name="{side}/gripper/left_pad" pos="0 0.3 0.5"><freejoint_/><geom size="0.1"/></body>
    <body name="{side}/gripper/right_pad" pos="0 -0.3 0.5"><geom size="0.1"/></body>
  </body>
</body>
"""


def toy() -> tuple[mujoco.MjModel, mujoco.MjData, Contacts]:
    arms = "".join(ARM.format(side=side, x=2 * side.index - 1) for side in SIDES)
    model = mujoco.MjModel.from_xml_string(TOY.format(arms=arms.replace("<freejoint_/>", "")))
    data = mujoco.MjData(model)
    contacts = Contacts(model, data)
    look(model, data, contacts)
    return model, data, contacts


def look(model: mujoco.MjModel, data: mujoco.MjData, contacts: Contacts) -> None:
    mujoco.mj_forward(model, data)
    contacts.update()


def test_every_part_has_its_owner() -> None:
    _, _, contacts = toy()
    limbs = {limb_owner(side, limb) for side in SIDES for limb in Limb}
    assert set(contacts.owners) == {TABLE, "ball", "lid", "hover"} | limbs


def test_a_margin_alone_is_no_contact() -> None:
    _, data, contacts = toy()
    assert data.ncon == 2, "the engine lists both balls"
    assert contacts.between("ball", TABLE)
    assert not contacts.between("hover", TABLE)


def test_contact_is_symmetric_and_of_the_moment() -> None:
    model, data, contacts = toy()
    assert contacts.between(TABLE, "ball")
    assert contacts.partners(TABLE) == {"ball"}
    assert contacts.partners("ball") == {TABLE}
    data.qpos[2] = 0.4
    look(model, data, contacts)
    assert not contacts.between(TABLE, "ball")
    assert contacts.partners("ball") == frozenset()


@pytest.mark.parametrize(
    ("height", "arm", "gripper"),
    [(3.0, True, False), (3.5, True, True), (4.0, False, False), (4.5, False, False)],
)
def test_limbs_are_told_apart_and_an_arm_is_all_of_it(
    height: float, arm: bool, gripper: bool
) -> None:
    model, data, contacts = toy()
    data.qpos[:3] = [-1.15, 0.0, height]
    look(model, data, contacts)
    assert contacts.arm(Side.LEFT, "ball") is arm
    assert contacts.gripper(Side.LEFT, "ball") is gripper
    assert not contacts.grasped(Side.LEFT, "ball")
    assert not contacts.arm(Side.RIGHT, "ball")
    assert not contacts.gripper(Side.RIGHT, "ball")


def test_pads_means_both() -> None:
    model, data, contacts = toy()
    for y in (0.3, -0.3):
        data.qpos[:3] = [-1.0, y, 4.19]
        look(model, data, contacts)
        assert contacts.gripper(Side.LEFT, "ball")
        assert not contacts.grasped(Side.LEFT, "ball")


def test_deepest_names_what_overlaps() -> None:
    model, data, contacts = toy()
    data.qpos[2] = 0.09
    look(model, data, contacts)
    ((one, other, depth),) = contacts.deepest(0.005)
    assert {one, other} == {TABLE, "ball"}
    assert depth == pytest.approx(0.01)
    assert contacts.deepest(0.02) == []


QUESTIONS = {
    "between": ["ball"],
    "partners": [],
    "gripper": [Side.LEFT],
    "arm": [Side.LEFT],
    "grasped": [Side.LEFT],
}


def with_lid(
    gap: float, *, above: bool = True, aside: float = 0.0, hinge: float = 0.1
) -> tuple[Contacts, HingeAxis]:
    """A level lid over a pad of the left hand, or below it, and its hinge; it opens upwards.

    In metres: the gap between surfaces, how far the lid is moved along its hinge, and how far the
    hinge is from the pad's middle.
    """
    model, data, contacts = toy()
    x, y, z = data.xpos[model.body("left/gripper/left_pad").id].tolist()
    lid = [x, y + aside, z + (gap + 0.105) * (1 if above else -1)]
    start = model.joint(model.body("lid").jntadr[0]).qposadr[0]
    data.qpos[start : start + 3] = lid
    look(model, data, contacts)
    return contacts, HingeAxis([x + hinge, y, lid[2]], [0.0, 1.0, 0.0])


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
    gap: float, above: bool, hinge: float, pushes: bool
) -> None:
    contacts, axis = with_lid(gap, above=above, hinge=hinge)
    assert contacts.pushes(Side.LEFT, "lid", axis) is pushes
    assert not contacts.pushes(Side.RIGHT, "lid", axis)


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
    gap: float, above: bool, aside: float, backs: bool
) -> None:
    contacts, axis = with_lid(gap, above=above, aside=aside)
    assert contacts.backs(Side.LEFT, "lid", axis, 0.060) is backs
    assert not contacts.backs(Side.RIGHT, "lid", axis, 0.060)


@pytest.mark.parametrize("question", QUESTIONS)
def test_an_unknown_owner_is_an_error(question: str) -> None:
    _, _, contacts = toy()
    with pytest.raises(UnknownNameError, match=r"'bal'.*'ball'"):
        getattr(contacts, question)(*QUESTIONS[question], "bal")


# Two pads 60 mm apart, and a ball that both may touch: from between them, or from below.
PADS = """
<mujoco>
  <option gravity="0 0 0"/>
  <worldbody>
    <body name="ball"><freejoint/><geom size="{radius}"/></body>
    <body name="other" pos="0 0 9"><geom size="0.1"/></body>
    {arms}
  </worldbody>
</mujoco>
"""
PAD_ARM = """
<body name="{side}/link" pos="{x} 0 3"><geom size="0.001" contype="0" conaffinity="0"/>
  <body name="{side}/gripper/base"><geom size="0.001" contype="0" conaffinity="0"/>
    <body name="{side}/gripper/left_pad" pos="0 0.032 0">
      {left}<geom type="box" size="0.01 0.002 0.01"/>{end}
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
    arms = "".join(
        PAD_ARM.format(
            side=side,
            x=side.index - 1,
            left=f'<body name="{side}/gripper/left_{part}">' if part != "pad" else "",
            end="</body>" if part != "pad" else "",
        )
        for side in SIDES
    )
    model = mujoco.MjModel.from_xml_string(PADS.format(radius=radius, arms=arms))
    data = mujoco.MjData(model)
    contacts = Contacts(model, data)
    data.qpos[:3] = [-1.0, 0.0, 3.0 - below]
    look(model, data, contacts)
    touched = [contacts.between("ball", f"left/{side}_finger") for side in SIDES]
    assert touched == [True, True], "the ball is not where both fingers touch it"
    assert contacts.grasped(Side.LEFT, "ball") is grasped
    assert not contacts.grasped(Side.RIGHT, "ball")


# --- the real robot ------------------------------------------------------------------------------


def held_cube(sim: Simulation, depth: float = 0.0) -> None:
    """The left gripper closes on a cube that was put between its fingers, so deep in metres."""
    sim.reset_data()
    for name, x in (("slab", 0.4), ("bowl", 0.6), ("chest", 0.8)):
        sim.place(name, SE3.at(x, -0.5, 0.011))
    sim.forward()
    tool = sim.site_pose(tcp_name(Side.LEFT)) @ SE3.at(z=-depth)
    grasp = DuoCommand(joints=HOME.joints, openings=np.array([0.0, 1.0]))
    for _ in range(15):
        sim.place("cube", tool)
        sim.forward()
        sim.step(grasp)
    for _ in range(5):
        sim.step(grasp)


def test_a_real_gripper_pinches_and_lets_go() -> None:
    sim = scene()
    held_cube(sim)
    assert sim.contacts.grasped(Side.LEFT, "cube")
    assert sim.contacts.gripper(Side.LEFT, "cube")
    assert not sim.contacts.gripper(Side.RIGHT, "cube")
    assert not sim.contacts.between("cube", TABLE)
    pads = {limb_owner(Side.LEFT, Limb.LEFT_FINGER), limb_owner(Side.LEFT, Limb.RIGHT_FINGER)}
    assert pads <= sim.contacts.partners("cube")
    for _ in range(20):
        sim.step(HOME)
    assert not sim.contacts.gripper(Side.LEFT, "cube")
    assert sim.position("cube")[2] == pytest.approx(EDGE / 2, abs=0.03)


@pytest.mark.parametrize("depth", [-0.010, 0.0, 0.012, 0.024, 0.036])
def test_a_real_gripper_grasps_at_its_tips_and_deep_in_its_fingers(depth: float) -> None:
    sim = scene()
    held_cube(sim, depth)
    for _ in range(10):
        assert sim.contacts.grasped(Side.LEFT, "cube")
        sim.step(sim.duo.command())


def test_the_set_is_the_engines_list() -> None:
    sim = scene()
    held_cube(sim)
    listed = set()
    for contact in sim.data.contact:
        if contact.dist <= 0:
            bodies = [sim.model.body(sim.model.geom_bodyid[geom]).name for geom in contact.geom]
            listed.add(frozenset(map(owner_of, bodies)))
    assert listed
    owners = sim.contacts.owners
    found = {
        frozenset((one, other))
        for one in owners
        for other in owners
        if sim.contacts.between(one, other)
    }
    assert found == listed


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
