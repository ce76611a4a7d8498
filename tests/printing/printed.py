"""What the tests of prints share: every job, and measuring on the triangles of a file."""

from __future__ import annotations

import re
from functools import cache
from io import BytesIO

import manifold3d
import numpy as np
import trimesh

from duobench.printing import (
    Foot,
    PrintedPart,
    PrintJob,
    fit_coupon,
    job_of,
    placing_jig,
    stl_bytes,
)
from duobench.tasks import catalog
from duobench.world.objects.solid import Mesh, manifold_from

TASKS = catalog.names()


@cache
def job(name: str) -> PrintJob:
    """What is printed of a task, of all mazes; or the coupon, or the jig."""
    if name == "coupon":
        return fit_coupon()
    return placing_jig(Foot()) if name == "jig" else job_of(catalog.get(name), ("all",))


JOBS = ("coupon", "jig", *TASKS)
PARTS = [(name, part.name) for name in JOBS for part in job(name).parts]


def belongs(part_body: str, body: str) -> bool:
    """Whether a part is one of an object, or of all its variants, such as "board" of "board_3"."""
    return part_body in (body, re.sub(r"_[0-9]+(?=/|$)", "", body))


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
def solid(name: str, of: str) -> manifold3d.Manifold:
    """A part's STL in metres, back in the frame of its object."""
    one = part(name, of)
    read = as_read(one)
    vertices = one.print_from_object.inverse().apply(np.asarray(read.vertices) / 1000)
    return manifold_from(Mesh(vertices=vertices, faces=np.asarray(read.faces)))


def reach(name: str, of: str, at: tuple[float, ...], way: tuple[float, ...]) -> float:
    """How far from a point it is to the first surface, in millimetres."""
    start, unit = np.array(at) + 1.3e-7, np.array(way) / np.linalg.norm(way)  # off any edge
    first, *_ = solid(name, of).ray_cast(start.tolist(), (start + unit).tolist())
    return 1000 * first.distance


def width(name: str, of: str, at: tuple[float, ...], way: tuple[float, ...]) -> float:
    """From surface to surface through a point, along a direction, in millimetres.

    It is the thickness of what the point lies in, or the width of a hole.
    """
    return sum(reach(name, of, at, tuple(sign * each for each in way)) for sign in (1, -1))
