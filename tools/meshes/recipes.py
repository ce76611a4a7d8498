"""The recipe of every mesh that is made from the files: triangles are spent where cameras look.

Lettering, icons, screws and plugs of the published arm are left out. They are a third of its
meshes, and smaller than a pixel in the camera images.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

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
    return VisualGroup(fills_mm=MappingProxyType(fills), cell_mm=cell_mm, triangles=triangles)


def _gripper(name: str, triangles: int) -> VisualGroup:
    fills = MappingProxyType({f"robotiq_2f85/{name}": 0.0})
    return VisualGroup(fills_mm=fills, cell_mm=1.0, triangles=triangles)


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
"""Image meshes, but for the outlines below.

Two arms and two grippers with two fingers each, outlines included, are 5,732 triangles. On two
cores, a thousand more would add 0.4 ms to an image with shadows, and show in no camera image.
"""

VISUAL_OUTLINES: Mapping[str, int] = MappingProxyType(
    {
        "fr3/link0_5": 14,  # the red plug of the emergency stop
        "robotiq_2f85/base_coupling": 34,  # a disc between flange and gripper
        "robotiq_2f85/c-a01-85-open": 14,  # a plate between the fingers
    }
)
"""Image meshes of which only the outline shows: convex hulls, with their number of vertices."""

VISUAL: Mapping[str, str] = MappingProxyType(
    {
        name: name + (".obj" if name.startswith("fr3/") else ".stl")
        for names in (*(group.fills_mm for group in VISUAL_GROUPS), VISUAL_OUTLINES)
        for name in names
    }
)
"""Source file of every image mesh by name."""

_COLLIDING = ("base", "driver", "coupler", "spring_link", "follower")
_HULLS = (
    *(f"fr3/link{number}" for number in range(8)),
    *(f"robotiq_2f85/{part}" for part in _COLLIDING),
)

HULL: Mapping[str, str] = MappingProxyType({name: name + ".stl" for name in _HULLS})
"""Source file of every collision hull by name."""
