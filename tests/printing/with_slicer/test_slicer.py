"""A stranger's slicer takes every part: nothing to mend, the mass of its recipe, no bridge."""

from __future__ import annotations

import os
import struct
from functools import cache
from pathlib import Path

import manifold3d
import numpy as np
import pytest

from duobench.printing import Recipe, recipe_of, stl_bytes, threemf_bytes
from duobench.printing.recipe import TOLERANCE, WASTE
from duobench.world.objects.solid import Mesh, mesh_of
from tests.printing.printed import JOBS, PARTS, job, part
from tests.printing.with_slicer.conftest import SLICER
from tests.printing.with_slicer.slicer import (
    BESIDE,
    SOUND,
    Sliced,
    information,
    longest_bridge,
    slice_file,
)

PROGRAM = os.environ[SLICER]
REBUILT = ("hinge_chest", "ball_maze", "transfer_cube", "bin_sort")
"""The tasks that the paper rebuilds with real arms."""
BRIDGE = 30.0
"""Longest bridge in mm that a part of them has."""
LIGHTER = 0.2
"""Share by which the estimate of what is not solid may be off."""


@cache
def recipe(name: str) -> Recipe:
    return recipe_of(job(name))


def sliced(mesh: Mesh, folder: Path, **how: object) -> Sliced:
    file = folder / "part.stl"
    file.write_bytes(stl_bytes(mesh, "part"))
    settings = {"layer": 0.2, "walls": 4, "infill": 100, "pattern": "rectilinear", **how}
    return slice_file(PROGRAM, file, **settings)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize(("name", "of"), PARTS)
def test_a_slicer_takes_a_part_as_its_recipe_says(name: str, of: str, tmp_path: Path) -> None:
    (wanted,) = (each for each in recipe(name).parts if each.name == of)
    mesh = part(name, of).mesh
    (tmp_path / "it.stl").write_bytes(stl_bytes(mesh, of))
    (known,) = information(PROGRAM, tmp_path / "it.stl")
    assert set(known) == SOUND, "it mends nothing"
    assert (known["manifold"], known["number_of_parts"]) == ("yes", "1")
    assert float(known["volume"]) == pytest.approx(1000 * wanted.volume_cm3, rel=1e-3, abs=10)
    made = sliced(
        mesh,
        tmp_path,
        layer=wanted.layer_mm,
        walls=wanted.walls,
        infill=wanted.infill_percent,
        pattern=wanted.infill_pattern,
    )
    assert made.said == ""
    if wanted.mass_g is None:
        estimate = wanted.filament_g / WASTE / wanted.count
        assert made.grams == pytest.approx(estimate, rel=LIGHTER)
    else:
        assert made.grams == pytest.approx(wanted.mass_g[1], rel=TOLERANCE)
    bridge = longest_bridge(mesh, made.lines)
    if name in REBUILT:
        assert bridge <= BRIDGE - 2 * BESIDE


@pytest.mark.parametrize("name", [name for name in JOBS if job(name).parts])
def test_a_slicer_finds_every_part_of_a_3mf(name: str, tmp_path: Path) -> None:
    (tmp_path / "it.3mf").write_bytes(threemf_bytes(job(name)))
    found = information(PROGRAM, tmp_path / "it.3mf")
    assert sum(int(each["number_of_parts"]) for each in found) == sum(
        each.count for each in job(name).parts
    )
    assert all(set(each) == SOUND and each["manifold"] == "yes" for each in found)


# --- these tests would notice ---


def gantry(gap: float, width: float = 0.02) -> Mesh:
    """A plate on two legs, a gap in metres apart."""
    m = manifold3d.Manifold
    legs = [
        m.cube((0.01, width, 0.012), True).translate((s * (gap + 0.01) / 2, 0, 0.006))
        for s in (1, -1)
    ]
    plate = m.cube((gap + 0.02, width, 0.004), True).translate((0, 0, 0.012))
    return mesh_of(legs[0] + legs[1] + plate)


@pytest.mark.parametrize("gap", [0.020, 0.060])
@pytest.mark.parametrize("infill", [15, 100])
def test_a_bridge_is_as_long_as_its_gap(gap: float, infill: int, tmp_path: Path) -> None:
    made = sliced(gantry(gap), tmp_path, infill=infill)
    assert longest_bridge(gantry(gap), made.lines) == pytest.approx(1000 * gap - 2 * BESIDE, abs=1)


def test_a_bridge_of_outlines_alone_is_one_too(tmp_path: Path) -> None:
    made = sliced(gantry(0.06, 0.003), tmp_path)
    assert longest_bridge(gantry(0.06, 0.003), made.lines) == pytest.approx(60 - 2 * BESIDE, abs=1)


def test_a_roof_over_sparse_infill_is_no_bridge(tmp_path: Path) -> None:
    block = mesh_of(manifold3d.Manifold.cube((0.08, 0.08, 0.02), True).translate((0, 0, 0.01)))
    made = sliced(block, tmp_path, infill=15, pattern="grid")
    assert max(line.length for line in made.lines) > BRIDGE
    assert longest_bridge(block, made.lines) < 1


@pytest.mark.parametrize("fault", ["missing", "turned"])
def test_what_has_to_be_mended_is_noticed(fault: str, tmp_path: Path) -> None:
    data = bytearray(stl_bytes(part("bin_sort", "white_bowl").mesh, "bowl"))
    (count,) = struct.unpack_from("<I", data, 80)
    if fault == "missing":
        data = data[: 84 + 50 * (count - 5)]
        struct.pack_into("<I", data, 80, count - 5)
    else:
        first, second = data[96:108], data[108:120]
        data[96:108], data[108:120] = second, first
    file = tmp_path / "broken.stl"
    file.write_bytes(bytes(data))
    (known,) = information(PROGRAM, file)
    assert set(known) != SOUND


def test_what_is_not_solid_enough_is_too_light(tmp_path: Path) -> None:
    cube = part("bin_sort", "white_cube")
    made = sliced(cube.mesh, tmp_path, infill=80)
    assert made.grams < (1 - TOLERANCE) * 1000 * cube.mass
    assert np.isfinite(made.grams)
