"""Only the pads grip well, and everything that looks solid is."""

import mujoco
import numpy as np
import pytest

from duobench.world.robot.joints import JOINT_RANGES
from duobench.world.scene.fingers import PAD_FRICTION
from duobench.world.scene.surfaces import METAL_FRICTION
from duobench.world.sim.simulation import Simulation


@pytest.fixture(scope="module")
def sim() -> Simulation:
    return Simulation()


def test_pads_are_rubber_and_all_else_of_the_robot_is_metal(sim: Simulation) -> None:
    assert (PAD_FRICTION, METAL_FRICTION) == (0.8, 0.3)
    for geom in np.flatnonzero(sim.model.geom_contype):
        body = sim.model.body(sim.model.geom_bodyid[geom]).name
        if body.startswith(("left/", "right/")):
            expected = PAD_FRICTION if body.endswith("_pad") else METAL_FRICTION
            assert sim.model.geom_friction[geom, 0] == expected, body


@pytest.mark.parametrize("name", ["mount/block", "mount/post", "mount/holder", "head/housing"])
def test_mount_and_head_camera_are_in_the_arms_way(sim: Simulation, name: str) -> None:
    """Some of many random positions of an arm touch each of them."""
    rng = np.random.default_rng(0)
    geom = sim.model.geom(name).id
    for _ in range(5000):
        sim.data.qpos[sim.duo.joints[0]] = rng.uniform(*JOINT_RANGES.T)
        mujoco.mj_forward(sim.model, sim.data)
        if (sim.data.contact.geom == geom).any():
            return
    pytest.fail(f"no position of the arm touches {name}")
