"""Names to ids: a misspelt one fails at once."""

from __future__ import annotations

import mujoco
import pytest

from duobench.errors import UnknownNameError
from duobench.sim.duo import names_of, resolve, resolve_all

TOY = """
<mujoco>
  <worldbody>
    <body name="pendulum">
      <joint name="pivot"/><geom size="0.1"/><site name="tip"/><site/>
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
    (mujoco.mjtObj.mjOBJ_SITE, "site", "tip", 0),
    (mujoco.mjtObj.mjOBJ_ACTUATOR, "actuator", "drive", 0),
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
    assert names_of(toy, mujoco.mjtObj.mjOBJ_SITE) == ["tip"]
