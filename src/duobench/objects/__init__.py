"""Parametric objects: one description gives collision geometry, image, printable mesh, mass.

`Prop` is an object of a task, `Solid` a rigid part of it, made of shapes such as `box`. The objects
of the benchmark are in modules of their own: `from duobench.objects import bowl`, `bowl.bowl(RED)`.
"""

from duobench.objects.blocks import (
    BLACK,
    CHARCOAL,
    CUBE_EDGE,
    LONG_BLOCK,
    PALE,
    RED,
    WHITE,
    WOOD,
    YELLOW,
    block,
    cube,
    long_block,
)
from duobench.objects.prop import Hinge, Part, Prop, Variant
from duobench.objects.shapes import (
    Colour,
    Shape,
    box,
    circle,
    cylinder,
    hull,
    prism,
    ring_wall,
    sphere,
)
from duobench.objects.solid import (
    Image,
    MassProperties,
    Mesh,
    Solid,
    corner_points,
    images_of,
    mass_properties,
    mesh_of,
    printable,
)

__all__ = [
    "BLACK",
    "CHARCOAL",
    "CUBE_EDGE",
    "LONG_BLOCK",
    "PALE",
    "RED",
    "WHITE",
    "WOOD",
    "YELLOW",
    "Colour",
    "Hinge",
    "Image",
    "MassProperties",
    "Mesh",
    "Part",
    "Prop",
    "Shape",
    "Solid",
    "Variant",
    "block",
    "box",
    "circle",
    "corner_points",
    "cube",
    "cylinder",
    "hull",
    "images_of",
    "long_block",
    "mass_properties",
    "mesh_of",
    "printable",
    "prism",
    "ring_wall",
    "sphere",
]
