"""Looks in images: what they change, and that they leave nothing behind."""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Pillow

from duobench.core.errors import AssetError, UnknownNameError
from duobench.core.spatial import SE3
from duobench.tasks import catalog
from duobench.world.looks.catalog import LOOKS, look
from duobench.world.looks.look import CLASSIC, CameraOffset, Light, Look, Material
from duobench.world.objects import WHITE, Image, Prop, Solid, block, box, printable
from duobench.world.objects.solid import Texture
from duobench.world.robot.cameras import HEAD, OVERVIEW, POLICY_CAMERAS
from duobench.world.sim.backend import SimBackend
from duobench.world.sim.layout import Layout
from duobench.world.sim.rendering import Renderer
from duobench.world.sim.simulation import Simulation
from tests.envs.tools import arrays
from tests.world.sim.props import at_reset

SIZE = 96
Draw = Callable[..., np.ndarray]
CLASSIC_LOOKS = [name for name, each in LOOKS.items() if each.renderer == CLASSIC]
NAMES = [*CLASSIC_LOOKS, "random:1", "random:2"]
OTHERS = [name for name in NAMES if name != "default"]


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return at_reset("bin_sort", seed=0)


@pytest.fixture(scope="module")
def renderer(simulation: Simulation) -> Iterator[Renderer]:
    with Renderer(simulation.model, height=SIZE, width=SIZE) as one:
        yield one


@pytest.fixture(scope="module")
def draw(simulation: Simulation, renderer: Renderer) -> Draw:
    """An image of a camera in a look."""

    def drawn(look: Look = Look(), camera: str = HEAD) -> np.ndarray:  # noqa: B008 - it is frozen
        renderer.set_look(look)
        return renderer.render(simulation.data, camera)

    return drawn


def test_the_default_look_is_bit_identical_after_all_others(
    simulation: Simulation, renderer: Renderer
) -> None:
    before, state = arrays(simulation.model), simulation.get_state().tobytes()
    with Renderer(simulation.model, height=SIZE, width=SIZE) as never_switched:
        untouched = never_switched.render_all(simulation.data, POLICY_CAMERAS)
    for name in NAMES:
        renderer.set_look(look(name))
        renderer.render(simulation.data, HEAD)
        renderer.set_look(look("default"))
        found = renderer.render_all(simulation.data, POLICY_CAMERAS)
        assert all(np.array_equal(found[camera], untouched[camera]) for camera in POLICY_CAMERAS)
    assert arrays(simulation.model) == before
    assert simulation.get_state().tobytes() == state


@pytest.mark.parametrize("name", OTHERS)
def test_an_image_depends_on_look_and_state_alone(
    simulation: Simulation, renderer: Renderer, name: str
) -> None:
    renderer.set_look(Look())
    plain = renderer.render(simulation.data, HEAD)
    renderer.set_look(look(name))
    first = renderer.render_all(simulation.data, POLICY_CAMERAS)
    assert not np.array_equal(first[HEAD], plain)
    with Renderer(simulation.model, height=SIZE, width=SIZE, look=look(name)) as other:
        other.render(simulation.data, OVERVIEW)
        for camera in reversed(POLICY_CAMERAS):
            assert np.array_equal(other.render(simulation.data, camera), first[camera])


def test_noise_differs_from_state_to_state_and_camera_to_camera(
    simulation: Simulation, draw: Draw
) -> None:
    def noise(camera: str = HEAD) -> np.ndarray:
        return draw(Look(noise=0.05), camera) - draw(camera=camera).astype(int)

    first, time = noise(), simulation.data.time
    assert first.std() == pytest.approx(0.05 * 255, rel=0.1)
    assert abs(first.mean()) < 1.0
    assert not np.array_equal(first, noise(OVERVIEW))
    simulation.data.time += 1 / 30
    assert not np.array_equal(first, noise())
    simulation.data.time = time
    assert np.array_equal(first, noise())


def test_exposure_and_blur(draw: Draw) -> None:
    plain, soft = draw().astype(float), draw(Look(blur=0.02)).astype(float)
    assert draw(Look(exposure=-1.0)).mean() < plain.mean() < draw(Look(exposure=1.0)).mean()
    assert np.abs(np.diff(soft, axis=0)).mean() < 0.8 * np.abs(np.diff(plain, axis=0)).mean()
    assert soft.mean() == pytest.approx(plain.mean(), rel=0.02)


@pytest.mark.parametrize("camera", [HEAD, "left_wrist"])
def test_a_camera_offset_is_that_of_a_camera_that_was_moved(camera: str) -> None:
    offset = CameraOffset(position=(0.02, -0.01, 0.03), rotation=(0.05, -0.04, 0.1))
    simulation = at_reset("bin_sort", seed=0)
    with Renderer(simulation.model, height=SIZE, width=SIZE) as renderer:
        plain = renderer.render(simulation.data, camera)
        renderer.set_look(Look(cameras={camera: offset}))
        shown = renderer.render(simulation.data, camera).astype(int)
        renderer.set_look(Look())
        model = simulation.model.camera(camera)
        angle = math.hypot(*offset.rotation)
        turn = SE3.about(tuple(part / angle for part in offset.rotation), angle)
        pose = SE3.from_tquat([*model.pos, *np.roll(model.quat, -1)])
        moved = pose @ SE3.at(*offset.position) @ turn
        model.pos[:], model.quat[:] = moved.translation, moved.wxyz
        simulation.forward()
        real = renderer.render(simulation.data, camera)
    assert not np.array_equal(plain, real)
    # The last bits of two ways to turn a camera differ, which shows along a few edges.
    assert np.mean(np.abs(shown - real).max(axis=2) > 2) < 0.01


def test_a_wider_field_of_view_makes_things_smaller(
    simulation: Simulation, renderer: Renderer
) -> None:
    table = simulation.model.geom("table").id
    shares = []
    for angle in (-0.1, 0.0, 0.1):
        renderer.set_look(Look(cameras={OVERVIEW: CameraOffset(field_of_view=angle)}))
        shares.append(np.mean(renderer.segment(simulation.data, OVERVIEW) == table))
    assert shares[0] > shares[1] > shares[2] > 0


def test_furniture_is_seen_and_is_no_geom(
    simulation: Simulation, renderer: Renderer, draw: Draw
) -> None:
    image, before = draw(), renderer.segment(simulation.data, HEAD)
    assert not np.array_equal(draw(Look(clutter=40, seed=1)), image)
    assert np.array_equal(renderer.segment(simulation.data, HEAD), before)


def test_shadows_fall_where_the_light_comes_from(draw: Draw) -> None:
    light = Light(position=(0.24, 2.2, 1.7), colour=(0.7, 0.7, 0.7))
    without, shadowed = (
        draw(Look(lights=(replace(light, shadow=shadow),))).astype(int) for shadow in (False, True)
    )
    assert 0.005 < ((without - shadowed).max(axis=2) > 20).mean() < 0.5
    assert draw(Look(lights=())).mean() < shadowed.mean()


RED, GREEN, BLUE = range(3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("task", "body", "other"),
    [
        ("bin_sort", "white_cube", "black_cube"),
        ("bin_sort", "white_bowl", "black_bowl"),
        ("join_blocks", "light_block", "dark_block"),
        ("hinge_chest", "chest", "cube"),
        ("transfer_reorient", "peg", BLUE),
        ("block_balance", "cube", RED),
        ("transfer_gate", "mat", GREEN),
    ],
)
def test_light_objects_stay_lighter_and_coloured_ones_keep_their_strongest_channel(
    task: str, body: str, other: str | int
) -> None:
    simulation = at_reset(task, seed=0)
    with Renderer(simulation.model, height=224, width=224) as renderer:
        for name in NAMES:
            renderer.set_look(look(name))
            image = renderer.render(simulation.data, HEAD)
            seen = simulation.model.geom_bodyid[renderer.segment(simulation.data, HEAD)]
            mean = image[seen == simulation.body_id(body)].mean(axis=0)
            if isinstance(other, str):
                dark = image[seen == simulation.body_id(other)]
                assert mean.mean() > 1.4 * dark.mean(), name
            else:
                assert mean.argmax() == other, name


def test_what_a_layout_leaves_out_stays_left_out() -> None:
    task = catalog.get("ball_maze")
    simulation = at_reset("ball_maze", seed=0)
    with Renderer(simulation.model, height=SIZE, width=SIZE, look=look("random:3")) as renderer:
        for seed in (1, 2):
            simulation.apply(next(iter(task.layouts(seed))))
            hidden = np.flatnonzero(simulation.model.geom_rgba[:, 3] == 0)
            assert len(hidden)
            assert not np.isin(renderer.segment(simulation.data, HEAD), hidden).any()


def test_an_image_file_is_a_background(
    simulation: Simulation, renderer: Renderer, draw: Draw, tmp_path: Path
) -> None:
    path = tmp_path / "green.png"
    Pillow.new("RGB", (20, 10), (0, 255, 0)).save(path)
    image = draw(Look(parts={"walls": Material(image=str(path))}), OVERVIEW)
    walls = np.isin(
        renderer.segment(simulation.data, OVERVIEW),
        np.flatnonzero(simulation.model.geom_matid == simulation.model.material("wall").id),
    )
    assert walls.mean() > 0.1
    assert image[walls].mean(axis=0).argmax() == 1
    assert image[walls][:, 0].mean() < 20


def test_a_look_that_does_not_fit_changes_nothing(simulation: Simulation, tmp_path: Path) -> None:
    backend = SimBackend(simulation)
    backend.set_look(look("dark"))
    wrong = Look(objects={"white_cub": Material(texture="wood")})
    with pytest.raises(UnknownNameError, match="'white_cube'"):
        backend.set_look(wrong)
    missing = str(tmp_path / "none.png")
    with pytest.raises(AssetError, match=r"none\.png"):
        backend.set_look(Look(parts={"walls": Material(image=missing)}))
    assert backend.look == look("dark")
    with pytest.raises(UnknownNameError):
        Renderer(simulation.model, height=8, width=8, look=wrong)
    backend.close()


def test_a_backend_gives_every_size_in_its_look(simulation: Simulation) -> None:
    backend = SimBackend(simulation)
    for name in ("noisy", "wood_table", "default"):
        backend.set_look(look(name))
        for shape in ((48, 64), (SIZE, SIZE)):
            image = backend.images((HEAD,), shape)[HEAD]
            size = {"height": shape[0], "width": shape[1]}
            with Renderer(simulation.model, **size, look=look(name)) as renderer:
                assert np.array_equal(renderer.render(simulation.data, HEAD), image)
    backend.close()


def test_the_mean_of_several_samples_has_the_look_too(simulation: Simulation) -> None:
    with Renderer(simulation.model, height=60, width=80, samples=4) as renderer:
        plain = renderer.render(simulation.data, OVERVIEW)
        renderer.set_look(replace(look("wood_table"), noise=0.01))
        assert not np.array_equal(renderer.render(simulation.data, OVERVIEW), plain)


def test_a_texture_of_an_object_is_rendered_unless_a_look_has_another() -> None:
    mesh = printable(block(0.1, 0.1, 0.1, WHITE))
    texels = np.zeros((2, 1, 3), dtype=np.uint8)
    texels[0, 0] = (0, 255, 0)  # the upper half of the picture
    corners = np.full((3 * len(mesh.faces), 2), 0.1, dtype=np.float32)
    images = []
    for texture in (Texture(texels=texels, corners=corners), None):
        image = Image(mesh=mesh, rgba=(1.0, 1.0, 1.0, 1.0), texture=texture)
        solid = Solid(shapes=(box(0.1, 0.1, 0.1),), rgba=WHITE, images=(image,))
        one = Simulation((Prop(name="block", solid=solid),))
        one.apply(Layout(poses={"block": SE3.at(0.5, 0.0, 0.05)}, variants={}))
        with Renderer(one.model, height=SIZE, width=SIZE) as renderer:
            for name in ("default", "textured_objects"):
                renderer.set_look(look(name))
                images.append(renderer.render(one.data, HEAD).astype(int))
    own, other, plain, other_of_plain = images
    assert ((own[..., 1] > own[..., 0] + 60) & (own != plain).any(axis=2)).sum() > 20
    assert np.array_equal(other, other_of_plain)
