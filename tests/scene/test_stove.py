"""The head camera sees the whole stove plate of every layout."""

from itertools import product

import numpy as np
import pytest

from duobench.objects.pot import PLATE
from duobench.robot.cameras import HEAD_FOCAL, NATIVE_HEIGHT, NATIVE_WIDTH
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
