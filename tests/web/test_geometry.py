from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.spatial import cKDTree

from duobench.core.errors import DuoBenchError
from duobench.tasks import get, names
from duobench.tasks.task import Task
from duobench.web.geometry import Geometry
from duobench.world.looks.look import Light, Look, Material
from duobench.world.robot.cameras import OVERVIEW_VIEW
from duobench.world.sim import placement
from duobench.world.sim.layout import Layout
from duobench.world.sim.simulation import Simulation
from tests.quick_first import quick_first
from tests.web.scene_file import NO_SHADOWS, SceneFile, read_scene

MOST_BYTES = 70_000
MESH = mujoco.mjtGeom.mjGEOM_MESH
GRAIN = 5e-5
"""Metres that a point may be off: positions are rounded."""


def started(task: Task, seed: int) -> tuple[Simulation, Layout]:
    simulation = Simulation(task.props, task.overview)
    return simulation, placement.first_valid(simulation, task.layouts(seed), task.id)


def compiled(geoms: str, size: str = "") -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(
        f"<mujoco><asset>{size}</asset><worldbody>{geoms}</worldbody></mujoco>"
    )


def of_bodies(scene: SceneFile) -> set[int]:
    return set((scene.bodies % NO_SHADOWS).tolist())


@pytest.fixture(scope="module", params=quick_first(sorted(names()), quick=3))
def simulation(request: pytest.FixtureRequest) -> Simulation:
    simulation, _ = started(get(request.param), 3)
    command = simulation.duo.command()
    for _ in range(3):
        simulation.step(replace(command, joints=command.joints + 0.05))
    return simulation


def test_file_is_small(simulation: Simulation) -> None:
    assert len(Geometry(simulation.model).data) <= MOST_BYTES


def test_points_are_where_mujoco_has_them(simulation: Simulation) -> None:
    model, data = simulation.model, simulation.data
    geometry = Geometry(model)
    points, _ = read_scene(geometry.data).placed(geometry.poses(data))
    ours = cKDTree(points)
    for geom in np.flatnonzero(model.geom_group < 3).tolist():
        if model.geom_rgba[geom, 3] == 0 or model.geom_type[geom] != MESH:
            continue
        mesh = model.geom_dataid[geom]
        start = model.mesh_vertadr[mesh]
        local = model.mesh_vert[start : start + model.mesh_vertnum[mesh]]
        used = np.unique(model.mesh_face[model.mesh_faceadr[mesh] :][: model.mesh_facenum[mesh]])
        world = local[used] @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
        assert ours.query(world)[0].max() < GRAIN, model.geom(geom).name


def test_triangles_face_outward(simulation: Simulation) -> None:
    scene = read_scene(Geometry(simulation.model).data)
    a, b, c = (scene.points[scene.triangles[:, i]].astype(np.float64) for i in range(3))
    across = np.cross(b - a, c - a)
    meant = scene.normals[scene.triangles].mean(axis=1)
    area = np.linalg.norm(across, axis=1)
    wrong = np.einsum("ni,ni->n", across, meant) < 0
    assert area[wrong].sum() < 1e-3 * area.sum()


def test_every_body_has_points_and_the_table_stands_still(simulation: Simulation) -> None:
    geometry = Geometry(simulation.model)
    scene = read_scene(geometry.data)
    assert of_bodies(scene) == set(range(len(geometry.bodies) + 1))
    assert simulation.body_id("table") not in geometry.bodies
    assert simulation.body_id("left/link7") in geometry.bodies
    assert scene.header == geometry.header
    assert sum(scene.header["layers"]) == scene.header["corners"]


def test_same_model_gives_the_same_file_and_another_variant_another() -> None:
    task = get("ball_maze")
    simulation, first = started(task, 0)
    geometry = Geometry(simulation.model)
    again = Geometry(started(task, 0)[0].model)
    assert (geometry.data, geometry.name) == (again.data, again.name)
    other = next(
        layout
        for seed in range(1, 20)
        for layout in [next(iter(task.layouts(seed)))]
        if layout.variants != first.variants
    )
    simulation.apply(other)
    assert Geometry(simulation.model).name != geometry.name


def test_collision_shapes_and_what_is_hidden_are_not_shown() -> None:
    model = compiled("""
      <geom type="box" size="1 1 1" group="0" rgba="1 0 0 1"/>
      <geom type="box" size="2 2 2" group="3" rgba="0 1 0 1"/>
      <geom type="box" size="3 3 3" group="2" rgba="0 0 1 0"/>""")
    scene = read_scene(Geometry(model).data)
    assert np.abs(scene.points).max() == 1.0
    assert scene.colours.tolist() == [[255, 0, 0]] * 24
    assert Geometry(model).bodies == ()


def test_bodies_that_hang_on_each_other_are_one() -> None:
    model = compiled("""
      <body pos="1 0 0"><geom size=".1"/><body pos="0 1 0"><geom size=".1"/></body></body>
      <body name="moving" pos="0 0 1"><freejoint/><geom size=".1"/>
        <body pos="0 0 2" euler="90 0 0"><geom type="box" size=".1 .2 .3"/></body></body>
      <body name="placed" mocap="true" pos="5 0 0"><geom size=".1"/></body>""")
    geometry = Geometry(model)
    assert [model.body(body).name for body in geometry.bodies] == ["moving", "placed"]
    data = mujoco.MjData(model)
    data.qpos[:7] = [0.5, 0.6, 0.7, 0, 1, 0, 0]
    data.mocap_pos[0] = [-2, 0, 0]
    mujoco.mj_forward(model, data)
    poses = geometry.poses(data)
    assert poses.dtype == np.float32
    np.testing.assert_allclose(poses[0], [0.5, 0.6, 0.7, 0, 1, 0, 0], atol=1e-6)
    np.testing.assert_allclose(poses[1], [-2, 0, 0, 1, 0, 0, 0], atol=1e-6)
    points, _ = read_scene(geometry.data).placed(poses)
    # The box hangs 2 m along z of what is turned upside down, and its long side along y.
    box = points[np.abs(points[:, 2] - (0.7 - 2)) < 0.5]
    np.testing.assert_allclose(box.max(axis=0), [0.6, 0.9, -1.1], atol=1e-4)
    np.testing.assert_allclose(box.min(axis=0), [0.4, 0.3, -1.5], atol=1e-4)


@pytest.mark.parametrize(
    ("geom", "size", "half"),
    [
        ('type="sphere" size=".3"', 0.3, (0.3, 0.3, 0.3)),
        ('type="ellipsoid" size=".1 .2 .3"', None, (0.1, 0.2, 0.3)),
        ('type="cylinder" size=".1 .4"', None, (0.1, 0.1, 0.4)),
        ('type="capsule" size=".1 .4"', None, (0.1, 0.1, 0.5)),
        ('type="box" size=".1 .2 .3"', None, (0.1, 0.2, 0.3)),
        ('type="plane" size="2 1 .1"', None, (2, 1, 0)),
    ],
)
def test_shapes_have_their_size(
    geom: str, size: float | None, half: tuple[float, float, float]
) -> None:
    scene = read_scene(Geometry(compiled(f"<geom {geom}/>")).data)
    np.testing.assert_allclose(scene.points.max(axis=0), half, atol=GRAIN)
    np.testing.assert_allclose(-scene.points.min(axis=0), half, atol=GRAIN)
    np.testing.assert_allclose(np.linalg.norm(scene.normals, axis=1), 1, atol=0.02)
    if size is not None:
        np.testing.assert_allclose(np.linalg.norm(scene.points, axis=1), size, atol=GRAIN)
    a, b, c = (scene.points[scene.triangles[:, i]].astype(np.float64) for i in range(3))
    outward = np.einsum(
        "ni,ni->n", np.cross(b - a, c - a), scene.normals[scene.triangles].sum(axis=1)
    )
    assert (outward > -1e-9).all()


def test_height_fields_are_rejected() -> None:
    field = '<hfield name="hills" nrow="2" ncol="2" size="1 1 1 .1"/>'
    with pytest.raises(DuoBenchError, match=r"'ground' is a hfield.*what works is plane"):
        Geometry(compiled('<geom name="ground" type="hfield" hfield="hills"/>', field))


def test_too_many_bodies_are_rejected() -> None:
    bodies = '<body><freejoint/><geom size=".1"/></body>' * 256
    with pytest.raises(DuoBenchError, match=r"at most 255 moving bodies.* has 256"):
        Geometry(compiled(bodies))


def test_model_without_camera_and_lights_can_be_shown() -> None:
    header = Geometry(compiled('<geom size=".1"/>')).header
    assert header["camera"]["eye"] == list(OVERVIEW_VIEW.eye)
    assert header["lights"] == []


def test_texture_counts_by_its_mean() -> None:
    texture = """<texture name="t" type="2d" builtin="checker" rgb1="1 0 0" rgb2="0 1 0"
      width="64" height="64"/><material name="m" texture="t" emission=".4"/>"""
    scene = read_scene(
        Geometry(compiled('<geom type="box" size="1 1 1" material="m"/>', texture)).data
    )
    assert scene.colours.tolist() == [[128, 128, 0]] * 24
    assert set(scene.emission.tolist()) == {102}


def test_floor_is_darker_under_the_table() -> None:
    simulation = Simulation()
    scene = read_scene(Geometry(simulation.model).data)
    floor = np.isclose(scene.points[:, 2], simulation.position("floor")[2] - 0.8095, atol=1e-3)
    under = floor & (np.linalg.norm(scene.points[:, :2] - (0.4, 0), axis=1) < 0.3)
    beside = floor & (np.abs(scene.points[:, 1]) > 1.5)
    assert scene.colours[under].mean() < 0.7 * scene.colours[beside].mean()
    assert (scene.bodies[floor & under] == NO_SHADOWS).all()


def test_look_changes_colours_lights_and_furniture() -> None:
    simulation, _ = started(get("transfer_cube"), 0)
    plain = Geometry(simulation.model)
    look = Look(
        parts={"table": Material(colour=(0.0, 0.0, 1.0))},
        lights=(Light(position=(0.24, 0.0, 2.0), shadow=True),),
        ambient=(0.1, 0.1, 0.1),
        clutter=3,
    )
    dressed = Geometry(simulation.model, look)
    tints = {tuple(colour) for colour in read_scene(dressed.data).colours.tolist()}
    assert (0, 0, 255) in tints
    assert (0, 0, 255) not in {tuple(c) for c in read_scene(plain.data).colours.tolist()}
    assert dressed.header["ambient"] == [0.1, 0.1, 0.1]
    assert [light["direction"] for light in dressed.header["lights"]] == [[0.0, 0.0, -1.0]]
    assert dressed.header["corners"] > plain.header["corners"]
    assert dressed.bodies == plain.bodies
