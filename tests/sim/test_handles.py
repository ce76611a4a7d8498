"""Names to ids: a misspelt one fails at once."""

from __future__ import annotations

import mujoco
import pytest

from duobench.errors import DuoBenchError, UnknownNameError
from duobench.scene.compose import compose
from duobench.scene.naming import arm_joint_names, gripper_name, tcp_name
from duobench.sim.handles import DuoHandles, names_of, resolve, resolve_all
from duobench.types import SIDES

TOY = """
<mujoco>
  <worldbody>
    <camera name="eye"/>
    <body name="pendulum">
      <joint name="pivot"/><geom name="bob" size="0.1"/><geom size="0.1"/><site name="tip"/>
    </body>
  </worldbody>
  <actuator><motor name="drive" joint="pivot"/></actuator>
</mujoco>
"""


@pytest.fixture(scope="module")
def toy() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(TOY)


KINDS = [
    (mujoco.mjtObj.mjOBJ_BODY, "body", "pendulum", 1),
    (mujoco.mjtObj.mjOBJ_JOINT, "joint", "pivot", 0),
    (mujoco.mjtObj.mjOBJ_GEOM, "geom", "bob", 0),
    (mujoco.mjtObj.mjOBJ_SITE, "site", "tip", 0),
    (mujoco.mjtObj.mjOBJ_ACTUATOR, "actuator", "drive", 0),
    (mujoco.mjtObj.mjOBJ_CAMERA, "camera", "eye", 0),
]


@pytest.mark.parametrize(("kind", "word", "name", "number"), KINDS)
def test_names_become_ids(
    toy: mujoco.MjModel, kind: mujoco.mjtObj, word: str, name: str, number: int
) -> None:
    assert resolve(toy, kind, name) == number
    assert resolve_all(toy, kind, [name, name]).tolist() == [number, number]
    with pytest.raises(UnknownNameError, match=f"{word} '{name}x'.*Did you mean '{name}'"):
        resolve(toy, kind, name + "x")


def test_nameless_elements_are_not_listed(toy: mujoco.MjModel) -> None:
    assert names_of(toy, mujoco.mjtObj.mjOBJ_GEOM) == ["bob"]


def test_the_robots_handles_are_those_of_the_model() -> None:
    model = compose().compile()
    handles = DuoHandles.of(model)
    for side in SIDES:
        for column, name in enumerate(arm_joint_names(side)):
            joint = model.joint(name)
            assert handles.joints[side.index, column] == joint.id
            assert handles.qpos[side.index, column] == joint.qposadr[0]
        site = handles.tcp_sites[side.index]
        assert model.site(int(site)).name == tcp_name(side)
    names = [model.actuator(number).name for number in range(model.nu)]
    assert names[handles.actuators] == [
        name for side in SIDES for name in (*arm_joint_names(side), gripper_name(side))
    ]


def test_a_model_without_the_robot_is_refused(toy: mujoco.MjModel) -> None:
    with pytest.raises(UnknownNameError, match="left/joint1"):
        DuoHandles.of(toy)


def test_actuators_in_another_order_are_refused() -> None:
    spec = compose()
    spec.delete(spec.actuator(arm_joint_names(SIDES[0])[2]))
    joint = arm_joint_names(SIDES[0])[2]
    spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    with pytest.raises(DuoBenchError, match="follow each other"):
        DuoHandles.of(spec.compile())
