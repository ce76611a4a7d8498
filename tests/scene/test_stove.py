"""The head camera sees the whole stove plate of every layout."""

from itertools import product

import numpy as np
import pytest

from duobench.objects.pot import PLATE
from duobench.robot.cameras import NATIVE_HEIGHT, NATIVE_WIDTH
from duobench.scene.cameras import HEAD_FOCAL
from duobench.sim.rendering import Renderer
from duobench.sim.simulation import Simulation
from duobench.spatial import SE3
from duobench.tasks.carry_pot import TASK
from duobench.types import HEAD

MARGIN = 0.01
"""Least share of the image's sides between the plate and the border."""


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return Simulation(TASK.props)


def poses() -> list[SE3]:
    """The extreme poses of the plate."""
    place = TASK.placements["stove"]
    ends = [(u.low, u.high) for u in (place.x, place.y, place.yaw)]
    return [SE3.at(x, y, yaw=yaw) for x, y, yaw in product(*ends)]


def test_every_corner_of_the_plate_is_inside_the_head_image(simulation: Simulation) -> None:
    number, data = simulation.model.camera(HEAD).id, simulation.data
    camera = SE3(data.cam_xmat[number].reshape(3, 3), data.cam_xpos[number])
    length, width, height = PLATE
    corners = list(product((-length / 2, length / 2), (-width / 2, width / 2), (0.0, height)))
    for pose in poses():
        x, y, z = camera.inverse().apply(pose.apply(np.array(corners))).T
        assert (z < 0).all()
        shown = np.array([x / NATIVE_WIDTH, -y / NATIVE_HEIGHT]) / -z * HEAD_FOCAL + 0.5
        assert shown.min() > MARGIN, pose.translation
        assert shown.max() < 1 - MARGIN, pose.translation


def test_no_pixel_at_the_border_of_the_head_image_shows_the_plate(simulation: Simulation) -> None:
    plate = simulation.model.body("stove").id
    # The pot hides nothing.
    simulation.place("pot", SE3.at(0.5, -0.4, 0.06))
    with Renderer(simulation.model, height=224, width=224) as renderer:
        for pose in poses():
            simulation.place("stove", pose)
            simulation.forward()
            ids = renderer.segment(simulation.data, HEAD)
            seen = simulation.model.geom_bodyid[ids] == plate
            assert seen.sum() > 1000
            border = np.concatenate([seen[0], seen[-1], seen[:, 0], seen[:, -1]])
            assert not border.any(), pose.translation
