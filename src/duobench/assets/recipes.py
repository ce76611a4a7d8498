"""The recipe of every mesh that is made from the files: budgets are spent where cameras look."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

VERSION = 1
"""Raised with every change to the code that makes meshes, so that caches are made anew."""

HULL_VERTICES = 24
"""Largest number of vertices of a collision hull; few vertices make contact queries fast."""


@dataclass(frozen=True, kw_only=True, slots=True)
class VisualRecipe:
    """How a picture mesh is made."""

    file: str
    """Name of the source file."""
    cell_mm: float
    """Edge of the clustering grid in millimetres."""
    triangles: int
    """Triangle budget."""


def _visual(suffix: str, table: Mapping[str, tuple[float, int]]) -> dict[str, VisualRecipe]:
    return {
        name: VisualRecipe(file=name + suffix, cell_mm=cell_mm, triangles=triangles)
        for name, (cell_mm, triangles) in table.items()
    }


VISUAL: Mapping[str, VisualRecipe] = MappingProxyType(
    _visual(
        ".obj",
        {
            "fr3/link0_0": (4.0, 20),
            "fr3/link0_1": (4.0, 40),
            "fr3/link0_2": (4.0, 40),
            "fr3/link0_3": (3.0, 250),
            "fr3/link0_4": (4.0, 40),
            "fr3/link0_5": (4.0, 12),
            "fr3/link0_6": (4.0, 80),
            "fr3/link1": (3.0, 320),
            "fr3/link2": (3.0, 320),
            "fr3/link3_0": (3.0, 300),
            "fr3/link3_1": (3.0, 120),
            "fr3/link4_0": (3.0, 300),
            "fr3/link4_1": (3.0, 120),
            "fr3/link5_0": (3.0, 320),
            "fr3/link5_1": (4.0, 12),
            "fr3/link5_2": (3.0, 120),
            "fr3/link6_0": (4.0, 2),
            "fr3/link6_1": (3.0, 60),
            "fr3/link6_2": (3.0, 280),
            "fr3/link6_3": (4.0, 24),
            "fr3/link6_4": (4.0, 2),
            "fr3/link6_5": (4.0, 4),
            "fr3/link6_6": (3.0, 120),
            "fr3/link6_7": (4.0, 2),
            "fr3/link7_0": (4.0, 12),
            "fr3/link7_1": (3.0, 180),
            "fr3/link7_2": (3.0, 80),
            "fr3/link7_3": (4.0, 20),
        },
    )
    | _visual(
        ".stl",
        {
            "robotiq_2f85/base": (2.0, 320),
            "robotiq_2f85/base_coupling": (2.0, 80),
            "robotiq_2f85/c-a01-85-open": (2.0, 30),
            "robotiq_2f85/driver": (2.0, 60),
            "robotiq_2f85/coupler": (2.0, 70),
            "robotiq_2f85/spring_link": (2.0, 70),
            "robotiq_2f85/follower": (2.0, 90),
            "robotiq_2f85/tongue": (2.0, 70),
        },
    )
)
"""Picture meshes by name: grid in millimetres and triangle budget."""

HULL: Mapping[str, str] = MappingProxyType(
    {
        name: name + ".stl"
        for name in (
            "fr3/link0",
            "fr3/link1",
            "fr3/link2",
            "fr3/link3",
            "fr3/link4",
            "fr3/link5",
            "fr3/link6",
            "fr3/link7",
            "robotiq_2f85/base",
            "robotiq_2f85/base_coupling",
            "robotiq_2f85/driver",
            "robotiq_2f85/coupler",
            "robotiq_2f85/spring_link",
            "robotiq_2f85/follower",
            "robotiq_2f85/tongue",
        )
    }
)
"""Source file of every collision hull by name."""
