"""Looks as values: names, JSON, what is rejected, and that colours keep their names."""

import json
import math
from dataclasses import asdict
from typing import Any

import numpy as np
import pytest

from duobench.core.errors import OptionError, UnknownNameError
from duobench.core.types import HEAD
from duobench.tasks import catalog
from duobench.world.looks import effects
from duobench.world.looks.catalog import LOOKS, as_look, look
from duobench.world.looks.clutter import DEPTH, pieces
from duobench.world.looks.colours import colour_name, shifted
from duobench.world.looks.look import CameraOffset, Light, Look, Material
from duobench.world.looks.textures import TEXTURES, texture
from duobench.world.robot.workcell import FLOOR_Z, ROOM_X, ROOM_Y
from duobench.world.sim.appearance import Appearance
from duobench.world.sim.simulation import Simulation

LARGEST_ROUNDING = 6.0
"""Of a blur: weights are whole 256ths, an image is rounded twice, and the far tail is left out."""
RANDOM = [f"random:{seed}" for seed in range(20)]


@pytest.mark.parametrize("name", [*LOOKS, *RANDOM])
def test_a_look_survives_json(name: str) -> None:
    one = look(name)
    assert look(name) == one
    assert Look.from_json(json.loads(json.dumps(one.to_json()))) == one
    assert as_look(asdict(one)) == one


def test_the_default_look_says_nothing_and_random_ones_differ_and_keep_colour_names() -> None:
    assert look("default") == Look()
    assert Look().to_json() == {}
    found = [look(name) for name in RANDOM]
    assert len({json.dumps(one.to_json()) for one in found}) == len(RANDOM)
    assert {(*one.objects, one.colour_variation) for one in found} == {("*", 1.0)}


@pytest.mark.parametrize(
    ("make", "fields", "told"),
    [
        (Look, {"parts": {"tabel": Material()}}, "'table'"),
        (Look, {"cameras": {"heat": CameraOffset()}}, "'head'"),
        (Look, {"objects": {"*": Material(colour=(1, 0, 0))}}, "hide what an instruction names"),
        (Look, {"lights": [Light(position=(0, 0, 2), shadow=True)] * 2}, "them casts shadows"),
        (Look, {"lights": [Light(position=(0, 0, 2))] * 7}, "at most 6 lights"),
        (Look, {"noise": 2.0}, "noise is 0 to 0.5"),
        (Look, {"exposure": float("nan")}, "exposure is -4 to 4"),
        (Look, {"seed": -1}, "from 0 on"),
        (Look, {"seed": 1.5}, "a whole number"),
        (Look, {"clutter": 1000}, "0 to 40 pieces"),
        (Look, {"ambient": (1.0, 2.0, 0.0)}, "ambient is red, green and blue"),
        (Look, {"ambient": (1.0, 0.5)}, "ambient is red, green and blue"),
        (Material, {"texture": "wod"}, "'wood'"),
        (Material, {"texture": "wood", "image": "a.png"}, "a texture or an image"),
        (Material, {"second_colour": (0, 0, 0)}, "needs a texture"),
        (Material, {"contrast": -1}, "contrast is 0 to 1"),
        (Light, {"position": (0.0, 2.0)}, "x y z"),
        (CameraOffset, {"position": (0.0, 2.0)}, "three finite numbers"),
        (CameraOffset, {"rotation": (0.0, 2.0, math.inf)}, "three finite numbers"),
    ],
)
def test_an_impossible_look_or_part_of_one_is_rejected(
    make: type, fields: dict[str, Any], told: str
) -> None:
    with pytest.raises((OptionError, UnknownNameError), match=told):
        make(**fields)


@pytest.mark.parametrize(
    ("value", "told"),
    [
        ({"nose": 0.1}, "'noise'"),
        ({"noise": "much"}, "noise"),
        ({"lights": [{"position": [0, 0]}]}, "position"),
        ({"parts": {"table": {"color": [1, 0, 0]}}}, "Did you mean 'colour'"),
        ({"lights": [{"position": [0, 0, 2]}, {"position": [0, 0, 2], "shade": 1}]}, "'shadow'"),
        ("wood_tabel", "'wood_table'"),
        ("random:seven", "random:7"),
        ("random:" + "9" * 5000, "random:7"),
        (7, "a name, a Look or its JSON form"),
    ],
)
def test_what_is_no_look_is_rejected(value: object, told: str) -> None:
    with pytest.raises((OptionError, UnknownNameError), match=told):
        as_look(value)


def test_an_unknown_key_of_a_look_is_refused_at_every_depth() -> None:
    lamps, oak = (Light(position=(0, 0, 2)),) * 2, Material(colour=(1, 0, 0))
    cameras = {HEAD: CameraOffset()}
    whole = Look(parts={"table": oak}, objects={"pot": oak}, lights=lamps, cameras=cameras)
    plain = asdict(whole)
    places = [plain, *plain["lights"], plain["parts"], plain["cameras"]]
    places += [plain[name][key] for name, key in (("parts", "table"), ("objects", "pot"))]
    for each in (*places, plain["cameras"][HEAD]):
        each["strange"] = {}
        with pytest.raises(UnknownNameError, match="'strange'"):
            as_look(plain)
        del each["strange"]
    for wrong in (3, {"position": (0, 0, 2)}, [3], [[]]):
        with pytest.raises(OptionError, match=r"look\.lights"):
            as_look({"lights": wrong})
    assert as_look(plain) == whole


@pytest.mark.parametrize(
    ("rgb", "name"),
    [
        ((0.04, 0.04, 0.045), "black"),
        ((0.33, 0.33, 0.34), "dark grey"),
        ((0.95, 0.95, 0.95), "light grey"),
        ((0.29, 0.19, 0.12), "dark orange"),
        ((0.86, 0.73, 0.53), "light orange"),
        ((0.12, 0.33, 0.70), "blue"),
        ((0.20, 0.62, 0.27), "green"),
        ((0.80, 0.10, 0.09), "light red"),
    ],
)
def test_colours_have_the_names_that_people_give_them(
    rgb: tuple[float, float, float], name: str
) -> None:
    assert colour_name(rgb) == name


@pytest.mark.parametrize("name", catalog.names())
def test_random_looks_keep_the_names_of_the_colours_of_objects(name: str) -> None:
    simulation = Simulation(catalog.get(name).props)
    rgba = simulation.model.geom_rgba
    moved = 0
    for number in range(100):
        found = Appearance(simulation.model, Look(seed=number, colour_variation=1.0))
        after: dict[tuple[float, ...], set[object]] = {}
        for geom, material in found.by_geom.items():
            before = tuple(rgba[geom, :3].tolist())
            assert colour_name(material.rgb or ()) == colour_name(before)
            after.setdefault(before, set()).add(material.rgb)
            moved += material.rgb != before
        assert all(len(colours) == 1 for colours in after.values()), "one colour became two"
    assert moved


def test_a_shift_is_a_function_of_colour_and_seed() -> None:
    blue = (0.12, 0.33, 0.70)
    assert shifted(blue, 1.0, 3) == shifted(blue, 1.0, 3) != shifted(blue, 1.0, 4)
    assert shifted(blue, 0.0, 3) == blue


def test_a_colour_takes_the_place_of_the_main_one_only() -> None:
    model = Simulation(catalog.get("transfer_gate").props).model
    red = (0.8, 0.1, 0.1)
    by_geom = Appearance(model, Look(objects={"gate": Material(colour=red)})).by_geom
    assert {model.geom(geom).name for geom in by_geom} == {"gate:image0"}
    assert {material.rgb for material in by_geom.values()} == {red}


@pytest.mark.parametrize("name", TEXTURES)
def test_a_texture_is_seeded_and_has_a_pattern(name: str) -> None:
    first = texture(name, (96, 64), (1.5, 1.0))
    assert first.shape == (96, 64)
    assert 0.0 <= first.min() < 0.7 < first.max() <= 1.0
    assert np.array_equal(first, texture(name, (96, 64), (1.5, 1.0)))
    plain = name in {"checker", "stripes"}
    assert np.array_equal(first, texture(name, (96, 64), (1.5, 1.0), seed=1)) is plain


def test_furniture_stands_on_the_floor_along_the_walls() -> None:
    some = pieces(40, seed=5)
    assert pieces(10, seed=5) == some[:10]
    for piece in some:
        (x, y, z), (dx, dy, dz) = piece.position, (length / 2 for length in piece.size)
        assert z - dz == pytest.approx(FLOOR_Z)
        gaps = [x - dx - ROOM_X[0], ROOM_X[1] - x - dx, y - dy - ROOM_Y[0], ROOM_Y[1] - y - dy]
        assert min(gaps) > 0
        near = [x + dx - ROOM_X[0], ROOM_X[1] - x + dx, y + dy - ROOM_Y[0], ROOM_Y[1] - y + dy]
        assert min(near) <= DEPTH


def test_looks_name_what_there_is() -> None:
    simulation = Simulation()
    for one in map(look, [*LOOKS, *RANDOM]):
        Appearance(simulation.model, one)
        assert HEAD in one.cameras or not one.cameras


@pytest.mark.parametrize("blur", [0.001, 0.003, 0.02, 0.05])
def test_a_blur_is_a_gaussian_along_each_axis_whose_ends_go_on(blur: float) -> None:
    image = np.random.default_rng(0).integers(0, 256, (96, 70, 3), dtype=np.uint8)
    found = effects.apply(Look(blur=blur), image, 0.0, np.zeros(3), 0)
    offsets = np.arange(-40, 41)
    weights = np.exp(-0.5 * (offsets / (blur * len(image))) ** 2)
    expected = image.astype(float)
    for axis in range(2):
        places = (np.arange(image.shape[axis]) + offsets[:, None]).clip(0, image.shape[axis] - 1)
        moved = np.moveaxis(np.take(expected, places, axis=axis), axis, 0)
        expected = np.tensordot(weights / weights.sum(), moved, axes=(0, 0))
    assert np.abs(found - expected).max() < LARGEST_ROUNDING
