"""Layouts: as data, applied, and refused where they cannot be."""

import json
import math

import numpy as np
import pytest

from duobench.core.errors import LayoutError
from duobench.core.spatial import SE3
from duobench.world.sim.layout import Layout
from duobench.world.sim.placement import MAX_SAMPLES, first_valid, problems
from duobench.world.sim.simulation import Simulation
from tests.world.sim.props import EDGE, REST, scene

GOOD = Layout(poses=REST, variants={"lid": "red"})


@pytest.fixture(scope="module")
def sim() -> Simulation:
    return scene()


def changed(**poses: SE3) -> Layout:
    return Layout(poses={**GOOD.poses, **poses})


def test_a_layout_survives_text() -> None:
    text = json.dumps(GOOD.to_json())
    again = Layout.from_json(json.loads(text))
    assert again.variants == GOOD.variants
    for name, pose in GOOD.poses.items():
        assert max(again.poses[name].distance(pose)) < 1e-12
    assert json.loads(text)["poses"]["bowl"] == [0.7, 0.3, 0.0, 0.0, 0.0, 0.0, 1.0]
    turned = Layout.from_json({"poses": {"cube": [0.5, 0.1, 0.0, 0.0, 0.0, 2.0, 2.0]}})
    assert turned.poses["cube"].yaw == pytest.approx(np.pi / 2), "of any length"


NO_LAYOUT = r"no layout.*poses.*variants"


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({}, NO_LAYOUT),
        ({"poses": [1, 2]}, NO_LAYOUT),
        ({"poses": {"cube": [0.5, 0.0]}}, NO_LAYOUT),
        ({"poses": {"cube": ["a"] * 7}}, NO_LAYOUT),
        ({"poses": {"cube": None}}, NO_LAYOUT),
        ({"poses": {"cube": [0.5, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0]}}, NO_LAYOUT),
        ({"poses": {"cube": [0.5, 0.1, 0.0, 0.0, 0.0, 0.0, math.nan]}}, NO_LAYOUT),
        ({"poses": {}, "variants": 3}, NO_LAYOUT),
        (None, NO_LAYOUT),
        ({"poses": {"cube": [math.nan, 0.1, 0.0, 0.0, 0.0, 0.0, 1.0]}}, "'cube' is not finite"),
    ],
)
def test_what_is_no_layout_is_refused(data: object, words: str) -> None:
    with pytest.raises(LayoutError, match=words):
        Layout.from_json(data)  # type: ignore[arg-type]


def test_applying_puts_every_prop_in_its_place(sim: Simulation) -> None:
    sim.reset_data()
    sim.apply(GOOD)
    for name, pose in GOOD.poses.items():
        assert max(sim.pose(name).distance(pose)) < 1e-9


def test_a_layout_names_exactly_the_props(sim: Simulation) -> None:
    poses = {**GOOD.poses, "ghost": SE3()}
    del poses["slab"]
    with pytest.raises(LayoutError, match=r"missing \['slab'\], unknown \['ghost'\]"):
        sim.apply(Layout(poses=poses))


@pytest.mark.parametrize(
    ("layout", "words"),
    [
        (changed(cube=SE3.at(0.5, -0.2, EDGE / 2)), "cube and slab overlap|slab and cube overlap"),
        (changed(cube=SE3.at(0.5, 0.1, 0.0)), "table"),
        (changed(cube=SE3.at(0.51, 0.25, 0.54)), "cube touches the robot"),
        (changed(cube=SE3.at(1.06, 0.1, EDGE / 2)), "cube is out of reach"),
        (changed(cube=SE3.at(0.5, -0.66, EDGE / 2)), "cube is out of reach"),
        (changed(chest=SE3.at(1.2, 0.0)), "chest is out of reach"),
        (changed(bowl=SE3.at(0.7, 0.3, -0.5)), "bowl is below the table top"),
        (changed(bowl=SE3.at(0.7, 0.3, 16.0)), "bowl is 16 m above the table"),
    ],
)
def test_problems_are_named(sim: Simulation, layout: Layout, words: str) -> None:
    found = problems(sim, layout)
    assert any(word in problem for word in words.split("|") for problem in found), found


def test_the_first_valid_layout_is_taken(sim: Simulation) -> None:
    bad = changed(cube=SE3.at(2.0, 0.0, EDGE / 2))
    later = changed(cube=SE3.at(0.45, 0.1, EDGE / 2))
    assert first_valid(sim, iter([bad, bad, GOOD, later]), "test") is GOOD
    assert problems(sim, GOOD) == [], "standing on the table is none"


def test_drawing_is_bounded_and_the_error_says_why(sim: Simulation) -> None:
    candidates = iter([changed(cube=SE3.at(2.0, 0.0, EDGE / 2))] * (MAX_SAMPLES + 1))
    with pytest.raises(LayoutError, match=f"'test'.*last of {MAX_SAMPLES}.*cube is out of reach"):
        first_valid(sim, candidates, "test")
    assert len(list(candidates)) == 1
