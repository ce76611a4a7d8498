"""The parts that a task's objects are printed in, and how they lie on the printer's beds."""

import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from duobench.core.errors import FabricationError, UnknownNameError
from duobench.core.spatial import SE3
from duobench.core.types import Array
from duobench.printing.details import Dimension, PurchasedPart, parts_to_buy
from duobench.tasks.task import Task
from duobench.world.objects.prop import Prop
from duobench.world.objects.shapes import (
    KEPT_FREE,
    PRINTER,
    THINNEST_WALL,
    Colour,
)
from duobench.world.objects.solid import (
    PLA_DENSITY,
    Mesh,
    Solid,
    manifold_from,
    mass_properties,
    mesh_of,
    pieces_of,
    placed,
)

GAP = 0.006
"""Distance between parts in metres: room for brims, and for the nozzle's hood."""
BESIDE, BEHIND = PRINTER - KEPT_FREE[0], PRINTER - KEPT_FREE[1]
"""Width of the bed beside the corner that is kept free, and depth behind it, in metres."""
ALL_VARIANTS = "all"
"""Word in place of variants: all variants."""
SAME_VOLUME = 1e-12
"""Volume in m³ by which equal parts may differ: what arithmetic leaves of nothing."""
_MERGED = 1e-6
"""Metres within which vertices of a mesh are merged, so that none of its triangles is a sliver."""
_UNSAFE = re.compile(r"[^\w.-]+")


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    eq=False,
)
class PrintedPart:
    """One part, in its print pose."""

    name: str
    """Name of its file, without the suffix."""
    body: str
    """The object or part of an object that it belongs to, such as "chest/lid"; of an object with
    variants, one of them, such as "board_3", or without a number all of them."""
    piece: str = ""
    """Number of the piece, if it is printed in several."""
    mesh: Mesh
    """Printed mesh, in metres: z up, its lowest point at 0, the middle of its box over 0, 0."""
    rgba: Colour
    count: int = 1
    print_from_object: SE3 = field(default_factory=SE3)
    """Pose of the object's frame in that of the mesh."""
    is_solid: bool = True
    """Whether its mass is felt, so that it is printed without hollows."""
    density: float = PLA_DENSITY
    """Density in kg/m³ of what is printed solid."""
    is_shared: bool = False
    """Whether it belongs to all variants of its object."""
    sizes: tuple[Dimension, ...] = ()
    """Sizes to measure with calipers, beyond the box around it and the facts about its task."""

    @property
    def size(self) -> Array:
        """Edges (3,) of the box around it in metres."""
        return np.ptp(self.mesh.vertices, axis=0)

    @property
    def volume(self) -> float:
        """Volume of one of it in m³."""
        return manifold_from(self.mesh).volume()

    @property
    def mass(self) -> float:
        """Mass of one of it, printed solid, in kg."""
        return self.volume * self.density


@dataclass(frozen=True, kw_only=True, slots=True)
class ObjectMass:
    """Mass of an object, or of a part of it that moves by itself, when it is put together."""

    body: str
    mass: float
    """Simulated mass in kg."""
    is_solid: bool
    """Whether the mass is felt; that of something fixed to the table is not."""


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    eq=False,
)
class PrintJob:
    """Parts that are printed together: all of a task, or the jig."""

    id: str
    """Name of its folder: the task's."""
    title: str
    description: str
    parts: tuple[PrintedPart, ...]
    masses: tuple[ObjectMass, ...] = ()
    bought: tuple[PurchasedPart, ...] = ()
    """Parts that are not printed."""
    notes: tuple[str, ...] = ()
    """Notes beyond the facts about its task."""


def job_of(task: Task, variants: Sequence[str] = ()) -> PrintJob:
    """Parts to print of a task.

    Of an object with variants, such as numbers of mazes, those that are given: "all" means all of
    them, nothing the first one.

    Raises:
        UnknownNameError: There is no such variant.
        FabricationError: A part does not fit a printer of `shapes.PRINTER`, is not one body, or is
            thinner than a wall can be.
    """
    bought = parts_to_buy(task)
    not_printed = {name for item in bought for name in item.props}
    parts, masses = [], []
    for prop in task.props:
        if prop.name in not_printed:
            continue
        for number, (value, variant) in enumerate(_values(prop, variants)):
            label = f"{prop.name}_{value}" if value else prop.name
            new, weights = _printed(prop, label, variant)
            parts += (
                new if number == 0 else [part for part in new if not part.is_shared]
            )
            masses += weights
    parts = _with_names(_merged(parts))
    for part in parts:
        _check(part)
    return PrintJob(
        id=task.id,
        title=task.title,
        description=f"Printed objects of the task {task.title} of the benchmark DuoBench.",
        parts=tuple(parts),
        masses=tuple(masses),
        bought=bought,
    )


def _check(part: PrintedPart) -> None:
    """Reject what no printer makes: too large, in several bodies, or thin as a whole."""
    size = " × ".join(f"{1000 * edge:.1f}".removesuffix(".0") for edge in part.size)
    bodies = sum(
        body.volume() > 0 for body in manifold_from(part.mesh).decompose()
    )  # no hollows
    if (part.size > PRINTER).any():
        why = (
            f"it is {size} mm as it lies, and the printer takes {1000 * PRINTER:.0f} mm. Give its "
            "solid `pieces` to be put together, or another `print_turn`."
        )
    elif bodies > 1:
        why = f"it is {bodies} bodies that do not touch. Join its shapes, or give it `pieces`."
    elif (part.size < THINNEST_WALL).any():
        why = (
            f"it is {size} mm, and the thinnest wall is {1000 * THINNEST_WALL:.1f} mm."
        )
    else:
        return
    raise FabricationError(f"{part.body} cannot be printed: {why}")


def upright(
    name: str, mesh: Mesh, rgba: Colour, *, turn: SE3 | None = None, body: str = ""
) -> PrintedPart:
    """A part of a mesh, which is in the object's frame in metres, turned and set on the bed."""
    turn = turn or SE3()
    turned = placed(manifold_from(mesh), turn).as_original().simplify(_MERGED)
    low, high = (np.array(turned.bounding_box()[k : k + 3]) for k in (0, 3))
    x, y = (-(low + high)[:2] / 2).tolist()
    shift = SE3.at(x, y, -float(low[2]))
    moved = mesh_of(turned)
    vertices = (moved.vertices + shift.translation).round(9)
    return PrintedPart(
        name=name,
        body=body or name,
        mesh=Mesh(vertices=vertices, faces=moved.faces),
        rgba=rgba,
        print_from_object=shift @ turn,
    )


def _values(
    prop: Prop, variants: Sequence[str]
) -> Iterator[tuple[str, Mapping[str, str]]]:
    """The variants of an object to print; one without a name where it has none."""
    if prop.choice is None:
        yield "", {}
        return
    known = tuple(prop.variants)
    chosen = (
        known
        if ALL_VARIANTS in variants
        else tuple(dict.fromkeys(variants)) or known[:1]
    )
    for value in chosen:
        if value not in known:
            raise UnknownNameError(f"variant of {prop.name}", value, known)
        yield value, {prop.choice: value}


def _printed(
    prop: Prop, label: str, variant: Mapping[str, str]
) -> tuple[list[PrintedPart], list[ObjectMass]]:
    root, *others = prop.prints(variant)
    bodies = [(label, root, prop.print_turn, prop.fixed)]
    for part, solid in zip(prop.parts, others, strict=True):
        is_still = prop.fixed and part.hinge is None
        bodies.append((f"{label}/{part.name}", solid, part.print_turn, is_still))
    parts, masses = [], []
    for body, solid, turn, is_still in bodies:
        shared = prop.name + body.removeprefix(label)
        mass = mass_properties(solid).mass
        masses.append(ObjectMass(body=body, mass=mass, is_solid=not is_still))
        parts += [
            replace(part, is_solid=not is_still, density=solid.density)
            for part in _pieces(body, shared, solid, turn)
        ]
    return parts, masses


def _pieces(
    body: str,
    shared: str,
    solid: Solid,
    turn: SE3,
) -> Iterator[PrintedPart]:
    """The pieces of a solid, or the one that it is; and the body that shared ones belong to."""
    meshes = pieces_of(solid)
    if not solid.pieces:
        yield upright(
            body.replace("/", "-"), meshes[0], solid.rgba, turn=turn, body=body
        )
        return
    for number, (piece, mesh) in enumerate(zip(solid.pieces, meshes, strict=True), 1):
        name, owner = piece.name or str(number), shared if piece.is_shared else body
        made = upright(
            f"{owner.replace('/', '-')}-{name}",
            mesh,
            piece.rgba or solid.rgba,
            turn=piece.print_turn,
            body=owner,
        )
        yield replace(made, piece=name, is_shared=piece.is_shared)


def _merged(parts: list[PrintedPart]) -> list[PrintedPart]:
    """Parts of which equal pieces of the same name are one that is printed several times."""
    kept: list[PrintedPart] = []
    for part in parts:
        for number, other in enumerate(kept):
            if part.piece and part.name == other.name and _same(part.mesh, other.mesh):
                kept[number] = replace(other, count=other.count + part.count)
                break
        else:
            kept.append(part)
    return kept


def _same(one: Mesh, other: Mesh) -> bool:
    """Whether two parts on the bed are the same but for quarter turns."""
    first, second = manifold_from(one), manifold_from(other)
    turns = (SE3.at(yaw=k * math.pi / 2) for k in range(4))
    return any(
        (first - turned).volume() < SAME_VOLUME
        and (turned - first).volume() < SAME_VOLUME
        for turned in (placed(second, turn) for turn in turns)
    )


def _with_names(parts: list[PrintedPart]) -> list[PrintedPart]:
    """Parts with names that any file system takes, each another one."""
    names = [_UNSAFE.sub("_", part.name).lstrip(".") or "part" for part in parts]
    several = {
        name for name, count in Counter(map(str.lower, names)).items() if count > 1
    }
    numbered = [
        f"{name}-{number}" if name.lower() in several else name
        for number, name in enumerate(names, 1)
    ]
    return [
        replace(part, name=name) for part, name in zip(parts, numbered, strict=True)
    ]


# --- where they lie on the beds, without overlapping, and clear of one corner ---


@dataclass(frozen=True, kw_only=True, slots=True)
class Spot:
    """Place of one copy of a part."""

    part: PrintedPart
    copy: int
    """Number of the copy, from 0."""
    bed: int
    x: float
    """Middle of the part's box on the bed, in metres from its left edge."""
    y: float
    """The same from its front edge."""


@dataclass(slots=True)
class _Row:
    front: float
    depth: float
    used: float = 0.0
    spots: list[tuple[PrintedPart, int, float]] = field(default_factory=list)

    def add(self, part: PrintedPart, copy: int) -> bool:
        """Put a part to the right of the others, if there is room."""
        width, depth, _ = part.size
        begin = self.used + GAP if self.spots else 0.0
        if depth > self.depth or begin + width > (BESIDE if self.spots else PRINTER):
            return False
        self.spots.append((part, copy, begin + width / 2))
        self.used = begin + width
        return True


def lay_out(parts: Sequence[PrintedPart]) -> tuple[Spot, ...]:
    """Lay parts that fit `shapes.PRINTER` out in rows, on as many beds as that takes.

    What lies on a bed is in its middle, or in that of what is beside or behind the corner that is
    kept free; a part that fills the bed lies alone.
    """
    copies = [(part, copy) for part in parts for copy in range(part.count)]
    copies.sort(
        key=lambda each: (-each[0].size[1], -each[0].size[0], each[0].name, each[1])
    )
    beds: list[list[_Row]] = []
    for part, copy in copies:
        if not any(row.add(part, copy) for rows in beds for row in rows):
            _new_row(beds, *map(float, part.size[:2])).add(part, copy)
    return tuple(spot for bed, rows in enumerate(beds) for spot in _centred(bed, rows))


def _new_row(
    beds: list[list[_Row]],
    width: float,
    depth: float,
) -> _Row:
    """A row behind the others of a bed that has room, or the first of a new bed."""
    for rows in beds:
        front = rows[-1].front + rows[-1].depth + GAP
        is_narrow = max(width, *(row.used for row in rows)) <= BESIDE
        if front + depth <= (PRINTER if is_narrow else BEHIND):
            rows.append(_Row(front=front, depth=depth))
            return rows[-1]
    beds.append([_Row(front=0.0, depth=depth)])
    return beds[-1][0]


def _centred(bed: int, rows: list[_Row]) -> list[Spot]:
    width, depth = max(row.used for row in rows), rows[-1].front + rows[-1].depth
    left, front = (PRINTER - width) / 2, (PRINTER - depth) / 2
    aside = behind = 0.0
    if left < KEPT_FREE[0] and front < KEPT_FREE[1]:
        if width <= BESIDE:
            aside = KEPT_FREE[0] / 2
        elif depth <= BEHIND:
            behind = KEPT_FREE[1] / 2
    return [
        Spot(
            part=part,
            copy=copy,
            bed=bed,
            x=aside + (PRINTER - row.used) / 2 + x,
            y=behind + front + row.front + row.depth / 2,
        )
        for row in rows
        for part, copy, x in row.spots
    ]
