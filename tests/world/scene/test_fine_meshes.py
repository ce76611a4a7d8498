"""The fine images of the robot: the file, and that they are where the robot is, without gaps."""

import itertools
import math

import mujoco
import numpy as np
import pytest

from dev.tools import fine_meshes as recipes
from dev.tools.meshes import SEAMS
from duobench.core.errors import AssetError
from duobench.core.types import SIDES, Side
from duobench.world.robot.frames import ROBOT
from duobench.world.robot.joints import JOINT_RANGES
from duobench.world.scene import fine_meshes as fine
from duobench.world.scene.compose import compose
from duobench.world.scene.fine_meshes import (
    FINISHES,
    PAD,
    FineMesh,
    FineRobot,
    decode,
    fine_meshes,
)
from duobench.world.scene.meshes import robot_meshes, shipped
from duobench.world.scene.naming import arm_joint_names, pad_names
from duobench.world.scene.robotiq_2f85 import FINGERTIP_SIZE
from duobench.world.sim.simulation import Simulation
from tests.test_repository import ROOT, tracked

GRIPPER = ROBOT.gripper

NAMES = [mesh.name for mesh in fine_meshes()]
BY_NAME = {mesh.name: mesh for mesh in fine_meshes()}
MOST_TRIANGLES = 95_000
"""Of two arms with their grippers: on a processor without a card, each takes its time."""
EXACT = 2e-6
"""Float32 and the engine's own turning of meshes, in metres."""
CLOSE = 0.00301
"""How far in metres the outlines of fine and reduced images may be apart: 3 mm, at the seams, and a
step of the grid."""
OUTSIDE = 0.25
"""Distance in metres from an axis at which a ray is outside of both links."""
RIM = 0.002
"""How far in metres inside of a link's rim the ring in a gap may be."""


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return Simulation([])


@pytest.fixture(scope="module")
def robot(simulation: Simulation) -> FineRobot:
    return FineRobot(simulation.model)


Frames = dict[tuple[str, str], tuple[np.ndarray, np.ndarray]]


@pytest.fixture(scope="module")
def frames() -> Frames:
    """Where meshes hang in their bodies as they are published, whatever the engine makes of it."""
    spec = compose()
    return {
        (geom.parent.name, geom.meshname): (np.array(geom.pos), np.array(geom.quat))
        for geom in spec.geoms
        if geom.meshname
    }


def across(mesh: FineMesh) -> np.ndarray:
    a, b, c = (mesh.vertices[mesh.faces[:, corner]].astype(float) for corner in range(3))
    return np.cross(b - a, c - a)


def pose_at_random(simulation: Simulation, seed: int) -> None:
    random = np.random.default_rng(seed)
    for side in SIDES:
        for joint, limits in zip(arm_joint_names(side), JOINT_RANGES, strict=True):
            simulation.data.joint(joint).qpos = random.uniform(*limits)
    mujoco.mj_kinematics(simulation.model, simulation.data)


def points_of(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> np.ndarray:
    """The vertices of a mesh where it is in the world."""
    asset = model.geom_dataid[geom]
    first, count = model.mesh_vertadr[asset], model.mesh_vertnum[asset]
    points = model.mesh_vert[first : first + count].astype(float)
    return points @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]


def test_the_file_is_small_and_holds_a_mesh_for_every_image_and_the_pads() -> None:
    assert len(shipped(fine.FILE)) < 1_000_000
    assert len(set(NAMES)) == len(NAMES)
    images = {
        name
        for name in robot_meshes()
        if name.endswith(":visual") and not name.startswith("franka_hand/")
    }
    assert {mesh.image for mesh in fine_meshes()} == {*images, PAD}
    assert {mesh.finish for mesh in fine_meshes()} == set(FINISHES)
    assert fine_meshes() is fine_meshes()


def test_the_notices_name_every_file_with_meshes() -> None:
    notices = (ROOT / "THIRD_PARTY_NOTICES.md").read_text(encoding="utf-8")
    files = [str(path.relative_to(ROOT)) for path in tracked("src", ".npz")]
    assert len(files) == 2
    assert [name for name in files if f"`{name}`" not in notices] == []
    for origin in {mesh.image.partition("/")[0] for mesh in fine_meshes()} - {PAD}:
        assert f"`{origin}/`, in both files" in notices


@pytest.mark.parametrize("share", [0.0, 0.25, 0.75])
def test_a_flipped_bit_or_an_end_anywhere_is_found(share: float) -> None:
    data = bytearray(shipped(fine.FILE))
    place = int(len(data) * share)
    with pytest.raises(AssetError, match="Install duobench again"):
        decode(bytes(data[:place]))
    data[place] ^= 1
    with pytest.raises(AssetError, match=r"robot_meshes_fine\.npz"):
        decode(bytes(data))


@pytest.mark.parametrize("name", NAMES)
def test_every_vertex_is_used_and_no_triangle_is_seen_from_behind(name: str) -> None:
    mesh = BY_NAME[name]
    for array in (mesh.vertices, mesh.normals, mesh.faces):
        assert not array.flags.writeable
    assert sorted(set(mesh.faces.ravel().tolist())) == list(range(len(mesh.vertices)))
    normals = across(mesh)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    assert (lengths > 0).all()
    assert np.linalg.norm(mesh.normals, axis=1) == pytest.approx(1.0, abs=1e-3)
    turned = np.einsum("fx,fcx->fc", normals / lengths, mesh.normals[mesh.faces])
    assert turned.min() > math.cos(math.radians(41.0))


def test_the_model_is_not_written_to(simulation: Simulation) -> None:
    def packed() -> bytes:
        content = np.empty(mujoco.mj_sizeModel(simulation.model), dtype=np.uint8)
        mujoco.mj_saveModel(simulation.model, None, content)
        return content.tobytes() + simulation.data.geom_xpos.tobytes()

    before = packed()
    FineRobot(simulation.model).follow(simulation.data)
    assert packed() == before


def test_a_model_without_a_robot_has_none() -> None:
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><geom size='1'/></worldbody></mujoco>"
    )
    robot = FineRobot(model)
    robot.follow(mujoco.MjData(model))
    assert (robot.model.ngeom, len(robot.geoms), robot.finishes) == (0, 0, ())


def test_the_images_carry_no_mass_and_no_contacts_and_are_not_too_many(robot: FineRobot) -> None:
    model = robot.model
    assert model.ngeom == len(robot.finishes) == len(robot.geoms)
    assert not model.geom_contype.any()
    assert not model.geom_conaffinity.any()
    assert model.mesh_facenum[model.geom_dataid].sum() <= MOST_TRIANGLES
    assert model.nmesh == len(NAMES)


def test_every_visible_mesh_of_the_robot_has_a_fine_one(
    simulation: Simulation, robot: FineRobot
) -> None:
    model = simulation.model
    seen = {
        geom
        for geom in np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_MESH).tolist()
        if model.mesh(int(model.geom_dataid[geom])).name.endswith(":visual")
    }
    pads = {int(model.body(name).geomadr[0]) for side in SIDES for name in pad_names(side, GRIPPER)}
    assert len(pads) == 4
    assert set(robot.geoms.tolist()) == seen | pads


@pytest.mark.parametrize("seed", range(3))
def test_every_fine_mesh_is_where_its_body_is(
    simulation: Simulation, robot: FineRobot, frames: Frames, seed: int
) -> None:
    pose_at_random(simulation, seed)
    robot.follow(simulation.data)
    for number, geom in enumerate(robot.geoms.tolist()):
        name = robot.model.mesh(int(robot.model.geom_dataid[number])).name
        body = simulation.model.body(int(simulation.model.geom_bodyid[geom])).name
        pose = simulation.pose(body)
        mesh = BY_NAME[name]
        if mesh.image == PAD:
            points = mesh.vertices + simulation.model.geom_pos[geom]
        else:
            position, wxyz = frames[body, mesh.image]
            matrix = np.empty(9)
            mujoco.mju_quat2Mat(matrix, wxyz / np.linalg.norm(wxyz))
            points = mesh.vertices @ matrix.reshape(3, 3).T + position
        apart = points_of(robot.model, robot.data, number) - pose.apply(points.astype(float))
        assert np.abs(apart).max() < EXACT, name


@pytest.mark.parametrize("side", SIDES)
def test_fine_and_reduced_images_have_the_same_outlines(
    simulation: Simulation, robot: FineRobot, side: Side
) -> None:
    simulation.data.qpos[simulation.duo.joints[side.index]] = ROBOT.home_command.joints[side.index]
    mujoco.mj_kinematics(simulation.model, simulation.data)
    robot.follow(simulation.data)
    boxes: list[dict[str, list[np.ndarray]]] = [{}, {}]
    for geom in sorted(set(robot.geoms.tolist())):
        body = simulation.model.body(int(simulation.model.geom_bodyid[geom])).name
        if not body.startswith(side) or body in pad_names(side, GRIPPER):
            continue
        frame = simulation.pose(body).inverse()
        ours = [
            number
            for number in np.flatnonzero(robot.geoms == geom).tolist()
            if robot.finishes[number] != "joint"  # which reaches into the next link
        ]
        for box, model, data, geoms in (
            (boxes[0], simulation.model, simulation.data, [geom]),
            (boxes[1], robot.model, robot.data, ours),
        ):
            box.setdefault(body, []).extend(
                frame.apply(points_of(model, data, each)) for each in geoms
            )
    assert len(boxes[0]) == 17
    for body, reduced in boxes[0].items():
        low, high = np.vstack(reduced).min(axis=0), np.vstack(reduced).max(axis=0)
        points = np.vstack(boxes[1][body])
        assert points.min(axis=0) == pytest.approx(low, abs=CLOSE), body
        assert points.max(axis=0) == pytest.approx(high, abs=CLOSE), body


@pytest.mark.parametrize("number", range(1, 8))
@pytest.mark.parametrize("side", SIDES)
def test_no_background_shines_through_between_two_links(
    simulation: Simulation, robot: FineRobot, side: Side, number: int
) -> None:
    """A ray to the axis of a joint meets a link, or the ring in the gap, no deeper than that."""
    model, data = simulation.model, simulation.data
    # Beside the edges between two triangles of a ring, which a ray may miss.
    angles = np.linspace(0.01, 2 * math.pi + 0.01, 90, endpoint=False)
    seam, radius = SEAMS[number]
    which = np.zeros(1, dtype=np.int32)
    for turn in np.linspace(*JOINT_RANGES[number - 1], 3):
        data.qpos[simulation.duo.joints[side.index, number - 1]] = turn
        mujoco.mj_kinematics(model, data)
        robot.follow(data)
        joint = simulation.pose(f"{side}/link{number}")
        for angle, height in itertools.product(angles, np.linspace(-0.004, 0.004, 9)):
            away = joint.rotation @ np.array([math.cos(angle), math.sin(angle), 0.0])
            eye = joint.apply(np.array([0.0, 0.0, seam + height])) + OUTSIDE * away
            met = mujoco.mj_ray(robot.model, robot.data, eye, -away, None, 1, -1, which)
            assert 0.0 <= met <= OUTSIDE - radius + RIM + 0.0005, (turn, angle, height)


@pytest.mark.parametrize("side", SIDES)
def test_a_pad_of_rubber_is_what_a_fingertip_meets_first(
    simulation: Simulation, robot: FineRobot, side: Side
) -> None:
    """A ray from between the pads meets rubber within a quarter of a millimetre of the contact."""
    robot.follow(simulation.data)
    which = np.zeros(1, dtype=np.int32)
    for name in pad_names(side, GRIPPER):
        pad = simulation.pose(name)
        box = simulation.model.geom(int(simulation.model.body(name).geomadr[0]))
        face, high = box.pos[0] + box.size[0], box.pos[2] + box.size[2]
        for across_m, along in itertools.product((-0.009, 0.0, 0.009), (-0.017, 0.0, 0.017)):
            eye = pad.apply(np.array([face + 0.01, across_m, high + along]))
            met = mujoco.mj_ray(
                robot.model, robot.data, eye, -pad.rotation[:, 0], None, 1, -1, which
            )
            assert met == pytest.approx(0.01, abs=0.00025)
            assert robot.finishes[which[0]] == "rubber"


def test_rings_and_pads_are_those_of_the_recipes() -> None:
    first = {number: next(iter(recipes.RECIPES[number])) for number in SEAMS}
    made = [recipes.pad(), *(recipes.ring(number, image) for number, image in first.items())]
    for mesh in recipes.meshes_of(made):
        found = BY_NAME[mesh.name]
        assert found.vertices == pytest.approx(mesh.vertices, abs=1e-7)
        assert found.normals == pytest.approx(mesh.normals, abs=1e-6)
        assert (found.faces == mesh.faces).all()
    assert FINGERTIP_SIZE[1] < recipes.PAD_SIZE[1]
    assert GRIPPER.pads == ("left_pad", "right_pad")
