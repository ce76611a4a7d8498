"""PrusaSlicer as a program: what it says of a file, and what it would print of it."""

from __future__ import annotations

import re
import subprocess
from dataclasses import dataclass, field
from pathlib import Path

import manifold3d
import numpy as np
from numpy.typing import NDArray

from duobench.core.types import Array
from duobench.world.objects.shapes import PRINTER
from duobench.world.objects.solid import PLA_DENSITY, Mesh, manifold_from

BED = 1000 * PRINTER
STEP = 0.5
"""Distance in mm of the points of a line at which is looked what is under it."""
SOUND = {"number_of_facets", "number_of_parts", "manifold", "volume"}
"""What it says of any file, beside the box around it; more it says only of what it mends."""
MOVE = re.compile(r"([XYE])(-?[\d.]+)")
ROLES = ("Bridge infill", "Overhang perimeter")
"""Kinds of lines under which a slicer finds nothing, or little."""
BESIDE = 0.8
"""How far in mm a line may be from what is under it, and be carried from the side: two widths."""


@dataclass(frozen=True, kw_only=True)
class Line:
    """A line that is laid down in the air, in mm."""

    role: str
    z: float
    """Height of its underside."""
    ends: Array
    """Both ends (2, 2), from the middle of the bed."""

    @property
    def length(self) -> float:
        return float(np.linalg.norm(self.ends[1] - self.ends[0]))


@dataclass(frozen=True, kw_only=True)
class Sliced:
    """What a slicer makes of a file."""

    grams: float
    said: str
    """All that it wrote, without how far it is."""
    lines: list[Line] = field(default_factory=list)
    """The lines in the air."""


def information(program: str, file: Path) -> list[dict[str, str]]:
    """What the program says of each object of a file, without the box around it."""
    said = run(program, "--info", str(file))
    objects: list[dict[str, str]] = []
    for line in said.splitlines():
        if line.startswith("["):
            if "trace" not in line:
                objects.append({})
        elif objects:
            key, _, value = (word.strip() for word in line.partition("="))
            if not key.startswith(("size_", "min_", "max_")):
                objects[-1][key] = value
    return objects


def slice_file(
    program: str, file: Path, *, layer: float, walls: int, infill: int, pattern: str
) -> Sliced:
    """Slice an STL in the middle of the bed, as a recipe says."""
    code = file.with_suffix(".gcode")
    options = {
        "bed-shape": f"0x0,{BED}x0,{BED}x{BED},0x{BED}",
        "center": f"{BED / 2},{BED / 2}",
        "max-print-height": BED,
        "nozzle-diameter": 0.4,
        "filament-density": PLA_DENSITY / 1000,
        "layer-height": layer,
        "first-layer-height": layer,
        "perimeters": walls,
        "fill-density": f"{infill}%",
        "fill-pattern": pattern,
        "skirts": 0,
        "output": code,
    }
    words = [word for key, value in options.items() for word in (f"--{key}", str(value))]
    said = run(program, "--export-gcode", *words, str(file))
    text = code.read_text(encoding="utf-8")
    (grams,) = re.findall(r"^; filament used \[g\] = ([\d.]+)$", text, flags=re.MULTILINE)
    told = [
        line for line in said.splitlines() if not re.match(r"\d+ => |\[.*trace|Slicing res", line)
    ]
    return Sliced(grams=float(grams), said="\n".join(told), lines=in_the_air(text))


def run(program: str, *words: str) -> str:
    """What the program says; an error where it does not end well."""
    done = subprocess.run([program, *words], capture_output=True, text=True, check=False)
    said = done.stdout + done.stderr
    assert done.returncode == 0, said
    return said


def in_the_air(text: str) -> list[Line]:
    """Lines of a G-code, whose positions of the filament are absolute, that are `ROLES`."""
    role, height, thick = "", 0.0, 0.0
    here = {"X": 0.0, "Y": 0.0, "E": 0.0}
    lines = []
    for command in text.splitlines():
        if command.startswith(";"):
            name, _, value = command[1:].partition(":")
            if name == "TYPE":
                role = value
            elif name == "Z":
                height = float(value)
            elif name == "LAYER_CHANGE":
                thick = 0.0
            elif name == "HEIGHT":
                thick = thick or float(value)
        elif command.startswith("G92"):
            here["E"] = 0.0
        elif command.startswith("G1 "):
            before = dict(here)
            here.update({axis: float(value) for axis, value in MOVE.findall(command)})
            ends = np.array([[each["X"], each["Y"]] for each in (before, here)]) - BED / 2
            if role in ROLES and here["E"] > before["E"] and (ends[0] != ends[1]).any():
                lines.append(Line(role=role, z=height - thick, ends=ends))
    return lines


def longest_bridge(mesh: Mesh, lines: list[Line]) -> float:
    """How far in mm a line reaches over nothing of the part, the longest of all.

    A slicer bridges over sparse infill too, but there the part is below. What hangs over the edge
    of what is below by less than `BESIDE`, as all of a slope does, is no bridge either.
    """
    solid, longest = manifold_from(mesh), 0.0
    polygons: dict[float, list[Array]] = {}
    for line in lines:
        if line.length <= longest:
            continue
        if line.z not in polygons:
            below = solid.slice((line.z - STEP / 5) / 1000)
            wider = below.offset(BESIDE / 1000, manifold3d.JoinType.Round)
            polygons[line.z] = [1000 * np.array(each) for each in wider.to_polygons()]
        count = max(2, round(line.length / STEP) + 1)
        points = np.linspace(line.ends[0], line.ends[1], count)
        is_free = ~_inside(points, polygons[line.z])
        run_length = 0
        for free in is_free.tolist():
            run_length = run_length + 1 if free else 0
            longest = max(longest, (run_length - 1) * line.length / (count - 1))
    return longest


def _inside(points: Array, polygons: list[Array]) -> NDArray[np.bool_]:
    """Which points (n, 2) are inside polygons, whose holes are polygons as well."""
    inside = np.zeros(len(points), dtype=bool)
    x, y = points.T
    for polygon in polygons:
        for (x0, y0), (x1, y1) in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
            crosses = (y0 > y) != (y1 > y)
            if y0 != y1:
                inside ^= crosses & (x < x0 + (y - y0) / (y1 - y0) * (x1 - x0))
    return inside
