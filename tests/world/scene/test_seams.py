"""No bright dashes along seams: light neither leaks through them nor counts twice."""

import itertools
import math

import mujoco
import numpy as np
import pytest

from dev.tools.meshes import SEAMS
from duobench.core.spatial import SE3
from duobench.core.types import POLICY_CAMERAS, SIDES, Side
from duobench.tasks import catalog
from duobench.world.objects.blocks import WHITE
from duobench.world.objects.bowl import FLOOR, RADIUS, WALL as BOWL_WALL, bowl
from duobench.world.objects.cup import cup
from duobench.world.objects.prop import Prop
from duobench.world.objects.solid import Solid, printable
from duobench.world.robot.cameras import OVERVIEW, View
from duobench.world.robot.joints import JOINT_RANGES
from duobench.world.scene.compose import RIB_HEIGHT, add_ribs
from duobench.world.sim.rendering import Renderer
from duobench.world.sim.simulation import Simulation
from tests.world.sim.props import at_reset

FINE_SHADOWS = 4096
"""Side of a shadow map in texels with which light leaks nowhere."""
BRIGHTER = 25
"""By how much of 255 a pixel in the shadow must be brighter than it should be to be seen."""
FEW = 10e-4
"""Share of an object's pixels that may be too bright, at the jagged ends of its own shadows."""
STRAY_PIXELS = 2
"""Pixels of an image on an edge that two triangles share, where both may be drawn. Faces that
coincide show in dozens."""
ROUNDING = 4
"""By how much of 255 a sum of colours may be wrong."""


@pytest.mark.parametrize("solid", [bowl(WHITE), cup(WHITE)], ids=["bowl", "cup"])
def test_no_light_leaks_through_the_seam_of_a_wall_and_a_floor(solid: Solid) -> None:
    above = View(eye=(0.62, 0.01, 0.55), target=(0.65, 0.0, 0.0), fovy_deg=24.0)
    simulation = Simulation([Prop(name="it", solid=solid, fixed=True)], above)
    model, data = simulation.model, simulation.data

    def images() -> np.ndarray:
        taken = []
        with Renderer(model, height=400, width=400) as renderer:
            for yaw_deg in (-10, -4, 0, 10, 20, 45):
                simulation.place("it", SE3.at(0.65, 0.0, yaw=math.radians(yaw_deg)))
                simulation.forward()
                shown = model.geom_bodyid[renderer.segment(data, OVERVIEW)]
                image = renderer.render(data, OVERVIEW).mean(axis=2)
                taken.append(np.where(shown == model.body("it").id, image, np.nan))
        return np.array(taken)

    coarse = images()
    model.vis.quality.shadowsize = FINE_SHADOWS  # of renderers that are made from now on
    fine = images()
    assert np.sum(coarse - fine > BRIGHTER) / np.sum(~np.isnan(fine)) < FEW


@pytest.mark.parametrize("name", catalog.names())
def test_a_shadow_makes_no_object_brighter(name: str) -> None:
    """Where two faces coincide, the light that casts shadows is added once for each."""
    simulation = at_reset(name, seed=1)
    model, data = simulation.model, simulation.data
    robot = {model.body(f"{side}/link0").id for side in ("left", "right")}
    objects = ~np.isin(model.body_rootid[model.geom_bodyid], [0, *robot])
    with Renderer(model, height=480, width=640) as renderer:
        cameras = (*POLICY_CAMERAS, OVERVIEW)
        with_shadows = renderer.render_all(data, cameras)
        seen = {camera: objects[renderer.segment(data, camera)] for camera in cameras}
        model.light_castshadow[:] = False
        without = renderer.render_all(data, cameras)
    for camera in cameras:
        brighter = (with_shadows[camera].astype(int) - without[camera]).max(axis=2)
        assert np.count_nonzero(brighter[seen[camera]] > ROUNDING) <= STRAY_PIXELS, camera


def test_a_rib_lies_inside_the_wall_above_the_floor() -> None:
    plain = printable(bowl(WHITE))
    ribbed = add_ribs(plain)
    ribs = ribbed.vertices[len(plain.vertices) :]
    assert ribs[:, 2] == pytest.approx(FLOOR + RIB_HEIGHT)
    radii = np.hypot(ribs[:, 0], ribs[:, 1])
    assert radii.max() <= RADIUS + 1e-6
    assert radii.min() >= (RADIUS - BOWL_WALL) * math.cos(math.pi / 64) - 1e-6
    assert (ribbed.vertices[: len(plain.vertices)] == plain.vertices).all()


OUTSIDE = 0.25
"""Distance in metres from an axis at which a ray is outside of both links."""


EDGES = (-0.0018, -0.0008, -0.0014, -0.0008, -0.0011, 0.0006, -0.0005)
"""Just below the ends of links 0 to 6: heights in metres from the seams."""


@pytest.mark.parametrize("number", range(1, 8))
@pytest.mark.parametrize("side", SIDES)
def test_links_meet_in_an_even_line_through_which_nothing_shines(side: Side, number: int) -> None:
    """A ray to the axis of a joint meets a link; just below the edge of the outer one, that one."""
    simulation = Simulation([])
    model, data = simulation.model, simulation.data
    links = [model.body(f"{side}/link{each}").id for each in range(number + 1)]
    images = np.isin(model.geom_bodyid, links) & (model.geom_contype == 0)
    model.geom_group[:] = np.where(images, 0, 5)
    seen = np.array([1, 0, 0, 0, 0, 0], dtype=np.uint8)
    angles = np.linspace(0.0, 2 * math.pi, 40, endpoint=False)
    (seam, radius), edge = SEAMS[number], EDGES[number - 1]
    for turn in np.linspace(*JOINT_RANGES[number - 1], 5):
        data.qpos[simulation.duo.joints[side.index, number - 1]] = turn
        mujoco.mj_kinematics(model, data)
        joint = simulation.pose(f"{side}/link{number}")
        for angle, height in itertools.product(angles, (-0.001, 0.0, 0.001, edge)):
            away = joint.rotation @ np.array([math.cos(angle), math.sin(angle), 0.0])
            axis = joint.apply(np.array([0.0, 0.0, seam + height]))
            eye, which = axis + OUTSIDE * away, np.zeros(1, dtype=np.int32)
            met = mujoco.mj_ray(model, data, eye, -away, seen, 1, -1, which)
            assert 0.0 <= met < OUTSIDE, (turn, angle, height)
            if height == edge and OUTSIDE - met < radius:
                assert model.geom_bodyid[which[0]] != links[number], (turn, angle)
