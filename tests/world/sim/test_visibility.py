"""What cameras see of boxes, and of their shadows."""

import mujoco
import numpy as np
import pytest

from duobench.world.sim.visibility import Visibility, frustum

SCENE = """
<mujoco>
  <statistic extent="1"/>
  <visual><map shadowclip="1"/><quality shadowsize="1000"/></visual>
  <worldbody>
    <camera pos="0 0 2" fovy="60"/>
    <geom name="floor" type="plane" size="5 5 0.1"/>
    <geom name="below" type="box" pos="0 0 0.5" size="0.1 0.1 0.1"/>
    <geom name="edge" type="box" pos="1.24 0 0" size="0.1 0.01 0.01"/>
    <geom name="turned" type="box" pos="1.24 0.5 0" size="0.1 0.01 0.01" euler="0 0 90"/>
    <geom name="behind" type="box" pos="0 0 3" size="0.1 0.1 0.1"/>
    <geom name="far" type="box" pos="-3 0 1" size="0.1 0.1 0.1"/>
  </worldbody>
</mujoco>
"""
SHAPE = 100, 100


@pytest.fixture(scope="module")
def scene() -> tuple[mujoco.MjModel, mujoco.MjData, np.ndarray]:
    """A model, a state, and what its camera sees, 1.15 m to each side on the floor."""
    model = mujoco.MjModel.from_xml_string(SCENE)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    picture = mujoco.MjvScene(model, maxgeom=20)
    view = mujoco.MjvCamera()
    view.type = mujoco.mjtCamera.mjCAMERA_FIXED.value
    view.fixedcamid = 0
    mujoco.mjv_updateCamera(model, data, view, picture)
    return model, data, frustum(picture.camera, SHAPE)[None]


def looked_at(
    scene: tuple[mujoco.MjModel, mujoco.MjData, np.ndarray], light: tuple[float, ...] | None
) -> tuple[set[str], set[str]]:
    model, data, frustums = scene
    direction = None if light is None else np.array(light)
    unseen, unlit = Visibility(model).unseen(
        data, np.arange(model.ngeom), np.ones(model.ngeom, dtype=bool), frustums, direction
    )
    names = np.array([model.geom(number).name for number in range(model.ngeom)])
    return set(names[unseen[0]].tolist()), set(names[unlit].tolist())


def test_what_is_outside_of_an_image_is_not_seen(
    scene: tuple[mujoco.MjModel, mujoco.MjData, np.ndarray],
) -> None:
    assert looked_at(scene, None) == ({"turned", "behind", "far"}, set())


@pytest.mark.parametrize(
    ("light", "unlit"),
    [
        ((0.0, 0.0, -1.0), {"turned", "far"}),  # from above: into view from behind the camera
        ((1.0, 0.0, -0.3), {"turned", "behind"}),  # aslant: into view from far
        ((-1.0, 0.0, -0.3), {"far", "behind"}),
        ((0.0, 0.0, 1.0), set()),  # from below: nothing is known
    ],
)
def test_a_shadow_may_be_seen_of_what_is_not(
    scene: tuple[mujoco.MjModel, mujoco.MjData, np.ndarray],
    light: tuple[float, ...],
    unlit: set[str],
) -> None:
    assert looked_at(scene, light)[1] == unlit


def test_what_is_no_geom_counts_as_seen(
    scene: tuple[mujoco.MjModel, mujoco.MjData, np.ndarray],
) -> None:
    model, data, frustums = scene
    geoms = np.array([-1, model.geom("far").id])
    for casting in (True, False):
        unseen, unlit = Visibility(model).unseen(
            data, geoms, np.full(2, casting), frustums, np.array([0.0, 0.0, -1.0])
        )
        assert unseen.tolist() == [[False, True]]
        assert unlit.tolist() == [False, casting]
