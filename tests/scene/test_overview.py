"""The camera for people: every task is seen from the side where its work is."""

import numpy as np
import pytest

from duobench.errors import DuoBenchError
from duobench.robot.cameras import OVERVIEW, OVERVIEW_VIEW, View
from duobench.scene.compose import compose
from duobench.sim.rendering import Renderer
from duobench.sim.simulation import Simulation
from duobench.tasks import catalog
from duobench.types import SIDES
from tests.sim.props import at_reset

LEAST = 10
"""Pixels of an image of 640x480 by which a body counts as seen."""


def pixels(name: str) -> tuple[Simulation, np.ndarray]:
    """The simulation of a task at a reset, and how often the overview shows each geom."""
    sim = at_reset(name, seed=0)
    with Renderer(sim.model, height=480, width=640) as renderer:
        geoms = renderer.segment(sim.data, OVERVIEW)
    return sim, np.bincount(geoms[geoms >= 0], minlength=sim.model.ngeom)


@pytest.mark.parametrize("name", catalog.names())
def test_it_shows_every_object_and_both_arms_at_the_reset(name: str) -> None:
    sim, counts = pixels(name)
    by_body = np.bincount(sim.model.geom_bodyid, counts, minlength=sim.model.nbody)
    seen = {sim.model.body(number).name: count for number, count in enumerate(by_body)}
    # Marbles lie at the bottom of a cup.
    props = [prop for key, prop in sim.props.items() if not key.startswith("marble")]
    parts = [prop.part_name(part.name) for prop in props for part in prop.parts]
    for body in [*(prop.name for prop in props), *parts]:
        assert seen[body] >= LEAST, body
    for side in SIDES:
        assert sum(n for key, n in seen.items() if key.startswith(f"{side}/")) > 100 * LEAST, side


@pytest.mark.parametrize(
    ("name", "work"), [("spring_door", "microwave/door"), ("join_blocks", "wall:image")]
)
def test_it_shows_the_side_of_the_work_where_that_faces_the_robot(name: str, work: str) -> None:
    sim, counts = pixels(name)
    geoms = [n for n in range(sim.model.ngeom) if sim.model.geom(n).name.startswith(work)]
    assert sum(counts[geoms]) >= LEAST
    eye, body = sim.data.camera(OVERVIEW).xpos, sim.model.geom_bodyid[geoms[0]]
    assert eye[0] < sim.data.xpos[body][0], "from the robot's side"


def test_the_model_takes_the_view_that_is_given() -> None:
    view = View(eye=(0.1, -1.2, 0.9), target=(0.4, 0.0, 0.1), fovy_deg=30.0)
    model = Simulation((), view).model
    camera = model.camera(OVERVIEW)
    assert camera.pos == pytest.approx(view.eye)
    assert camera.fovy == pytest.approx(view.fovy_deg)
    assert Simulation().model.camera(OVERVIEW).pos == pytest.approx(OVERVIEW_VIEW.eye)


@pytest.mark.parametrize("eye", [(0.0, 0.0, 1.9), (3.1, 0.0, 1.0), (0.0, -2.4, 1.0)])
def test_an_eye_outside_the_room_is_refused(eye: tuple[float, float, float]) -> None:
    with pytest.raises(DuoBenchError, match="inside the room"):
        compose((), View(eye=eye, target=(0.4, 0.0, 0.1), fovy_deg=30.0))
