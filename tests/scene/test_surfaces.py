"""Only the pads grip well, and everything that looks solid is."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from duobench.scene.cameras import HEAD_POSITION
from duobench.scene.fr3 import JOINT_RANGES
from duobench.scene.robotiq import PAD_FRICTION
from duobench.scene.surfaces import METAL_FRICTION
from duobench.sim.simulation import Simulation
from duobench.types import Side


@pytest.fixture(scope="module")
def sim() -> Simulation:
    return Simulation()


def friction_of(sim: Simulation) -> dict[str, set[float]]:
    """Sliding friction of what collides, by body."""
    found: dict[str, set[float]] = {}
    for geom in np.flatnonzero(sim.model.geom_contype):
        body = sim.model.body(sim.model.geom_bodyid[geom]).name
        found.setdefault(body, set()).add(float(sim.model.geom_friction[geom, 0]))
    return found


def test_pads_are_rubber_and_all_else_of_the_robot_is_metal(sim: Simulation) -> None:
    assert (PAD_FRICTION, METAL_FRICTION) == (0.8, 0.3)
    for body, values in friction_of(sim).items():
        if body.startswith(("left/", "right/")):
            expected = PAD_FRICTION if body.endswith("_pad") else METAL_FRICTION
            assert values == {expected}, body


def test_the_robots_surface_decides_about_friction(sim: Simulation) -> None:
    """MuJoCo takes the rougher of two surfaces unless one has priority."""
    for geom in np.flatnonzero(sim.model.geom_contype):
        body = sim.model.body(sim.model.geom_bodyid[geom]).name
        if body.startswith(("left/", "right/")):
            assert sim.model.geom_priority[geom] == 1, body


def test_mount_post_and_head_camera_are_in_the_way(sim: Simulation) -> None:
    """Arms at random joints touch them at all heights, not only the table and the column."""
    rng = np.random.default_rng(0)
    heights = []
    for _ in range(2000):
        sim.data.qpos[sim.duo.handles.qpos[0]] = rng.uniform(*JOINT_RANGES.T)
        mujoco.mj_forward(sim.model, sim.data)
        sim.contacts.update()
        if sim.contacts.arm(Side.LEFT, "world"):
            heights += [z for x, _, z in sim.data.contact.pos.tolist() if -0.1 < x < 0.03]
    for low, high in ((0.25, 0.40), (0.45, 0.66), (HEAD_POSITION[2], 0.73)):
        assert any(low < height < high for height in heights), (low, high)
