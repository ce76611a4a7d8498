"""The numbers of the task page, written down a second time.

Other tests take thresholds and sizes from the tasks themselves, and hold for any value. Here each
is a literal: whoever changes one changes what the benchmark measures, and sees it here.

Lengths are in metres and angles in radians, unless a name ends in `_deg` or `_DEGREES`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

import pytest

from duobench.core.randomness import Uniform
from duobench.tasks import catalog


@dataclass(frozen=True, kw_only=True)
class Place:
    """Where an object starts: the middle of its positions and turns, and how far they reach."""

    at: tuple[float, float]
    within: tuple[float, float] = (0.0, 0.0)
    turned_deg: float = 0.0
    yaw_deg: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Page:
    """What the page says about one task."""

    stages: int
    horizon: int
    numbers: Mapping[str, Any] = field(default_factory=dict)
    """Constants by module and name."""
    layout: Mapping[str, Place]
    constraints: tuple[str, ...] = ()
    """Constraints of the stages, by name."""


ANY = 180.0
CUBE = {"objects.blocks.CUBE_EDGE": 0.032}
LONG_BLOCK = CUBE | {"objects.blocks.LONG_BLOCK": 0.096}
SUPPORT = {
    "stages.support.UNSUPPORTED_SECONDS": 0.6,
    "stages.support.RELIEVED_SECONDS": 1.0,
    "stages.support.NEAR": 0.015,
    "stages.support.SHUT_SECONDS": 0.5,
    "stages.predicates.SHUTTING_MOMENT": 2.0,
    "sim.contacts.MIN_LEVER": 0.020,
    "tasks.hinge_chest.BACKING": 0.060,
    "tasks.hinge_chest.HIGHEST_DROP": 0.080,
}
BOWL = {"objects.bowl.RADIUS": 0.085, "objects.bowl.RIM_HEIGHT": 0.030}

PAGES = {
    "hinge_chest": Page(
        stages=3,
        horizon=441,
        numbers=CUBE
        | SUPPORT
        | {
            "objects.chest.CAVITY": (0.130, 0.230, 0.060),
            "objects.chest.WALL": 0.006,
            "objects.chest.LID_LIMITS": (0.0, math.radians(80)),
            "tasks.hinge_chest.OPEN_ANGLE": 0.8,
        },
        layout={
            "cube": Place(at=(0.5, 0.2), within=(0.175, 0.175), yaw_deg=ANY),
            "chest": Place(at=(0.6, -0.2), within=(0.04, 0.04), yaw_deg=10),
        },
        constraints=("chest/lid is open by 0.80 rad", "cube is raised by 10 mm"),
    ),
    "spring_door": Page(
        stages=3,
        horizon=807,
        numbers=CUBE
        | SUPPORT
        | {
            "objects.microwave.WIDTH": 0.55,
            "objects.microwave.DEPTH": 0.32,
            "objects.microwave.HEIGHT": 0.30,
            "objects.microwave.CAVITY": (0.26, 0.33, 0.24),
            "objects.microwave.DOOR_LIMITS": (0.0, 2.09),
            "objects.microwave.DOOR_STIFFNESS": 4.0,
            "tasks.spring_door.OPEN_ANGLE": 0.8,
        },
        layout={
            "cube": Place(at=(0.4, -0.35), within=(0.05, 0.10), yaw_deg=ANY),
            "microwave": Place(at=(0.7, 0.0), within=(0.02, 0.02), yaw_deg=3),
        },
        constraints=("microwave/door is open by 0.80 rad", "cube is raised by 10 mm"),
    ),
    "pour_marbles": Page(
        stages=6,
        horizon=442,
        numbers={
            "objects.cup.INNER_RADIUS": 0.030,
            "objects.cup.WALL": 0.004,
            "objects.cup.HEIGHT": 0.075,
            "objects.cup.MARBLE_RADIUS": 0.005,
            "tasks.pour_marbles.RAISE": 0.020,
            "tasks.pour_marbles.HALF_SQUARE": 0.05,
            "stages.pouring.LYING_SPEED": 0.25,
            "stages.pouring.TILT_TO_POUR_DEGREES": 45,
        },
        layout={
            "left_cup": Place(at=(0.5, 0.3), within=(0.05, 0.05)),
            "right_cup": Place(at=(0.5, -0.3), within=(0.05, 0.05)),
            "left_square": Place(at=(0.5, 0.3)),
            "right_square": Place(at=(0.5, -0.3)),
        },
        constraints=("left_cup is raised by 20 mm", "right_cup is upright within 20 degrees"),
    ),
    "ball_maze": Page(
        stages=4,
        horizon=350,
        numbers={
            "objects.maze_board.EDGE": 0.22,
            "objects.maze_board.PITCH": 0.040,
            "objects.maze_board.WALL_HEIGHT": 0.015,
            "objects.maze_board.BALL_RADIUS": 0.010,
            "objects.mazes.CELLS": 5,
            "tasks.ball_maze.LEFT_START": 0.020,
            "tasks.ball_maze.AT_GOAL": 0.015,
            "tasks.ball_maze.RAISE": 0.010,
            "stages.rolling.MIN_SPEED": 0.02,
            "stages.rolling.SLIP_SECONDS": 0.1,
        },
        layout={"board": Place(at=(0.5, 0.0), within=(0.1, 0.1), yaw_deg=ANY)},
    ),
    "carry_pot": Page(
        stages=3,
        horizon=450,
        numbers={
            "objects.pot.RADIUS": 0.11,
            "objects.pot.HEIGHT": 0.11,
            "objects.pot.MASS": 2.5,
            "objects.pot.PLATE": (0.35, 0.28, 0.02),
            "tasks.carry_pot.LIFT": 0.030,
            "tasks.carry_pot.OFF_CENTRE": (0.10, 0.08),
            "tasks.carry_pot.TILT_DEGREES": 10,
        },
        layout={
            "pot": Place(at=(0.5, -0.1), within=(0.08, 0.08), yaw_deg=10),
            "stove": Place(at=(0.5, 0.3), within=(0.04, 0.04), turned_deg=90),
        },
        constraints=("pot is raised by 30 mm", "pot is upright within 10 degrees"),
    ),
    "block_balance": Page(
        stages=5,
        horizon=766,
        numbers={
            "tasks.block_balance.CUBE_EDGE": 0.040,
            "tasks.block_balance.BEAM": (0.040, 0.200, 0.020),
            "tasks.block_balance.BLOCK": (0.030, 0.030, 0.090),
            "tasks.block_balance.LEVEL_DEGREES": 12,
            "tasks.block_balance.STANDING_DEGREES": 20,
        },
        layout={},  # The page leaves the places open; see below.
        constraints=(
            "beam is raised by 10 mm",
            "beam is upright within 12 degrees",
            "left_block is upright within 20 degrees",
        ),
    ),
    "join_blocks": Page(
        stages=3,
        horizon=829,
        numbers={
            "objects.joint_blocks.BAR": (0.075, 0.030, 0.025),
            "objects.joint_blocks.PEG_WIDTH": 0.014,
            "objects.joint_blocks.PEG_LENGTH": 0.024,
            "objects.joint_blocks.CLEARANCE": 0.0003,
            "objects.joint_blocks.PEG_HEIGHT": 0.060,
            "tasks.join_blocks.DEPTH": 0.010,
            "stages.joining.KEPT_DEPTH": 0.003,
            "stages.joining.LOST_SECONDS": 0.2,
        },
        layout={
            "light_block": Place(at=(0.5, 0.2), within=(0.05, 0.075), yaw_deg=15),
            "dark_block": Place(at=(0.5, -0.2), within=(0.05, 0.075), yaw_deg=15),
            "wall": Place(at=(0.7, 0.0)),
        },
        constraints=(
            "peg of light_block is 10 mm inside dark_block",
            "peg of wall is 10 mm inside dark_block",
            "left grasps light_block",
            "light_block is still",
            "dark_block is still",
            "light_block is released",
            "dark_block is released",
        ),
    ),
    "transfer_cube": Page(
        stages=4,
        horizon=441,
        numbers=LONG_BLOCK | BOWL,
        layout={
            "cube": Place(at=(0.5, -0.2), within=(0.175, 0.175), yaw_deg=ANY),
            "bowl": Place(at=(0.6, 0.3), within=(0.05, 0.05)),
        },
        constraints=(
            "cube is raised by 10 mm",
            "bowl is upright within 20 degrees",
            "bowl touches table",
        ),
    ),
    "transfer_gate": Page(
        stages=4,
        horizon=523,
        numbers=LONG_BLOCK
        | {
            "objects.gate.SIDES_OF_RING": 8,
            "objects.gate.RING_RADIUS": 0.115,
            "objects.gate.RING_HEIGHT": 0.375,
            "objects.gate.MAT_EDGE": 0.228,
            "objects.gate.MAT_THICKNESS": 0.01,
            "tasks.transfer_gate.CROSSING_RADIUS": 0.10,
        },
        layout={
            "block": Place(at=(0.5, -0.3), within=(0.175, 0.175), yaw_deg=ANY),
            "gate": Place(at=(0.4, 0.0), within=(0.025, 0.05)),
            "mat": Place(at=(0.5, 0.3), within=(0.05, 0.05)),
        },
        constraints=(
            "block is raised by 10 mm",
            "block is within 100 mm of the axis of gate, 50 mm before or behind it",
            "block is within 115 mm of the axis of gate, 50 mm before or behind it",
            "block is within 115 mm of the axis of gate, 48 mm before or behind it",
        ),
    ),
    "transfer_reorient": Page(
        stages=4,
        horizon=505,
        numbers={
            "objects.hexagon_peg.ACROSS_FLATS": 0.034,
            "objects.hexagon_peg.PEG_LENGTH": 0.100,
            "objects.hexagon_peg.CLEARANCE": 0.001,
            "tasks.transfer_reorient.DEPTH": 0.015,
        },
        layout={
            "peg": Place(at=(0.5, -0.2), within=(0.15, 0.15), yaw_deg=30),
            "board": Place(at=(0.5, 0.3), within=(0.10, 0.10)),
        },
        constraints=("peg of peg is 15 mm inside board", "peg is raised by 10 mm"),
    ),
    "bin_sort": Page(
        stages=5,
        horizon=216,
        numbers=CUBE | BOWL | {"tasks.bin_sort.BOWL_MARGIN": 0.10},
        layout={
            "white_cube": Place(at=(0.5, 0.2), within=(0.175, 0.125), yaw_deg=ANY),
            "black_cube": Place(at=(0.5, -0.2), within=(0.175, 0.125), yaw_deg=ANY),
            "white_bowl": Place(at=(0.6, 0.4), within=(0.05, 0.05)),
            "black_bowl": Place(at=(0.6, -0.4), within=(0.05, 0.05)),
        },
        constraints=(
            "white_cube is raised by 10 mm",
            "black_cube is raised by 10 mm",
            "white_cube is still",
            "black_cube is released",
            "white_bowl is upright within 20 degrees",
            "black_bowl touches table",
        ),
    ),
}

SHARED = {
    "stages.placing.PUT_HEIGHT": 0.012,
    "stages.placing.DROP_HEIGHT": 0.060,
    "stages.coordination.TOGETHER_SECONDS": 1.5,
    "stages.coordination.AWAY_SECONDS": 1.0,
    "stages.rolling.REGRASP_SECONDS": 0.4,
    "stages.rolling.MOST_MOVED": 0.005,
    "tasks.pour_marbles.SHOVE": 0.03,
    "stages.placing.REST_SECONDS": 0.5,
    "stages.predicates.LIFTED_HEIGHT": 0.010,
    "stages.predicates.STILL_SPEED": 0.05,
    "stages.predicates.STILL_ANGULAR_SPEED": 0.5,
    "stages.predicates.FLICKER_SECONDS": 0.1,
    "stages.vessels.STANDING_TILT_DEGREES": 20,
    "stages.insertion.MAX_OFFSET": 0.004,
    "stages.insertion.MAX_ANGLE_DEGREES": 10,
    "objects.solid.PLA_DENSITY": 1240.0,
}


def value(path: str) -> Any:
    module, _, name = path.rpartition(".")
    return getattr(import_module(f"duobench.{module}"), name)


def ends(middle: float, half: float) -> Any:
    return pytest.approx((middle - half, middle + half), abs=1e-12)


def low_high(drawn: Uniform) -> tuple[float, float]:
    return drawn.low, drawn.high


def test_the_catalog_is_the_papers_in_its_order() -> None:
    assert catalog.names() == tuple(PAGES)
    for name in catalog.names():
        assert catalog.get(name).id == name
        assert catalog.get(name).title == name.replace("_", "-").title()


@pytest.mark.parametrize("name", PAGES)
def test_stages_and_horizon(name: str) -> None:
    task = catalog.get(name)
    assert (task.max_stage, task.horizon) == (PAGES[name].stages, PAGES[name].horizon)


@pytest.mark.parametrize("name", PAGES)
def test_sizes_and_thresholds(name: str) -> None:
    page = PAGES[name]
    assert {path: value(path) for path in page.numbers} == page.numbers


def test_the_shared_words() -> None:
    assert {path: value(path) for path in SHARED} == SHARED


@pytest.mark.parametrize("name", PAGES)
def test_the_stages_ask_for_these_constraints(name: str) -> None:
    """A constant may be right and not be used."""
    stages = catalog.get(name).stages
    asked = {part.name for stage in stages for part in stage.holds.walk()}
    assert set(PAGES[name].constraints) <= asked


@pytest.mark.parametrize("name", [name for name, page in PAGES.items() if page.layout])
def test_layouts_are_drawn_from_these_ranges(name: str) -> None:
    placements = catalog.get(name).placements
    assert placements.keys() == PAGES[name].layout.keys()
    for prop, place in PAGES[name].layout.items():
        for drawn, middle, half in zip(
            (placements[prop].x, placements[prop].y), place.at, place.within, strict=True
        ):
            assert low_high(drawn) == ends(middle, half), prop
        yaw = ends(math.radians(place.turned_deg), math.radians(place.yaw_deg))
        assert low_high(placements[prop].yaw) == yaw, prop


def test_the_layout_of_block_balance_keeps_things_apart() -> None:
    """One block in each half, beam and cube between them, all 8 cm apart, none turned."""
    placements = catalog.get("block_balance").placements
    ranges = {name: (low_high(p.x), low_high(p.y)) for name, p in placements.items()}
    assert set(ranges) == {"cube", "beam", "left_block", "right_block"}
    assert ranges["left_block"][1][0] > 0 > ranges["right_block"][1][1]
    for name, here in ranges.items():
        assert low_high(placements[name].yaw) == (0.0, 0.0)
        for there in (ranges[other] for other in ranges if other != name):
            gaps = [max(a[0] - b[1], b[0] - a[1], 0.0) for a, b in zip(here, there, strict=True)]
            assert math.hypot(*gaps) >= 0.08 - 1e-9


def test_what_is_drawn_besides_poses() -> None:
    drawn = {name: dict(catalog.get(name).variants) for name in PAGES}
    assert {name for name, variants in drawn.items() if variants} == {"pour_marbles", "ball_maze"}
    assert drawn["pour_marbles"]["full"].options == ("left", "right")
    assert drawn["ball_maze"]["board"].options == tuple("0123456789")
