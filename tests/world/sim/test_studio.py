"""Looks of the studio in images; what needs no Vulkan is at the end."""

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest

from duobench.core.backend import DEPTH, RGB, SEGMENTATION
from duobench.core.errors import RenderingError
from duobench.core.spatial import SE3
from duobench.world.looks.catalog import LOOKS, look
from duobench.world.looks.look import CLASSIC, STUDIO, CameraOffset, Light, Look, Material
from duobench.world.objects import WHITE, Image, Prop, Solid, block, box, printable
from duobench.world.objects.solid import Texture
from duobench.world.robot.cameras import HEAD, OVERVIEW, POLICY_CAMERAS, Camera
from duobench.world.scene.naming import TABLE
from duobench.world.sim import rendering_process
from duobench.world.sim.layout import Layout
from duobench.world.sim.opengl import VULKAN
from duobench.world.sim.rendering import Renderer, describe
from duobench.world.sim.simulation import Simulation
from tests.quick_first import quick_first
from tests.world.sim.props import at_reset

SIZE = 96
Draw = Callable[..., np.ndarray]
Point = tuple[float, float, float]
NAMES = [name for name, each in LOOKS.items() if each.renderer == STUDIO]
ROOM = look("studio")


@pytest.fixture(scope="module")
def _vulkan() -> None:
    try:
        describe(STUDIO)
    except RenderingError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return at_reset("bin_sort", seed=0)


@pytest.fixture(scope="module")
def renderer(simulation: Simulation, _vulkan: None) -> Iterator[Renderer]:
    with Renderer(simulation.model, height=SIZE, width=SIZE) as one:
        yield one


@pytest.fixture
def draw(simulation: Simulation, renderer: Renderer) -> Draw:
    """An image of a camera in a look."""

    def drawn(look: Look = ROOM, camera: str = HEAD) -> np.ndarray:
        renderer.set_look(look)
        return renderer.render(simulation.data, camera)

    return drawn


def test_an_image_depends_on_look_and_state_alone(simulation: Simulation, draw: Draw) -> None:
    plain = draw(Look())
    first = {name: draw(look(name)) for name in NAMES}
    rendering_process.current(VULKAN).end()
    again = {name: draw(look(name)) for name in reversed(NAMES)}
    assert all(np.array_equal(first[name], again[name]) for name in NAMES)
    with Renderer(simulation.model, height=48, width=48, look=ROOM) as other:
        small = other.render(simulation.data, OVERVIEW)
        assert np.array_equal(draw(), first["studio"])
        assert np.array_equal(other.render(simulation.data, OVERVIEW), small)
    assert np.array_equal(draw(Look()), plain)
    assert np.array_equal(draw(), first["studio"])


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("camera", quick_first([OVERVIEW, *POLICY_CAMERAS], quick=2))
def test_images_are_neither_dark_nor_burnt(draw: Draw, name: str, camera: str) -> None:
    image = draw(look(name), camera)
    assert 80 < image.mean() < 180
    assert np.mean(image.min(axis=2) >= 254) < 0.01
    assert np.mean(image.max(axis=2) <= 8) < 0.02


@pytest.mark.parametrize("offset", [CameraOffset(), CameraOffset(position=(0.1, 0.05, 0.0))])
def test_it_shows_what_the_classic_renderer_shows(
    simulation: Simulation, renderer: Renderer, draw: Draw, offset: CameraOffset
) -> None:
    red = {"white_bowl": Material(colour=(0.9, 0.0, 0.0))}
    image = draw(Look(renderer=STUDIO, objects=red, cameras={HEAD: offset})).astype(int)
    seen = image[..., 0] - image[..., 1:].max(axis=2) > 50
    geoms = renderer.segment(simulation.data, HEAD)
    bodies = np.where(geoms >= 0, simulation.model.geom_bodyid[geoms], -1)
    bowl = bodies == simulation.model.body("white_bowl").id
    assert bowl.sum() > 100
    assert np.sum(seen & bowl) > 0.9 * np.sum(seen | bowl)


def test_shadows_fall_on_the_table(simulation: Simulation, renderer: Renderer, draw: Draw) -> None:
    light = Light(position=(0.95, 1.05, 2.7), shadow=True)
    with_them = draw(replace(ROOM, lights=(light,)), OVERVIEW).astype(int)
    without = draw(replace(ROOM, lights=(replace(light, shadow=False),)), OVERVIEW)
    table = renderer.segment(simulation.data, OVERVIEW) == simulation.model.geom(TABLE).id
    darker = without.sum(axis=2) - with_them.sum(axis=2) > 30
    assert 0.03 < darker[table].mean() < 0.5


@pytest.fixture(scope="module")
def plain(simulation: Simulation, renderer: Renderer) -> np.ndarray:
    """An image of the studio as it is."""
    renderer.set_look(ROOM)
    return renderer.render(simulation.data, HEAD).astype(int)


@pytest.mark.parametrize(
    "other",
    [
        replace(ROOM, parts={"table": Material(colour=(0.2, 0.3, 0.8))}),
        replace(ROOM, parts={**ROOM.parts, "walls": Material(texture="bricks")}),
        replace(ROOM, objects={"*": Material(texture="speckle", contrast=0.9)}),
        replace(ROOM, colour_variation=1.0),
        replace(ROOM, clutter=40, seed=1),
        replace(ROOM, ambient=(0.1, 0.1, 0.1)),
        replace(ROOM, lights=(Light(position=(0, -2, 1)), Light(position=(2, 2, 2)))),
        replace(ROOM, exposure=-1.0),
        replace(ROOM, blur=0.02),
        replace(ROOM, noise=0.05),
        replace(look("random:4"), renderer=STUDIO),
    ],
)
def test_all_that_a_look_may_change_changes_the_image(
    draw: Draw, plain: np.ndarray, other: Look
) -> None:
    changed = np.abs(draw(other) - plain).max(axis=2) > 4
    assert changed.mean() > 0.002
    assert np.array_equal(draw(), plain)


def test_a_model_that_changes_is_shown_as_it_is(draw: Draw, simulation: Simulation) -> None:
    plain = draw()
    geom = simulation.model.geom(TABLE).id
    before = simulation.model.geom_rgba[geom].copy()
    bare = Look(renderer=STUDIO)
    first = draw(bare)
    simulation.model.geom_rgba[geom] = (0.1, 0.1, 0.8, 1.0)
    assert not np.array_equal(draw(bare), first)
    simulation.model.geom_rgba[geom] = before
    assert np.array_equal(draw(bare), first)
    assert np.array_equal(draw(), plain)


def test_what_a_model_hides_is_not_there_nor_its_shadow(draw: Draw, simulation: Simulation) -> None:
    plain, state = draw(), simulation.get_state()
    geoms = simulation.model.geom_bodyid == simulation.model.body("black_bowl").id
    opacity = simulation.model.geom_rgba[geoms, 3].copy()
    simulation.model.geom_rgba[geoms, 3] = 0.0
    hidden = draw()
    simulation.model.geom_rgba[geoms, 3] = opacity
    simulation.place("black_bowl", SE3.at(z=-2.0))
    simulation.forward()
    away = draw().astype(int)
    simulation.set_state(state)
    assert np.array_equal(draw(), plain)
    # A shadow map takes in all that is there, so that other texels of it fall on an edge.
    assert np.mean(np.abs(away - hidden).max(axis=2) > 8) < 0.005
    assert np.mean(np.abs(away - plain).max(axis=2) > 8) > 0.01


def test_depth_and_parts_are_those_of_the_classic_renderer_beside_its_colours(
    simulation: Simulation, renderer: Renderer
) -> None:
    moved = replace(ROOM, cameras={HEAD: CameraOffset(position=(0.1, 0.05, 0.0))})
    whole, half = (SIZE, SIZE), (SIZE // 2, SIZE * 3 // 4)
    kinds = {DEPTH: {HEAD: half}, SEGMENTATION: {HEAD: half, OVERVIEW: whole}}
    renderer.set_look(moved)
    found = renderer.render_kinds(simulation.data, {RGB: {HEAD: half, OVERVIEW: whole}, **kinds})
    alone = renderer.render_all(simulation.data, [OVERVIEW])
    renderer.set_look(replace(moved, renderer=CLASSIC))
    classic = renderer.render_kinds(simulation.data, kinds)
    assert {name: image.shape[:2] for name, image in found[RGB].items()} == {
        HEAD: half,
        OVERVIEW: whole,
    }
    assert np.array_equal(found[RGB][OVERVIEW], alone[OVERVIEW])
    for kind, images in classic.items():
        assert images.keys() == found[kind].keys()
        assert all(np.array_equal(image, found[kind][name]) for name, image in images.items())


@pytest.mark.parametrize(
    ("on", "position", "look_at"),
    [
        ("table", (0.2, -0.9, 0.6), (0.5, 0.0, 0.0)),
        ("left_flange", (0.12, 0.05, 0.0), (0.12, 0.0, 0.4)),
    ],
)
def test_cameras_of_ones_own_show_what_the_classic_renderer_shows(
    simulation: Simulation, renderer: Renderer, on: str, position: Point, look_at: Point
) -> None:
    camera = Camera(name="side", position=position, look_at=look_at, on=on)
    wanted = {camera: (SIZE // 2, SIZE), replace(camera, name="small"): (SIZE // 3, SIZE // 4)}
    red = {"table": Material(colour=(0.9, 0.0, 0.0))}
    renderer.set_look(Look(renderer=STUDIO, parts=red))
    found = renderer.render_kinds(simulation.data, {RGB: wanted, SEGMENTATION: wanted})
    for one in wanted:
        image = found[RGB][one.name].astype(int)
        seen = image[..., 0] - image[..., 1:].max(axis=2) > 50
        table = found[SEGMENTATION][one.name] == simulation.model.geom(TABLE).id
        assert 0.1 < table.mean() < 0.9
        assert np.sum(seen & table) > 0.9 * np.sum(seen | table)


@pytest.mark.usefixtures("_vulkan")
def test_an_object_keeps_a_texture_of_its_own_unless_a_look_has_another() -> None:
    mesh = printable(block(0.1, 0.1, 0.1, WHITE))
    texels = np.zeros((2, 1, 3), dtype=np.uint8)
    texels[0, 0] = (0, 255, 0)  # the upper half of the picture
    corners = np.full((3 * len(mesh.faces), 2), 0.1, dtype=np.float32)
    texture = Texture(texels=texels, corners=corners)
    image = Image(mesh=mesh, rgba=(1.0, 1.0, 1.0, 1.0), texture=texture)
    solid = Solid(shapes=(box(0.1, 0.1, 0.1),), rgba=WHITE, images=(image,))
    one = Simulation((Prop(name="block", solid=solid),))
    one.apply(Layout(poses={"block": SE3.at(0.5, 0.0, 0.05)}, variants={}))
    green = []
    with Renderer(one.model, height=SIZE, width=SIZE) as renderer:
        for other in (ROOM, replace(ROOM, colour_variation=1.0), look("textured_objects")):
            renderer.set_look(replace(other, renderer=STUDIO))
            seen = renderer.render(one.data, HEAD).astype(int)
            green.append(np.sum(seen[..., 1] - seen[..., [0, 2]].max(axis=2) > 50) > 20)
    assert green == [True, True, False]


@pytest.mark.slow
def test_edges_are_smooth_and_the_mean_of_many_is_the_same_picture(
    simulation: Simulation, draw: Draw
) -> None:
    one = draw(camera=OVERVIEW).astype(int)
    with Renderer(simulation.model, height=SIZE, width=SIZE, samples=16, look=ROOM) as fine:
        many = fine.render(simulation.data, OVERVIEW)
    assert np.abs(many - one).mean() < 6


def test_a_process_that_ended_is_replaced_and_the_other_goes_on(draw: Draw) -> None:
    plain, room = draw(Look()), draw()
    classic = rendering_process.current()
    os.kill(rendering_process.current(VULKAN)._process.pid, signal.SIGKILL)
    with pytest.raises(RenderingError, match="ended by SIGKILL"):
        draw()
    assert np.array_equal(draw(), room)
    assert np.array_equal(draw(Look()), plain)
    assert rendering_process.current() is classic


def test_what_draws_is_described(renderer: Renderer) -> None:
    renderer.set_look(ROOM)
    assert renderer.info == describe(STUDIO)
    assert renderer.info.backend == VULKAN
    assert renderer.info.renderer.startswith("Filament on ")
    assert describe(CLASSIC).backend != VULKAN


def test_without_vulkan_one_sentence_says_what_to_install(
    simulation: Simulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    with suppress(RenderingError):
        rendering_process.current(VULKAN).end()
    monkeypatch.setenv("VK_DRIVER_FILES", "/nothing")
    monkeypatch.setenv("VK_ICD_FILENAMES", "/nothing")
    with Renderer(simulation.model, height=8, width=8, look=ROOM) as one:
        with pytest.raises(RenderingError, match="apt-get install libvulkan1"):
            one.render(simulation.data, HEAD)
        one.set_look(Look())
        assert one.render(simulation.data, HEAD).any()
