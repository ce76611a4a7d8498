"""A rigid solid: convex shapes that collide, and the exact mesh to render, print and weigh.

manifold3d, which computes exact meshes, is loaded at first use.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from duobench.core.spatial import SE3
from duobench.core.types import Array, check_several
from duobench.world.objects.shapes import (
    CIRCLE_SEGMENTS,
    Colour,
    Shape,
    ShapeKind,
    check_colour,
)

if TYPE_CHECKING:
    import manifold3d

PLA_DENSITY = 1240.0
"""Density of printed PLA, printed solid, in kg/m³ [filament data sheets]."""
PLASTIC_FRICTION = 0.6
"""Sliding friction of plastic on plastic."""


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """A triangle mesh in metres; its arrays become read-only, since meshes are shared."""

    vertices: Array
    """Vertices (n, 3)."""
    faces: NDArray[np.int32]
    """Triangles (m, 3), counter-clockwise from outside."""

    def __post_init__(self) -> None:
        self.vertices.setflags(write=False)
        self.faces.setflags(write=False)


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    eq=False,
)
class Texture:
    """A texture on a mesh."""

    texels: NDArray[np.uint8]
    """Texels (height, width, 3), red green blue."""
    corners: NDArray[np.float32]
    """Coordinates (3 m, 2) at the corners of the triangles, one triangle after the other: of the
    width from the left, and of the height from above."""


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    eq=False,
)
class Image:
    """A part of what is rendered, in one colour or with a texture."""

    mesh: Mesh
    """Mesh that is rendered."""
    rgba: Colour
    """Red, green, blue and opacity, each 0 to 1; a texture is multiplied with it."""
    shadow: bool = True
    """Whether it casts one."""
    texture: Texture | None = None
    """Texture, if it has one."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Piece:
    """One of the pieces that a solid is printed in: shapes without holes, in the solid's frame."""

    shapes: tuple[Shape, ...]
    """Shapes whose union is one body."""
    holes: tuple[Shape, ...] = ()
    """Cuts, wider by the play of a joint than what goes in."""
    name: str = ""
    """Name within the solid, such as "ring"; equal pieces may have the same."""
    rgba: Colour | None = None
    """Colour that it is printed in, where it differs from the solid's."""
    print_turn: SE3 = field(default_factory=SE3)
    """Rotation from the solid's frame to the printer's, whose z points up."""
    is_shared: bool = False
    """Whether it is the same in all variants of its object, which are put together with it in turn:
    it is printed once for all of them."""


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    eq=False,
)
class Solid:
    """One rigid body's description, in its own frame."""

    shapes: tuple[Shape, ...]
    """Shapes that collide: convex, may overlap. None at all for a mark on the table."""
    rgba: Colour
    """Red, green, blue and opacity, each 0 to 1, of shapes without a colour of their own."""
    mesh: Mesh | None = None
    """Mesh that is printed; the union of the shapes where it is not given."""
    pieces: tuple[Piece, ...] = ()
    """Parts that are printed in its place where that does not fit a printer, to be put together.
    Mass and image are those of the whole: the play of joints is less than 1 % of it."""
    images: tuple[Image, ...] = ()
    """Images that are rendered: the mesh, or the shapes, where none are given."""
    density: float = PLA_DENSITY
    """Density in kg/m³."""
    mass: float | None = None
    """Mass in kg, where the volume does not decide it."""
    inertial: MassProperties | None = None
    """Mass, centre and inertia, where they do not follow from the volume."""
    friction: tuple[float, float, float] = (PLASTIC_FRICTION, 0.005, 0.0001)
    """Sliding, torsional (metres) and rolling (metres) friction."""
    condim: int = 3
    """MuJoCo contact dimension: 1 without friction, 3 sliding, 4 with torsion, 6 with rolling; of
    two solids in contact the larger one holds."""

    def __post_init__(self) -> None:
        check_colour(self.rgba)
        check_several("`shapes` of a Solid", self.shapes, Shape)


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    eq=False,
)
class MassProperties:
    """Mass, centre and inertia of a solid in its own frame."""

    mass: float
    """Mass in kg."""
    centre: Array
    """Centre of mass (3,) in metres."""
    inertia: Array
    """Inertia matrix (3, 3) about the centre of mass in kg·m²."""


def manifold_of(shape: Shape) -> manifold3d.Manifold:
    """The shape as an exact solid for boolean operations."""
    import manifold3d

    m = manifold3d.Manifold
    if shape.kind is ShapeKind.BOX:
        local = m.cube(shape.size, True)
    elif shape.kind is ShapeKind.CYLINDER:
        local = m.cylinder(
            shape.size[1], shape.size[0], shape.size[0], CIRCLE_SEGMENTS, True
        )
    elif shape.kind is ShapeKind.SPHERE:
        local = m.sphere(shape.size[0], CIRCLE_SEGMENTS)
    else:
        local = hull_of(shape.points)
    return placed(local, shape.pose)


def hull_of(points: Iterable[Iterable[float]]) -> manifold3d.Manifold:
    """The convex hull of points as an exact solid."""
    import manifold3d

    return manifold3d.Manifold.hull_points([list(point) for point in points])


def placed(manifold: manifold3d.Manifold, pose: SE3) -> manifold3d.Manifold:
    """An exact solid, brought to a pose."""
    return manifold.transform(np.column_stack([pose.rotation, pose.translation]))


def union_of(shapes: Iterable[Shape]) -> manifold3d.Manifold:
    """Shapes as one exact solid."""
    import manifold3d

    return manifold3d.Manifold.batch_boolean(
        [manifold_of(shape) for shape in shapes], manifold3d.OpType.Add
    )


def mesh_of(manifold: manifold3d.Manifold) -> Mesh:
    """The triangles of an exact solid, in double precision; copied, so that nothing keeps it."""
    mesh = manifold.to_mesh64()
    return Mesh(
        vertices=np.array(mesh.vert_properties, dtype=np.float64)[:, :3],
        faces=np.array(mesh.tri_verts, dtype=np.int32),
    )


@lru_cache(maxsize=256)
def printable(solid: Solid) -> Mesh:
    """The watertight mesh of a solid in its own frame: its `mesh`, or the union of its shapes."""
    return mesh_of(union_of(solid.shapes)) if solid.mesh is None else solid.mesh


@lru_cache(maxsize=256)
def pieces_of(solid: Solid) -> tuple[Mesh, ...]:
    """The watertight meshes to print, in the solid's frame: of its pieces, or `printable` alone.

    Each of them is one body, and fits a printer of `shapes.PRINTER`, turned if need be.
    """
    if not solid.pieces:
        return (printable(solid),)
    return tuple(
        mesh_of(union_of(piece.shapes) - union_of(piece.holes))
        for piece in solid.pieces
    )


def manifold_from(mesh: Mesh) -> manifold3d.Manifold:
    """The exact solid within a watertight mesh."""
    import manifold3d

    return manifold3d.Manifold(
        manifold3d.Mesh64(
            vert_properties=mesh.vertices.copy(), tri_verts=mesh.faces.astype(np.uint64)
        )
    )


def images_of(shapes: Iterable[Shape], rgba: Colour) -> tuple[Image, ...]:
    """Rendered meshes of overlapping shapes: the union of those of one colour, without the others.

    No two faces lie in one place: the renderer adds the light's light once for each of them, and
    shows bright dashes there.
    """
    import manifold3d

    groups: dict[tuple[Colour, bool], list[Shape]] = {}
    for shape in shapes:
        groups.setdefault((shape.rgba or rgba, shape.shadow), []).append(shape)
    images, before = [], manifold3d.Manifold()
    for (colour, shadow), group in groups.items():
        union = union_of(group)
        images.append(Image(mesh=mesh_of(union - before), rgba=colour, shadow=shadow))
        before += union
    return tuple(images)


@lru_cache(maxsize=256)
def mass_properties(solid: Solid) -> MassProperties:
    """Mass properties of the printable mesh, with the solid's density, or scaled to its mass."""
    if solid.inertial is not None:
        return solid.inertial
    mesh = printable(solid)
    # The solid is the signed sum of the tetrahedra that its triangles span with the origin. The
    # sums over triangles are exact: they do not depend on the order of the triangles.
    corners = mesh.vertices[mesh.faces]
    a = corners[:, 0]
    b = corners[:, 1]
    c = corners[:, 2]
    sixfold = (a * np.cross(b, c)).sum(axis=1)
    volume = math.fsum(sixfold.tolist()) / 6
    sums = corners.sum(axis=1)
    first = [math.fsum((sixfold * sums[:, i]).tolist()) / 24 for i in range(3)]
    # The integral of x_i x_j over a tetrahedron with one corner at the origin.
    second = np.empty((3, 3))
    for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)):
        mixed = (corners[:, :, i] * corners[:, :, j]).sum(axis=1) + sums[:, i] * sums[
            :, j
        ]
        second[i, j] = second[j, i] = math.fsum((sixfold * mixed).tolist()) / 120
    centre = np.array(first) / volume
    about_centre = second - volume * centre[:, None] * centre
    inertia = (about_centre[0, 0] + about_centre[1, 1] + about_centre[2, 2]) * np.eye(3)
    scale = solid.density if solid.mass is None else solid.mass / volume
    return MassProperties(
        mass=volume * scale, centre=centre, inertia=(inertia - about_centre) * scale
    )


@lru_cache(maxsize=256)
def corner_points(solid: Solid) -> Array:
    """Points (n, 3) in metres, in its frame, that decide its lowest point at any orientation."""
    if not solid.shapes:
        return printable(solid).vertices
    points = np.vstack([shape.corners() for shape in solid.shapes])
    rounded = np.unique(points.round(7), axis=0)
    rounded.setflags(write=False)
    return rounded
