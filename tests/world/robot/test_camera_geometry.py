"""Where cameras are and what their pixels show, proven against rendered images of a known cube."""

import itertools
from collections.abc import Iterator
from dataclasses import asdict, replace

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from duobench import Camera, point_cloud
from duobench.core.backend import DEPTH, KINDS, RGB, SEGMENTATION, CameraGeometry
from duobench.core.errors import OptionError
from duobench.core.spatial import SE3
from duobench.core.types import DuoCommand
from duobench.world.looks.catalog import look
from duobench.world.looks.look import CameraOffset, Look
from duobench.world.objects import RED, Prop, Solid, box
from duobench.world.objects.segmentation import segmentation_ids
from duobench.world.robot.camera_geometry import geometries
from duobench.world.robot.cameras import POLICY_CAMERAS, describe_cameras
from duobench.world.robot.frames import ROBOT
from duobench.world.sim.backend import SimBackend
from duobench.world.sim.simulation import Simulation

HALF = 0.05
CUBE = Prop(
    name="cube", solid=Solid(shapes=(box(2 * HALF, 2 * HALF, 2 * HALF),), rgba=RED), fixed=True
)
OWN = (
    Camera(name="side", position=(0.5, 1.2, 0.6), look_at=(0.5, 0.0, 0.1)),
    Camera(name="above", position=(0.6, 0.0, 1.4), look_at=(0.6, 0.0, 0.0), fovy_deg=35),
    Camera(
        name="palm",
        position=(0.0, 0.12, 0.0),
        look_at=(0.0, 0.15, 0.4),
        on="left_flange",
        fovy_deg=70,
    ),
    Camera(name="elbow", position=(0.2, -0.1, 0.1), look_at=(0.9, -0.3, 0.2), on="right_flange"),
)
CAMERAS = (*POLICY_CAMERAS, *OWN)
SIZES = ((224, 224), (96, 128), (120, 48), (41, 97))
LOOKS = {
    "as it is": Look(),
    "moved": look("camera_shift"),
    "wider": Look(cameras={name: CameraOffset(field_of_view=0.2) for name in POLICY_CAMERAS}),
}


@pytest.fixture(scope="module")
def backend() -> Iterator[SimBackend]:
    """Arms away from home, and a large cube that goes where it is put."""
    backend = SimBackend(Simulation([CUBE]))
    joints = backend.read().joints + np.array([[0.2, -0.1, 0.1, 0.2, -0.2, 0.3, 0.4]] * 2)
    backend.simulation.duo.set_configuration(DuoCommand(joints=joints, openings=np.ones(2)))
    backend.simulation.forward()
    yield backend
    backend.close()


def matrix(pose: SE3) -> np.ndarray:
    whole = np.eye(4)
    whole[:3, :3], whole[:3, 3] = pose.rotation, pose.translation
    return whole


def put_before(backend: SimBackend, seen: CameraGeometry, across: float, down: float) -> SE3:
    """Put the cube, turned, at 0.45 m before a camera, shifted in the image, and say where."""
    turn = SE3.about((1.0, 2.0, -1.0), 0.9)
    camera = SE3(seen.table_from_camera[:3, :3], seen.table_from_camera[:3, 3])
    pose = camera @ SE3.at(across, down, 0.45) @ turn
    backend.simulation.place("cube", pose)
    backend.simulation.forward()
    return pose


def outside(pixels: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Distance of pixels beyond the outline of corners, negative inside."""
    lines = ConvexHull(corners).equations
    return (pixels @ lines[:, :2].T + lines[:, 2]).max(axis=1)


@pytest.mark.parametrize("size", SIZES, ids=str)
@pytest.mark.parametrize("camera", CAMERAS, ids=lambda one: getattr(one, "name", one))
def test_corners_lie_on_the_outline_and_points_on_the_faces(
    backend: SimBackend, camera: str | Camera, size: tuple[int, int]
) -> None:
    name = camera if isinstance(camera, str) else camera.name
    number = segmentation_ids([CUBE])["cube"]
    for each in LOOKS.values():
        backend.set_look(each)
        backend.simulation.place("cube", SE3.at(-1.0, -1.0, -0.5))
        backend.simulation.forward()
        (seen,) = backend.camera_geometry({camera: size}).values()
        pose = put_before(backend, seen, 0.02, -0.09)
        images = backend.images_by_kind({kind: {camera: size} for kind in KINDS})
        mask = images[SEGMENTATION][name] == number
        depth = images[DEPTH][name]
        corners = pose.apply(HALF * np.array(list(itertools.product((-1, 1), repeat=3))))
        camera_from_table = np.linalg.inv(seen.table_from_camera)
        shown = corners @ camera_from_table[:3, :3].T + camera_from_table[:3, 3]
        pixels = shown @ seen.matrix.T
        pixels = pixels[:, :2] / pixels[:, 2:]
        rows, columns = np.indices(size)
        places = np.stack([columns.ravel(), rows.ravel()], axis=-1)
        distance = outside(places, pixels).reshape(size)
        assert mask.sum() > 50
        assert distance[mask].max() < 0.1, "no pixel of the cube is outside of its corners"
        assert mask[distance < -0.1].all(), "and all inside of them are pixels of it"
        cloud, colours = point_cloud(
            np.where(mask, depth, 0.0), seen.matrix, seen.table_from_camera, images[RGB][name]
        )
        assert len(cloud) == len(colours) == mask.sum()
        inside = pose.inverse().apply(cloud)
        faces = np.abs(inside).max(axis=1)
        assert np.abs(faces - HALF).max() < 1e-3
        assert np.median(np.abs(faces - HALF)) < 1e-5
    backend.set_look(Look())


def test_the_table_is_level_in_every_cloud(backend: SimBackend) -> None:
    sizes = dict.fromkeys(CAMERAS, (90, 160))
    wanted = {DEPTH: sizes, SEGMENTATION: sizes}
    images = backend.images_by_kind(wanted)
    ids = segmentation_ids([CUBE])
    for name, seen in backend.camera_geometry(sizes).items():
        table = images[SEGMENTATION][name] == ids["table"]
        depth = np.where(table, images[DEPTH][name], 0.0)
        points = point_cloud(depth, seen.matrix, seen.table_from_camera)
        assert points[:, 2].max(initial=0.0) < 1e-3
        if name in ("head", "above", "left_wrist"):  # others see its legs, or nothing of it
            assert np.mean(np.abs(points[:, 2]) < 1e-3) > 0.9, name


def test_places_are_those_that_the_model_and_exports_have(backend: SimBackend) -> None:
    """Of the model's cameras, and of `describe_cameras`, whose sizes are native."""
    simulation = backend.simulation
    seen = backend.camera_geometry(dict.fromkeys(POLICY_CAMERAS, (720, 1280)))
    for name, facts in describe_cameras().items():
        camera = simulation.model.camera(name).id
        axes = simulation.data.cam_xmat[camera].reshape(3, 3) * (1.0, -1.0, -1.0)
        assert seen[name].table_from_camera[:3, :3] == pytest.approx(axes, abs=1e-9)
        assert seen[name].table_from_camera[:3, 3] == pytest.approx(
            simulation.data.cam_xpos[camera], abs=1e-9
        )
        assert seen[name].matrix == pytest.approx(np.array(facts["intrinsics"]))


def test_a_lens_has_square_pixels_and_the_angle_that_it_was_given() -> None:
    camera = replace(OWN[0], fovy_deg=90)
    (seen,) = geometries({camera: (100, 300)}, np.zeros((2, 7)), ROBOT.gripper).values()
    assert seen.matrix.tolist() == [
        [pytest.approx(50.0), 0.0, 149.5],
        [0.0, pytest.approx(50.0), 49.5],
        [0.0, 0.0, 1.0],
    ]
    assert seen.matrix.dtype == seen.table_from_camera.dtype == np.float64


def test_a_cloud_is_what_the_formula_says_and_skips_what_has_no_depth() -> None:
    depth = np.array([[0.0, 2.0, np.nan], [1.0, np.inf, 4.0]], dtype=np.float32)
    lens = [[2.0, 0.0, 1.0], [0.0, 4.0, 0.5], [0.0, 0.0, 1.0]]
    moved = matrix(SE3.at(10.0, 20.0, 30.0))
    points = point_cloud(depth, lens, np.eye(4))
    assert points.tolist() == [[0.0, -0.25, 2.0], [-0.5, 0.125, 1.0], [2.0, 0.5, 4.0]]
    assert point_cloud(depth, lens, moved).tolist() == np.add(points, (10.0, 20.0, 30.0)).tolist()
    rgb = np.arange(18, dtype=np.uint8).reshape(2, 3, 3)
    again, colours = point_cloud(depth, lens, np.eye(4), rgb)
    assert np.array_equal(again, points)
    assert colours.tolist() == [[3, 4, 5], [9, 10, 11], [15, 16, 17]]
    assert point_cloud(np.zeros((2, 2)), lens, np.eye(4)).shape == (0, 3)
    for wrong in (
        (depth[0], lens, np.eye(4)),
        (depth, np.eye(4), np.eye(4)),
        (depth, lens, np.eye(3)),
        (depth, lens, np.eye(4), rgb[:1]),
        (depth, lens, np.eye(4), depth),
    ):
        with pytest.raises(OptionError, match="shape"):
            point_cloud(*wrong)


def test_cameras_of_ones_own_leave_the_robots_images_and_physics_alone(
    backend: SimBackend,
) -> None:
    size = (60, 80)
    alone = backend.images(POLICY_CAMERAS, size)
    state = backend.simulation.get_state().tobytes()
    kinds = {RGB: dict.fromkeys(CAMERAS, size), DEPTH: dict.fromkeys(CAMERAS, size)}
    for wanted in (kinds, {**kinds, RGB: dict.fromkeys(reversed(CAMERAS), size)}):
        together = backend.images_by_kind(wanted)[RGB]
        for name, image in alone.items():
            assert np.array_equal(image, together[name]), name
    assert backend.simulation.get_state().tobytes() == state


def test_the_same_view_is_the_same_image_as_a_cameras_of_the_model(backend: SimBackend) -> None:
    """One's own camera in the place of the head's, of square pixels: the native image."""
    seen = backend.camera_geometry({"head": (90, 160)})["head"]
    eye, ahead = seen.table_from_camera[:3, 3], seen.table_from_camera[:3, 2]
    fovy = np.degrees(2 * np.arctan(45 / seen.matrix[1, 1]))
    own = Camera(name="twin", position=eye, look_at=eye + ahead, fovy_deg=fovy)
    sizes = {"head": (90, 160), own: (90, 160)}
    images = backend.images_by_kind({RGB: sizes, DEPTH: sizes})
    difference = np.abs(images[RGB]["head"].astype(int) - images[RGB]["twin"])
    assert np.mean(difference.max(axis=2) > 2) < 0.01
    assert np.median(np.abs(images[DEPTH]["head"] - images[DEPTH]["twin"])) < 1e-5
    assert asdict(own)["position"] == pytest.approx(tuple(eye))
