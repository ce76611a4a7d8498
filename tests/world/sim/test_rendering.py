"""Images of real scenes, drawn for real."""

import gc
import os
import warnings
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import mujoco
import numpy as np
import pytest

from duobench.core.backend import DEPTH, KINDS, RGB, SEGMENTATION
from duobench.core.errors import RenderingError, UnknownNameError
from duobench.core.spatial import SE3
from duobench.tasks import catalog
from duobench.world.looks.catalog import look
from duobench.world.looks.look import CLASSIC, Look
from duobench.world.objects.blocks import RED, cube
from duobench.world.objects.prop import Prop
from duobench.world.objects.segmentation import segmentation_ids
from duobench.world.robot.cameras import (
    CAMERAS,
    FARTHEST,
    HEAD,
    HEAD_POSITION,
    OVERVIEW,
    POLICY_CAMERAS,
    Camera,
)
from duobench.world.robot.workcell import TABLE_X, TABLE_Y
from duobench.world.scene.surfaces import (
    COLLISION_GEOM_GROUP,
    SHADOWLESS_GEOM_GROUP,
    VISUAL_GEOM_GROUP,
)
from duobench.world.sim import rendering, rendering_process
from duobench.world.sim.offscreen import FURNITURE
from duobench.world.sim.opengl import BACKENDS
from duobench.world.sim.rendering import Renderer
from duobench.world.sim.segmentation import labels_of
from duobench.world.sim.simulation import Simulation
from tests.envs.tools import equal

SIZE = 96


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    simulation = Simulation([Prop(name="cube", solid=cube(RED), fixed=True)])
    simulation.place("cube", SE3.at(0.6, 0.0, 0.016))
    simulation.forward()
    return simulation


@pytest.fixture(scope="module")
def renderer(simulation: Simulation) -> Iterator[Renderer]:
    with Renderer(simulation.model, height=SIZE, width=SIZE) as renderer:
        yield renderer


def test_an_image_is_an_upright_colour_image(simulation: Simulation, renderer: Renderer) -> None:
    image = renderer.render(simulation.data, HEAD)
    assert image.shape == (SIZE, SIZE, 3)
    assert image.dtype == np.uint8
    assert image.flags.c_contiguous
    # The head sees the wooden table below and the bluish wall above.
    below, above = image[-10:].mean(axis=(0, 1)), image[:10].mean(axis=(0, 1))
    assert below[0] > below[2]
    assert above[2] > above[0]
    # The red cube lies on the table straight ahead.
    red = (image[..., 0] > 120) & (image[..., 1] < 80)
    rows, columns = np.nonzero(red)
    assert columns.mean() == pytest.approx(SIZE / 2, abs=3)
    assert rows.mean() > SIZE / 2


def test_every_image_is_a_new_array_and_the_same(
    simulation: Simulation, renderer: Renderer
) -> None:
    first, second = (renderer.render(simulation.data, HEAD) for _ in range(2))
    assert np.array_equal(first, second)
    kept = first.copy()
    second[:] = 0
    renderer.render(simulation.data, OVERVIEW)
    assert np.array_equal(first, kept)


def test_images_of_one_observation_are_those_drawn_one_by_one(
    simulation: Simulation, renderer: Renderer
) -> None:
    together = renderer.render_all(simulation.data, POLICY_CAMERAS)
    assert tuple(together) == POLICY_CAMERAS
    for camera, image in together.items():
        assert np.array_equal(image, renderer.render(simulation.data, camera)), camera


def test_shadows_follow_the_state(simulation: Simulation, renderer: Renderer) -> None:
    before = renderer.render_all(simulation.data, POLICY_CAMERAS)
    simulation.place("cube", SE3.at(0.6, 0.0, 0.15))
    simulation.forward()
    after = renderer.render_all(simulation.data, POLICY_CAMERAS)
    alone = renderer.render(simulation.data, POLICY_CAMERAS[-1])
    simulation.place("cube", SE3.at(0.6, 0.0, 0.016))
    simulation.forward()
    assert not np.array_equal(before[POLICY_CAMERAS[-1]], after[POLICY_CAMERAS[-1]])
    assert np.array_equal(after[POLICY_CAMERAS[-1]], alone)


def test_shadows_fall_where_the_lamp_is_hidden(simulation: Simulation) -> None:
    model, data = simulation.model, simulation.data
    with Renderer(model, height=480, width=640) as renderer:
        image = renderer.render(data, OVERVIEW).mean(axis=2)
        table = renderer.segment(data, OVERVIEW) == model.geom("table").id
    light = next(n for n in range(model.nlight) if model.light_castshadow[n])
    to_lamp = -data.light_xdir[light]
    number = model.camera(OVERVIEW).id
    eye, turn = data.cam_xpos[number], data.cam_xmat[number].reshape(3, 3)
    scale = 2 * np.tan(np.radians(model.cam_fovy[number]) / 2) / 480
    groups = np.zeros(6, dtype=np.uint8)
    groups[VISUAL_GEOM_GROUP] = 1
    rng = np.random.default_rng(0)
    lit, dark = [], []
    for row, column in rng.permutation(np.argwhere(table))[:1500]:
        ray = turn @ [(column - 319.5) * scale, (239.5 - row) * scale, -1.0]
        point = eye - ray * eye[2] / ray[2]
        if not (TABLE_X[0] < point[0] < TABLE_X[1] and TABLE_Y[0] < point[1] < TABLE_Y[1]):
            continue  # a side of the table top
        hit = np.full(1, -1, dtype=np.int32)
        distance = mujoco.mj_ray(model, data, point, to_lamp, groups, 1, -1, hit)
        (lit if distance < 0 else dark).append(image[row, column])
    assert len(dark) > 50
    border = (np.median(lit) + np.median(dark)) / 2
    assert np.median(dark) < 0.75 * np.median(lit)
    # Pixels at the very edge of a shadow may be on the other side of it.
    assert np.mean(np.array(lit) > border) > 0.98
    assert np.mean(np.array(dark) < border) > 0.90


def test_only_what_is_meant_to_be_seen_is_drawn(simulation: Simulation, renderer: Renderer) -> None:
    images = [renderer.segment(simulation.data, each) for each in (*POLICY_CAMERAS, OVERVIEW)]
    seen = np.unique(images)
    groups = set(simulation.model.geom_group[seen].tolist())
    assert groups == {SHADOWLESS_GEOM_GROUP, VISUAL_GEOM_GROUP}
    assert (simulation.model.geom_group == COLLISION_GEOM_GROUP).any()
    assert simulation.model.geom("cube:0").id in seen


def test_an_average_of_many_images_has_smooth_edges(simulation: Simulation) -> None:
    def drawn(samples: int) -> np.ndarray:
        with Renderer(simulation.model, height=120, width=160, samples=samples) as renderer:
            return renderer.render(simulation.data, OVERVIEW).astype(np.int64)

    plain, smooth = drawn(1), drawn(16)
    assert np.abs(plain - smooth).mean() < 4.0
    assert np.median(np.abs(plain - smooth)) <= 1.0

    def steps(image: np.ndarray) -> float:
        return float(np.percentile(np.abs(np.diff(image.sum(axis=2), axis=1)), 99))

    assert steps(smooth) < 0.9 * steps(plain)


def test_an_unknown_camera_is_named_with_near_misses(
    simulation: Simulation, renderer: Renderer
) -> None:
    with pytest.raises(UnknownNameError, match=r"'left_wirst'.*Did you mean 'left_wrist'"):
        renderer.render(simulation.data, "left_wirst")
    with pytest.raises(UnknownNameError, match="camera"):
        renderer.segment(simulation.data, "")


@pytest.mark.parametrize(
    ("height", "width", "samples", "words"),
    [
        (721, 224, 1, "224x721.*1280x720"),
        (224, 1281, 1, "1281x224.*1280x720"),
        (0, 224, 1, "224x0.*1280x720"),
        (224, -1, 1, "-1x224.*1280x720"),
        (8, 8, 0, "1 to 64, got 0"),
        (8, 8, 65, "1 to 64, got 65"),
    ],
)
def test_a_size_beyond_the_native_one_or_a_senseless_number_of_samples_is_refused(
    simulation: Simulation, height: int, width: int, samples: int, words: str
) -> None:
    with pytest.raises(RenderingError, match=words):
        Renderer(simulation.model, height=height, width=width, samples=samples)


@pytest.mark.parametrize("is_used", [True, False])
def test_a_closed_renderer_says_so(simulation: Simulation, is_used: bool) -> None:
    renderer = Renderer(simulation.model, height=8, width=8)
    if is_used:
        renderer.render(simulation.data, HEAD)
    renderer.close()
    renderer.close()
    with pytest.raises(RenderingError, match="closed"):
        renderer.render(simulation.data, HEAD)


def test_renderers_of_several_models_do_not_disturb_each_other(
    simulation: Simulation, renderer: Renderer
) -> None:
    alone = renderer.render(simulation.data, HEAD)
    bare = Simulation()
    with (
        Renderer(bare.model, height=48, width=64) as other,
        Renderer(simulation.model, height=SIZE, width=SIZE) as twin,
    ):
        small = other.render(bare.data, HEAD)
        assert np.array_equal(twin.render(simulation.data, HEAD), alone)
        assert np.array_equal(renderer.render(simulation.data, HEAD), alone)
        assert np.array_equal(other.render(bare.data, HEAD), small)
    assert np.array_equal(renderer.render(simulation.data, HEAD), alone)


def test_a_renderer_may_be_used_from_any_thread(simulation: Simulation, renderer: Renderer) -> None:
    with ThreadPoolExecutor() as pool:
        there = pool.submit(renderer.render, simulation.data, HEAD).result()
    assert np.array_equal(there, renderer.render(simulation.data, HEAD))


@pytest.mark.parametrize("how", ["closed", "dropped"])
def test_a_renderer_that_is_gone_is_freed_with_the_next_image(
    simulation: Simulation, renderer: Renderer, how: str
) -> None:
    gone = Renderer(simulation.model, height=8, width=8)
    gone.render(simulation.data, HEAD)
    process, key = rendering_process.current(), gone._counterparts[CLASSIC].key
    if how == "closed":
        gone.close()
    del gone
    gc.collect()
    renderer.render(simulation.data, HEAD)
    with pytest.raises(RenderingError, match="An image could not be rendered"):
        process.ask("set_appearance", key, None)


@pytest.mark.parametrize("which", ["inherited", "new"])
def test_a_process_that_was_forked_from_one_that_rendered_gets_the_same_images(
    simulation: Simulation, renderer: Renderer, which: str
) -> None:
    before = renderer.render(simulation.data, HEAD)
    with warnings.catch_warnings():
        # Newer interpreters warn about forks with threads: that is what is tried here.
        warnings.simplefilter("ignore", DeprecationWarning)
        child = os.fork()
    if child == 0:
        try:
            if which == "new":
                renderer = Renderer(simulation.model, height=SIZE, width=SIZE)
            same = np.array_equal(renderer.render(simulation.data, HEAD), before)
            rendering_process.current().end()
            os._exit(0 if same else 2)
        finally:
            os._exit(1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    assert np.array_equal(renderer.render(simulation.data, HEAD), before)


def test_what_draws_is_described(renderer: Renderer) -> None:
    info = rendering.describe()
    assert info == renderer.info
    assert info.backend in BACKENDS
    assert all((info.renderer, info.vendor, info.version[0].isdigit()))


ALL = {kind: dict.fromkeys(POLICY_CAMERAS, (SIZE, SIZE)) for kind in KINDS}


def test_depth_and_parts_are_of_the_same_state_and_leave_colours_alone(
    simulation: Simulation, renderer: Renderer
) -> None:
    alone = renderer.render_all(simulation.data, POLICY_CAMERAS)
    images = renderer.render_kinds(simulation.data, ALL)
    assert equal(images[RGB], alone)
    for name in POLICY_CAMERAS:
        depth, geoms = images[DEPTH][name], images[SEGMENTATION][name]
        assert (depth.dtype, geoms.dtype) == (np.float32, np.int32)
        assert depth.shape == geoms.shape == (SIZE, SIZE)
        assert np.array_equal(geoms, renderer.segment(simulation.data, name))
        assert ((depth > 0.0) == (geoms >= 0)).all()
    again = renderer.render_kinds(simulation.data, ALL)
    assert equal(again, images)
    kept = images[DEPTH][HEAD].copy()
    again[DEPTH][HEAD][:] = 0.0
    assert np.array_equal(images[DEPTH][HEAD], kept)


def test_rays_of_the_engine_are_as_long(simulation: Simulation) -> None:
    """The middle of each pixel shows what a ray through it meets, a tenth of a millimetre exact."""
    model, data = simulation.model, simulation.data
    size = (72, 128)
    with Renderer(model, height=size[0], width=size[1]) as renderer:
        depth = renderer.render_kinds(data, {DEPTH: {HEAD: size}})[DEPTH][HEAD]
    camera, focal = model.camera(HEAD).id, CAMERAS[HEAD].focal / 10
    turn = data.cam_xmat[camera].reshape(3, 3)
    groups = (np.arange(6) < 3).astype(np.uint8)
    errors = []
    for row, column in np.random.default_rng(0).integers((5, 5), (67, 123), (200, 2)):
        ray = turn @ [(column - 63.5) / focal, (35.5 - row) / focal, -1.0]
        hit = np.full(1, -1, dtype=np.int32)
        eye = data.cam_xpos[camera]
        length = mujoco.mj_ray(model, data, eye, ray, groups, 1, -1, hit)
        around_it = depth[row - 1 : row + 2, column - 1 : column + 2]
        if np.ptp(around_it) < 0.05 * depth[row, column]:  # no edge
            errors.append(abs(length - depth[row, column]))
    assert len(errors) > 100
    assert np.percentile(errors, 95) < 1e-4


def test_a_far_plane_is_where_it_is_said(simulation: Simulation) -> None:
    model = simulation.model
    assert model.vis.map.zfar * model.stat.extent == pytest.approx(FARTHEST)
    away = Camera(name="away", position=(2.9, 2.2, 1.8), look_at=(-1.6, -2.3, -0.8), fovy_deg=20)
    size = (40, 40)
    with Renderer(model, height=40, width=40) as renderer:
        images = renderer.render_kinds(simulation.data, {DEPTH: {away: size}, RGB: {away: size}})
    depth = images[DEPTH]["away"]
    assert depth.max() < FARTHEST
    assert (depth > 6.5).any()


@pytest.mark.parametrize("samples", [1, 4])
def test_what_a_look_does_to_colours_leaves_depth_and_parts_alone(
    simulation: Simulation, samples: int
) -> None:
    measured = {kind: ALL[kind] for kind in (DEPTH, SEGMENTATION)}
    with Renderer(simulation.model, height=SIZE, width=SIZE, samples=samples) as renderer:
        before = renderer.render_kinds(simulation.data, measured)
        for name in ("noisy", "dark", "wood_table", "textured_objects"):
            renderer.set_look(look(name))
            images = renderer.render_kinds(simulation.data, ALL)
            assert equal({kind: images[kind] for kind in measured}, before), name
        renderer.set_look(look("camera_shift"))
        moved = renderer.render_kinds(simulation.data, ALL)
        assert not equal(moved[DEPTH], before[DEPTH])


def test_furniture_of_a_look_has_depth_and_belongs_to_no_geom(
    simulation: Simulation, renderer: Renderer
) -> None:
    measured = {kind: ALL[kind] for kind in (DEPTH, SEGMENTATION)}
    before = renderer.render_kinds(simulation.data, measured)
    renderer.set_look(Look(clutter=40, seed=1))
    after = renderer.render_kinds(simulation.data, measured)
    alone = renderer.segment(simulation.data, HEAD)
    renderer.set_look(Look())
    geoms, depth = after[SEGMENTATION][HEAD], after[DEPTH][HEAD]
    furniture = geoms == FURNITURE
    assert 0.01 < furniture.mean() < 0.5
    assert (depth[furniture] < before[DEPTH][HEAD][furniture]).all()
    assert np.array_equal(depth[~furniture], before[DEPTH][HEAD][~furniture])
    assert np.array_equal(alone, before[SEGMENTATION][HEAD])


def test_sizes_of_one_request_are_those_of_each_alone(simulation: Simulation) -> None:
    sizes = {"head": (96, 128), "left_wrist": (41, 30), "right_wrist": (60, 128)}
    with Renderer(simulation.model, height=96, width=128) as renderer:
        together = renderer.render_kinds(simulation.data, dict.fromkeys(KINDS, sizes))
        both = renderer.render_kinds(simulation.data, {RGB: sizes, DEPTH: {HEAD: (20, 20)}})
        with pytest.raises(RenderingError, match="at most 128x96, got 128x97"):
            renderer.render_kinds(simulation.data, {RGB: {HEAD: (97, 128)}})
        with pytest.raises(UnknownNameError, match="'hed'"):
            renderer.render_kinds(simulation.data, {DEPTH: {"hed": (9, 9)}})
    assert both[DEPTH][HEAD].shape == (20, 20)
    assert equal(both[RGB], together[RGB])
    for name, (height, width) in sizes.items():
        with Renderer(simulation.model, height=height, width=width) as renderer:
            wanted = {kind: {name: (height, width)} for kind in KINDS}
            alone = renderer.render_kinds(simulation.data, wanted)
        for kind in KINDS:
            assert np.array_equal(alone[kind][name], together[kind][name]), (name, kind)


@pytest.mark.parametrize("task", catalog.names())
def test_every_part_has_a_number_of_its_own(task: str) -> None:
    definition = catalog.get(task)
    model = Simulation(definition.props).model
    ids = segmentation_ids(definition.props)
    assert list(ids.values()) == list(range(1, len(ids) + 1))
    assert list(ids)[:3] == ["table", "room", "left_arm"]
    labels = labels_of(model, ids)
    visible = model.geom_group < COLLISION_GEOM_GROUP
    assert set(labels[: model.ngeom][visible]) == set(ids.values())
    assert labels[[FURNITURE, -1]].tolist() == [ids["room"], 0]
    for name, number in ids.items():
        bodies = {model.body(int(b)).name for b in model.geom_bodyid[labels[:-2] == number]}
        ours = {
            "table": {"table", "world"},
            "room": {"floor", "world"},
            "mount": {"world"},
            "camera": {"world", "left/link7", "right/link7"},
        }
        if name.endswith(("_arm", "_gripper")):
            prefix = name.replace("_gripper", "/gripper").replace("_arm", "/link")
            assert all(body.startswith(prefix) for body in bodies), name
        else:
            assert bodies == ours.get(name, {name})


def test_parts_of_the_workcell_are_where_they_are_seen() -> None:
    """Of what is on the world's body, whose shapes have no names."""
    simulation = Simulation()
    model, ids = simulation.model, segmentation_ids(())
    labels = labels_of(model, ids)
    world = np.flatnonzero(model.geom_bodyid == 0)
    places = {name: simulation.data.geom_xpos[world[labels[world] == ids[name]]] for name in ids}
    assert (places["table"][:, 2] < 0.0).all()
    assert len(places["table"]) == len(("leg",) * 4 + ("rail",) * 4)
    assert (np.abs(places["mount"][:, 1]) < 0.05).all()
    assert (places["mount"][:, 2] > 0.0).all()
    assert np.abs(places["camera"] - HEAD_POSITION).max() < 0.1
    assert (np.abs(places["room"][:, :2]).max(axis=1) > 0.6).all()
