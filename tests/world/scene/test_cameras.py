"""What the cameras see, by geometry and by pixels."""

import json
import math
from collections.abc import Iterator
from itertools import product

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from duobench.core.errors import DuoBenchError
from duobench.core.spatial import SE3
from duobench.core.types import HEAD, POLICY_CAMERAS, SIDES, Side, wrist_name
from duobench.tasks import catalog
from duobench.tasks.carry_pot import TASK
from duobench.world.objects.pot import PLATE
from duobench.world.objects.prop import Prop
from duobench.world.objects.shapes import sphere
from duobench.world.objects.solid import Solid
from duobench.world.robot.cameras import OVERVIEW, OVERVIEW_VIEW, View, describe_cameras
from duobench.world.robot.workcell import ROOM_X, ROOM_Y
from duobench.world.scene.compose import compose
from duobench.world.scene.naming import flange_name, tcp_name
from duobench.world.sim.rendering import Renderer
from duobench.world.sim.simulation import Simulation
from tests.world.sim.props import at_reset

Array = NDArray[np.float64]

SQUARE = 224
LEAST_PIXELS = 10
"""Pixels of an image of 640x480 by which a body counts as seen."""
BALL_RADIUS = 0.02
# The published intrinsics, written out again so that the cameras are held to them.
FOCAL = {"head": 740.0, "left_wrist": 650.0, "right_wrist": 650.0}
NATIVE = np.array([1280.0, 720.0])


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    ball = Solid(shapes=(sphere(BALL_RADIUS),), rgba=(1.0, 0.0, 1.0, 1.0))
    return Simulation([Prop(name="ball", solid=ball, fixed=True)])


@pytest.fixture(scope="module")
def square(simulation: Simulation) -> Iterator[Renderer]:
    with Renderer(simulation.model, height=SQUARE, width=SQUARE) as renderer:
        yield renderer


def pose_of(simulation: Simulation, camera: str) -> SE3:
    number = simulation.model.camera(camera).id
    data = simulation.data
    return SE3(data.cam_xmat[number].reshape(3, 3), data.cam_xpos[number])


def project(simulation: Simulation, camera: str, point: Array) -> Array:
    """Where a point shows, (2,): 0 to 1 from the left and from the top; depth must be positive."""
    x, y, z = pose_of(simulation, camera).inverse().apply(point)
    assert z < 0, "the point is behind the camera"
    return np.array([x, -y]) / -z * FOCAL[camera] / NATIVE + 0.5


def centroid(mask: NDArray[np.bool_]) -> Array:
    """Mean position (2,) of the pixels of a mask, in the same unit as `project`."""
    rows, columns = np.nonzero(mask)
    return (np.array([columns.mean(), rows.mean()]) + 0.5) / np.array(mask.shape[::-1])


def geoms_of(simulation: Simulation, start: str) -> list[int]:
    """Ids of the geoms of the bodies whose names have a beginning."""
    bodies = [simulation.model.body(body).name for body in simulation.model.geom_bodyid]
    return [geom for geom, body in enumerate(bodies) if body.startswith(start)]


@pytest.mark.parametrize("camera", POLICY_CAMERAS)
def test_a_policy_camera_has_the_published_intrinsics(simulation: Simulation, camera: str) -> None:
    model = simulation.model
    number = model.camera(camera).id
    assert model.cam_resolution[number].tolist() == NATIVE.tolist()
    pixels_per_metre = NATIVE / model.cam_sensorsize[number]
    focal_x, focal_y, centre_x, centre_y = model.cam_intrinsic[number]
    assert [focal_x, focal_y] * pixels_per_metre == pytest.approx([FOCAL[camera]] * 2)
    assert (centre_x, centre_y) == (0.0, 0.0)


def test_the_head_camera_looks_forward_and_down_between_the_arms(simulation: Simulation) -> None:
    pose = pose_of(simulation, HEAD)
    assert pose.translation == pytest.approx([0.0113, 0.001, 0.695])
    forward, right = -pose.rotation[:, 2], pose.rotation[:, 0]
    assert forward == pytest.approx([math.cos(math.radians(41)), 0.0, -math.sin(math.radians(41))])
    assert right == pytest.approx([0.0, -1.0, 0.0])
    # The middle of the image is the table, 0.8 m in front of the robot.
    reach = pose.translation + forward * (0.695 / -forward[2])
    assert reach == pytest.approx([0.811, 0.001, 0.0], abs=1e-3)


@pytest.mark.parametrize("side", SIDES)
def test_a_wrist_camera_sits_where_the_mount_holds_it(simulation: Simulation, side: Side) -> None:
    flange = simulation.site_pose(flange_name(side))
    flange_from_camera = flange.inverse() @ pose_of(simulation, wrist_name(side))
    assert flange_from_camera.translation == pytest.approx([0.050, 0.0, 0.067])
    axis = -flange_from_camera.rotation[:, 2]
    assert axis == pytest.approx([-math.sin(math.radians(20)), 0.0, math.cos(math.radians(20))])
    # The fingers open along the flange's y, and so does the wide side of the image.
    assert abs(flange_from_camera.rotation[:, 0]) == pytest.approx([0.0, 1.0, 0.0])


@pytest.mark.parametrize("camera", POLICY_CAMERAS)
def test_described_cameras_show_points_where_the_simulation_does(
    simulation: Simulation, camera: str
) -> None:
    said = describe_cameras()[camera]
    assert json.loads(json.dumps(said)) == said
    frame = SE3()
    if camera != HEAD:
        side = Side(said["frame"].removesuffix("_tool"))
        assert camera == wrist_name(side)
        frame = simulation.site_pose(tcp_name(side))
    frame_from_camera = np.array(said["frame_from_camera"])
    table_from_camera = frame @ SE3(frame_from_camera[:3, :3], frame_from_camera[:3, 3])
    point = np.array([0.05, -0.03, 0.4])
    x, y, depth = said["intrinsics"] @ point
    shown = (np.array([x, y]) / depth + 0.5) / said["size"][::-1]
    assert shown == pytest.approx(project(simulation, camera, table_from_camera.apply(point)))


@pytest.mark.parametrize("side", SIDES)
def test_each_finger_fills_its_lower_corner(
    simulation: Simulation, square: Renderer, side: Side
) -> None:
    camera = wrist_name(side)
    ids = square.segment(simulation.data, camera)
    fingers = []
    for finger in ("left", "right"):
        shown = np.isin(ids, geoms_of(simulation, f"{side}/gripper/{finger}_"))
        fingers.append(centroid(shown))
        assert shown.mean() > 0.03
    left, right = sorted(fingers, key=lambda middle: middle[0])
    assert left[0] < 0.3
    assert right[0] > 0.7
    assert min(left[1], right[1]) > 0.6
    # Between them the camera sees past the gripper, and the upper half is free of it.
    gripper = np.isin(ids, geoms_of(simulation, f"{side}/gripper/"))
    assert not gripper[: SQUARE // 2, :].any()
    assert not gripper[:, int(0.45 * SQUARE) : int(0.55 * SQUARE)].any()


def test_the_head_sees_the_table_and_both_grippers_from_above(
    simulation: Simulation, square: Renderer
) -> None:
    ids = square.segment(simulation.data, HEAD)
    table = ids == simulation.model.geom("table").id
    assert table[SQUARE // 2 :, SQUARE // 4 : -SQUARE // 4].all()
    tips = [centroid(np.isin(ids, geoms_of(simulation, f"{s}/gripper/"))) for s in SIDES]
    assert tips[0][0] < 0.4, "the left gripper is in the left half"
    assert tips[1][0] > 0.6
    assert max(tips[0][1], tips[1][1]) < 0.2


@pytest.mark.parametrize("camera", POLICY_CAMERAS)
@pytest.mark.parametrize("size", [(SQUARE, SQUARE), (720, 1280), (90, 300)])
def test_an_image_of_any_size_shows_the_whole_native_field_of_view(
    simulation: Simulation, camera: str, size: tuple[int, int]
) -> None:
    pose = pose_of(simulation, camera)
    number = simulation.model.body("ball").id
    half = NATIVE / 2 / FOCAL[camera]
    with Renderer(simulation.model, height=size[0], width=size[1]) as renderer:
        for across, up in ((-0.85, -0.2), (0.1, 0.85), (0.85, 0.5)):
            depth = 0.3
            place = pose.apply([across * half[0] * depth, up * half[1] * depth, -depth])
            simulation.place("ball", SE3.at(*place))
            simulation.forward()
            ids = renderer.segment(simulation.data, camera)
            seen = simulation.model.geom_bodyid[ids] == number
            # A ball seen from aside is drawn as an ellipse whose middle lies a little further out.
            apart = (centroid(seen) - project(simulation, camera, place)) * NATIVE
            assert np.abs(apart).max() < 6.0, (across, up)


def test_a_small_image_is_the_native_one_made_small(simulation: Simulation) -> None:
    simulation.place("ball", SE3.at(0.5, 0.0, 0.1))
    simulation.forward()
    with Renderer(simulation.model, height=720, width=1280) as renderer:
        native = renderer.render(simulation.data, HEAD).astype(np.float64)
    with Renderer(simulation.model, height=90, width=80) as renderer:
        small = renderer.render(simulation.data, HEAD).astype(np.float64)
    made_small = native.reshape(90, 8, 80, 16, 3).mean(axis=(1, 3))
    # Only outlines differ: one point a pixel against the mean of 128.
    assert np.median(np.abs(small - made_small)) < 1.0
    assert np.abs(small - made_small).mean() < 4.0


def test_the_head_sees_the_whole_stove_plate_of_every_layout(simulation: Simulation) -> None:
    place, (length, width, height) = TASK.placements["stove"], PLATE
    for x, y, yaw in product(*((u.low, u.high) for u in (place.x, place.y, place.yaw))):
        for corner in product((-length / 2, length / 2), (-width / 2, width / 2), (0.0, height)):
            shown = project(simulation, HEAD, SE3.at(x, y, yaw=yaw).apply(corner))
            assert 0.01 < shown.min() <= shown.max() < 0.99, (x, y, yaw)


def test_no_camera_looks_into_a_void(simulation: Simulation, square: Renderer) -> None:
    rng = np.random.default_rng(0)
    model, data = simulation.model, simulation.data
    eyes = model.cam_pos.copy(), model.cam_quat.copy()
    number = model.camera(OVERVIEW).id
    try:
        for _ in range(12):
            model.cam_pos[number] = rng.uniform(
                (ROOM_X[0] + 0.3, ROOM_Y[0] + 0.3, 0.2), (ROOM_X[1] - 0.3, ROOM_Y[1] - 0.3, 1.5)
            )
            quat = rng.normal(size=4)
            model.cam_quat[number] = quat / np.linalg.norm(quat)
            mujoco.mj_camlight(model, data)
            assert (square.segment(data, OVERVIEW) >= 0).all()
    finally:
        model.cam_pos[:], model.cam_quat[:] = eyes
        mujoco.mj_camlight(model, data)


def test_the_overview_shows_the_whole_robot_and_the_whole_table(simulation: Simulation) -> None:
    with Renderer(simulation.model, height=480, width=640) as renderer:
        ids = renderer.segment(simulation.data, OVERVIEW)
    robot = [geom for side in SIDES for geom in geoms_of(simulation, f"{side}/")]
    seen = np.isin(ids, [*robot, simulation.model.geom("table").id])
    assert seen.mean() > 0.25, "they fill the image"
    border = np.concatenate([seen[0], seen[:, 0], seen[:, -1]])
    assert not border.any()
    table = ids == simulation.model.geom("table").id
    assert table[-1].mean() < 0.1, "at most the corner nearest to the camera is cut"


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
        assert seen[body] >= LEAST_PIXELS, body
    for side in SIDES:
        assert (
            sum(n for key, n in seen.items() if key.startswith(f"{side}/")) > 100 * LEAST_PIXELS
        ), side


@pytest.mark.parametrize(
    ("name", "work"), [("spring_door", "microwave/door"), ("join_blocks", "wall:image")]
)
def test_it_shows_the_side_of_the_work_where_that_faces_the_robot(name: str, work: str) -> None:
    sim, counts = pixels(name)
    geoms = [n for n in range(sim.model.ngeom) if sim.model.geom(n).name.startswith(work)]
    assert sum(counts[geoms]) >= LEAST_PIXELS
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
