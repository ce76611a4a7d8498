"""Parametric objects: one description gives collision geometry, image, printable mesh, mass.

`Prop` is an object of a task, `Solid` a rigid part of it, made of shapes such as `box`. The objects
of the benchmark are in modules of their own: `from duobench.objects import bowl`, `bowl.bowl(RED)`.
"""

from typing import TYPE_CHECKING

from duobench.references import lazy

if TYPE_CHECKING:
    from duobench.objects.blocks import BLACK as BLACK
    from duobench.objects.blocks import CHARCOAL as CHARCOAL
    from duobench.objects.blocks import CUBE_EDGE as CUBE_EDGE
    from duobench.objects.blocks import LONG_BLOCK as LONG_BLOCK
    from duobench.objects.blocks import PALE as PALE
    from duobench.objects.blocks import RED as RED
    from duobench.objects.blocks import WHITE as WHITE
    from duobench.objects.blocks import WOOD as WOOD
    from duobench.objects.blocks import YELLOW as YELLOW
    from duobench.objects.blocks import block as block
    from duobench.objects.blocks import cube as cube
    from duobench.objects.blocks import long_block as long_block
    from duobench.objects.prop import Hinge as Hinge
    from duobench.objects.prop import Part as Part
    from duobench.objects.prop import Prop as Prop
    from duobench.objects.prop import Variant as Variant
    from duobench.objects.shapes import Colour as Colour
    from duobench.objects.shapes import Shape as Shape
    from duobench.objects.shapes import box as box
    from duobench.objects.shapes import circle as circle
    from duobench.objects.shapes import cylinder as cylinder
    from duobench.objects.shapes import hull as hull
    from duobench.objects.shapes import prism as prism
    from duobench.objects.shapes import ring_wall as ring_wall
    from duobench.objects.shapes import sphere as sphere
    from duobench.objects.solid import Image as Image
    from duobench.objects.solid import MassProperties as MassProperties
    from duobench.objects.solid import Mesh as Mesh
    from duobench.objects.solid import Piece as Piece
    from duobench.objects.solid import Solid as Solid
    from duobench.objects.solid import corner_points as corner_points
    from duobench.objects.solid import images_of as images_of
    from duobench.objects.solid import mass_properties as mass_properties
    from duobench.objects.solid import mesh_of as mesh_of
    from duobench.objects.solid import pieces_of as pieces_of
    from duobench.objects.solid import printable as printable

lazy(__name__)
