"""A black cube is told apart from the black thing that it lies in or on, also in shadow."""

from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from duobench.core.spatial import SE3
from duobench.core.types import HEAD, POLICY_CAMERAS
from duobench.envs.observation_wrappers import IMAGE_SIZE
from duobench.envs.sim_env import sim_of
from duobench.world.objects.blocks import CUBE_EDGE
from duobench.world.objects.bowl import FLOOR
from duobench.world.objects.chest import HINGE, LID_UNDERSIDE, WALL
from duobench.world.sim.rendering import Renderer
from duobench.world.sim.simulation import Simulation
from tests.tasks.experts.baseline_episodes import SEEDS, baseline, make
from tests.world.sim.props import at_reset

DIFFERENCE = 25.0
"""Least difference of two neighbouring pixels' luminance, of 255."""
LID_TOP = HINGE[2] + LID_UNDERSIDE + WALL
"""Height in metres of the shut lid's upper side in the chest's frame."""
EVERY = 4
"""Control steps from one image to the next."""
LUMA = (0.2126, 0.7152, 0.0722)
"""Weights of red, green and blue in luminance [ITU-R BT.709]."""


def states(name: str, seed: int) -> Iterator[Simulation]:
    """The simulation every few steps of the expert's episode, and at its end."""
    env = make(name)
    env.reset(seed=seed)
    played = baseline(name)[SEEDS.index(seed)].states
    for state in (*played[::EVERY], played[-1]):
        env.get_wrapper_attr("restore_state")(state)
        yield sim_of(env).simulation
    env.close()


def contrasts(
    image: NDArray[np.uint8], one: NDArray[np.bool_], other: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """By how much luminance differs from each pixel of one mask to each neighbour in the other."""
    luminance = image @ np.array(LUMA)
    found = []
    for axis in (0, 1):
        for first, second in ((one, other), (other, one)):
            a, b = np.delete(first, -1, axis), np.delete(second, 0, axis)
            step = np.abs(np.diff(luminance, axis=axis))
            found.append(step[a & b])
    return np.concatenate(found)


def contrasts_seen(
    simulation: Simulation, renderer: Renderer, *names: str
) -> dict[str, NDArray[np.float64]]:
    """By camera, the contrasts between the pixels of two bodies."""
    model, data = simulation.model, simulation.data
    found = {}
    for camera, image in renderer.render_all(data, POLICY_CAMERAS).items():
        bodies = model.geom_bodyid[renderer.segment(data, camera)]
        found[camera] = contrasts(image, *(bodies == model.body(name).id for name in names))
    return found


def test_the_black_cube_is_told_from_its_bowl_under_the_hand() -> None:
    episode = states("bin_sort", seed=1)
    simulation = next(episode)
    found: dict[str, list[NDArray[np.float64]]] = {camera: [] for camera in POLICY_CAMERAS}
    with Renderer(simulation.model, height=IMAGE_SIZE[0], width=IMAGE_SIZE[1]) as renderer:
        for state in episode:
            seen = contrasts_seen(state, renderer, "black_cube", "black_bowl")
            for camera, values in seen.items():
                found[camera].append(values)
    # The other arm's wrist never sees them.
    for camera, least in ((HEAD, 50), ("right_wrist", 300)):
        values = np.concatenate(found[camera])
        assert len(values) > least, camera
        assert values.min() > DIFFERENCE, camera


@pytest.mark.parametrize("lit", [True, False], ids=["lit", "in shadow"])
@pytest.mark.parametrize(
    ("name", "cube", "around", "offset"),
    [
        ("bin_sort", "black_cube", "black_bowl", SE3.at(z=FLOOR + CUBE_EDGE / 2)),
        ("hinge_chest", "cube", "chest", SE3.at(z=LID_TOP + CUBE_EDGE / 2)),
    ],
)
def test_a_black_cube_is_told_from_what_it_lies_on(
    name: str, cube: str, around: str, offset: SE3, lit: bool
) -> None:
    simulation = at_reset(name, seed=1)
    simulation.place(cube, simulation.pose(around) @ offset)
    simulation.forward()
    for light in range(simulation.model.nlight):
        simulation.model.light_active[light] &= lit or not simulation.model.light_castshadow[light]
    surface = {"black_bowl": "black_bowl", "chest": "chest/lid"}[around]
    # Twice as many pixels as a policy has: from home, a cube is five of those wide.
    with Renderer(simulation.model, height=2 * IMAGE_SIZE[0], width=2 * IMAGE_SIZE[1]) as renderer:
        found = contrasts_seen(simulation, renderer, cube, surface)
    for camera in (HEAD, "right_wrist"):
        assert len(found[camera]) > 20, camera
    assert np.concatenate(list(found.values())).min() > DIFFERENCE
