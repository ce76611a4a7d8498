"""Parametric objects: one description gives collision geometry, image, printable mesh, mass.

`Prop` is an object of a task, `Solid` a rigid part of it, made of shapes such as `box`. The objects
are in modules of their own: `from duobench.world.objects import bowl`, `bowl.bowl(RED)`.
"""

from typing import TYPE_CHECKING

from duobench.core.references import lazy

if TYPE_CHECKING:
    from duobench.world.objects.blocks import (
        BLACK as BLACK,
        CHARCOAL as CHARCOAL,
        CUBE_EDGE as CUBE_EDGE,
        LONG_BLOCK as LONG_BLOCK,
        PALE as PALE,
        RED as RED,
        WHITE as WHITE,
        WOOD as WOOD,
        YELLOW as YELLOW,
        block as block,
        cube as cube,
        long_block as long_block,
    )
    from duobench.world.objects.mesh_file import mesh_object as mesh_object
    from duobench.world.objects.mjcf_file import mjcf_object as mjcf_object
    from duobench.world.objects.prop import (
        Hinge as Hinge,
        Part as Part,
        Prop as Prop,
        Variant as Variant,
    )
    from duobench.world.objects.shapes import (
        Colour as Colour,
        Shape as Shape,
        box as box,
        circle as circle,
        cylinder as cylinder,
        hull as hull,
        prism as prism,
        ring_wall as ring_wall,
        sphere as sphere,
    )
    from duobench.world.objects.solid import (
        Image as Image,
        MassProperties as MassProperties,
        Mesh as Mesh,
        Piece as Piece,
        Solid as Solid,
        corner_points as corner_points,
        images_of as images_of,
        mass_properties as mass_properties,
        mesh_of as mesh_of,
        pieces_of as pieces_of,
        printable as printable,
    )
else:
    __getattr__, __dir__, __all__ = lazy(
        __name__,
        {
            "duobench.world.objects.blocks": [
                "BLACK",
                "CHARCOAL",
                "CUBE_EDGE",
                "LONG_BLOCK",
                "PALE",
                "RED",
                "WHITE",
                "WOOD",
                "YELLOW",
                "block",
                "cube",
                "long_block",
            ],
            "duobench.world.objects.mesh_file": ["mesh_object"],
            "duobench.world.objects.mjcf_file": ["mjcf_object"],
            "duobench.world.objects.prop": ["Hinge", "Part", "Prop", "Variant"],
            "duobench.world.objects.shapes": [
                "Colour",
                "Shape",
                "box",
                "circle",
                "cylinder",
                "hull",
                "prism",
                "ring_wall",
                "sphere",
            ],
            "duobench.world.objects.solid": [
                "Image",
                "MassProperties",
                "Mesh",
                "Piece",
                "Solid",
                "corner_points",
                "images_of",
                "mass_properties",
                "mesh_of",
                "pieces_of",
                "printable",
            ],
        },
    )
