"""What the tests of prints share: every job, and measuring on the triangles of a file."""

from __future__ import annotations

from functools import cache
from io import BytesIO

import numpy as np
import trimesh

from duobench.fabrication import PrintedPart, PrintJob, fit_coupon, job_of, stl_bytes
from duobench.tasks import catalog
from duobench.types import Array

TASKS = catalog.names()
TINY = 1e-12


@cache
def job(name: str) -> PrintJob:
    """What is printed of a task, of all mazes; or the coupon."""
    return fit_coupon() if name == "coupon" else job_of(catalog.get(name), ("all",))


JOBS = ("coupon", *TASKS)
PARTS = [(name, part.name) for name in JOBS for part in job(name).parts]


@cache
def part(name: str, of: str) -> PrintedPart:
    (found,) = (each for each in job(name).parts if each.name == of)
    return found


def as_read(one: PrintedPart) -> trimesh.Trimesh:
    """A part as another program reads its STL, in millimetres."""
    mesh = trimesh.load(BytesIO(stl_bytes(one.mesh, one.name)), file_type="stl")
    assert isinstance(mesh, trimesh.Trimesh)
    return mesh


@cache
def triangles(name: str, of: str) -> Array:
    """Corners (m, 3, 3) of a part's STL in metres, back in the frame of its object."""
    one = part(name, of)
    corners = np.asarray(as_read(one).triangles) / 1000
    return one.print_from_object.inverse().apply(corners.reshape(-1, 3)).reshape(-1, 3, 3)


def hits(corners: Array, start: Array, way: Array) -> Array:
    """Distances in metres, forwards, at which a ray passes through triangles, in rising order."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    across = np.cross(way, second)
    sixfold = (first * across).sum(axis=1)
    good = np.abs(sixfold) > TINY
    inverse = np.where(good, 1 / np.where(good, sixfold, 1.0), 0.0)
    away = start - corners[:, 0]
    u = (away * across).sum(axis=1) * inverse
    other = np.cross(away, first)
    v = (other * way).sum(axis=1) * inverse
    found = (second * other).sum(axis=1) * inverse
    return np.sort(found[good & (u >= 0) & (v >= 0) & (u + v <= 1) & (found > 0)])


def width(name: str, of: str, at: tuple[float, ...], way: tuple[float, ...]) -> float:
    """From surface to surface through a point, along a direction, in millimetres.

    It is the thickness of what the point lies in, or the width of a hole.
    """
    corners = triangles(name, of)
    # Off any edge between two triangles.
    start, unit = np.array(at) + 1.3e-7, np.array(way) / np.linalg.norm(way)
    return float(1000 * sum(hits(corners, start, sign * unit)[0] for sign in (1, -1)))
