"""How to print a job: printer, settings, masses, sizes to measure, and how it is put together."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from duobench.core import pages
from duobench.printing import details
from duobench.printing.details import Dimension, PurchasedPart, lines_of
from duobench.printing.formats import hex_colour
from duobench.printing.parts import PrintedPart, PrintJob, lay_out
from duobench.world.objects.mazes import CELLS, MAZES, Cell
from duobench.world.objects.shapes import PRINTER, Colour
from duobench.world.objects.solid import PLA_DENSITY, manifold_from

RECIPE_SCHEMA = 3
NOZZLE, LAYER, FINE_LAYER = 0.4, 0.2, 0.12
"""Diameter of the nozzle and height of the layers in mm; the finer ones are for chamfers."""
WALLS = 4
"""Lines of a wall."""
SPARSE = 0.15
"""Share that is filled of what may be lighter than simulated."""
SOLID_PATTERN, SPARSE_PATTERN = "rectilinear", "grid"
"""Patterns of what is filled, by the names that slicers give them. A pattern has to be named: the
one that some of them begin with is refused at 100 %."""
SPOOL_G = 1000.0
"""Filament on a spool in g."""
TOLERANCE = 0.05
"""Share by which the mass of what is lifted may be off."""


@dataclass(frozen=True, kw_only=True, slots=True)
class PartRecipe:
    """Instructions for printing one part."""

    name: str
    file: str
    """Its STL, in the folder of the recipe."""
    body: str
    count: int
    beds: list[int]
    """On which beds of the 3MF its copies lie, counted from 1."""
    size_mm: tuple[float, float, float]
    """Width, depth and height as it lies."""
    orientation: str
    colour: str
    colour_changes: list[tuple[float, str]]
    """Heights in mm above the bed from which it has another colour."""
    layer_mm: float
    walls: int
    infill_percent: int
    """Filled share in per cent: 100 is solid."""
    infill_pattern: str
    supports: str
    volume_cm3: float
    mass_g: tuple[float, float, float] | None
    """Mass of one: least, target and most. None where it may weigh anything."""
    dimensions: list[Dimension]
    filament_g: dict[str, float]
    """Filament of one in g by colour, without supports; what is not solid is estimated."""


@dataclass(frozen=True, kw_only=True, slots=True)
class ObjectRecipe:
    """Mass of an object when it is put together, and how it is fixed."""

    body: str
    """The object, or the part of it that moves by itself."""
    mass_g: tuple[float, float, float] | None
    """Least, target and most. None where it may weigh anything."""
    fixing: str
    """Fixing to the table; empty if it is not fixed."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Recipe:
    """How to print a job."""

    id: str
    """The task, or "jig"."""
    title: str
    printer: str
    material: str
    nozzle_mm: float
    file: str | None
    """The 3MF with all parts; None where nothing is printed."""
    beds: int
    parts: list[PartRecipe]
    objects: list[ObjectRecipe]
    """Objects that they are put together to."""
    assembly: list[str]
    """Instructions for that."""
    bought: list[PurchasedPart]
    notes: list[str]


def recipe_of(job: PrintJob) -> Recipe:
    """How to print a job."""
    spots = lay_out(job.parts)
    known = details.details_of(job.id)
    beds = {
        part.name: [s.bed + 1 for s in spots if s.part is part] for part in job.parts
    }
    parts = [_part(job.id, part, beds[part.name]) for part in job.parts]
    return Recipe(
        id=job.id,
        title=job.title,
        printer=f"filament, bed and height of {1000 * PRINTER:.0f} mm",
        material=f"PLA, {PLA_DENSITY:.0f} kg/m³ when printed solid",
        nozzle_mm=NOZZLE,
        file=f"{job.id}.3mf" if parts else None,
        beds=max((spot.bed + 1 for spot in spots), default=0),
        parts=parts,
        objects=[
            ObjectRecipe(
                body=each.body,
                mass_g=_range(1000 * each.mass) if each.is_solid else None,
                fixing=known.fixing.get(each.body, ""),
            )
            for each in job.masses
        ],
        assembly=list(known.assembly),
        bought=list(job.bought),
        notes=_notes(job),
    )


def _part(
    job: str,
    part: PrintedPart,
    beds: list[int],
) -> PartRecipe:
    key = _key(job, part)
    changes = [details.CHANGES[key]] if key in details.CHANGES else []
    width, depth, height = (round(1000 * float(edge), 2) for edge in part.size)
    return PartRecipe(
        name=part.name,
        file=f"{part.name}.stl",
        body=part.body,
        count=part.count,
        beds=sorted(set(beds)),
        size_mm=(width, depth, height),
        orientation=_orientation(part),
        colour=hex_colour(part.rgba),
        colour_changes=[
            (round(1000 * above, 3), hex_colour(rgba)) for above, rgba in changes
        ],
        layer_mm=FINE_LAYER if key in details.FINE else LAYER,
        walls=WALLS,
        infill_percent=100 if part.is_solid else round(100 * SPARSE),
        infill_pattern=SOLID_PATTERN if part.is_solid else SPARSE_PATTERN,
        supports=details.details_of(job).supports.get(key.partition("/")[2], "none"),
        volume_cm3=round(1e6 * part.volume, 2),
        mass_g=_range(1000 * part.mass) if part.is_solid else None,
        dimensions=[
            *(
                Dimension(what=what, mm=mm, tolerance_mm=details.FREE)
                for what, mm in (("width", width), ("depth", depth), ("height", height))
            ),
            *details.DIMENSIONS.get(key, ()),
            *part.sizes,
        ],
        filament_g=_filament(part, changes),
    )


def _filament(
    part: PrintedPart, changes: Sequence[tuple[float, Colour]]
) -> dict[str, float]:
    """Grams of filament of a part by colour; colours change at heights in metres."""
    whole = manifold_from(part.mesh)
    top = float(part.size[2])
    grams: dict[str, float] = {}
    bounds = [(0.0, part.rgba), *changes, (top, part.rgba)]
    for (low, rgba), (high, _) in pairwise(bounds):
        above = whole.trim_by_plane((0.0, 0.0, 1.0), low)
        slab = above.trim_by_plane((0.0, 0.0, -1.0), -high)
        kilograms = slab.volume() * part.density * _filled(part)
        name = hex_colour(rgba)
        grams[name] = round(grams.get(name, 0.0) + 1000 * kilograms, 1)
    return grams


def _filled(part: PrintedPart) -> float:
    """Share of a part's volume that is filled: its walls, and of what they enclose `SPARSE`."""
    if part.is_solid:
        return 1.0
    solid = manifold_from(part.mesh)
    shell = min(WALLS * NOZZLE / 1000 * solid.surface_area() / solid.volume(), 1.0)
    return shell + (1.0 - shell) * SPARSE


def total_filament(recipes: Iterable[Recipe]) -> dict[str, float]:
    """Filament of all parts of recipes in g by colour, in the order of the colours."""
    total: dict[str, float] = {}
    for recipe in recipes:
        for part in recipe.parts:
            for colour, grams in part.filament_g.items():
                total[colour] = total.get(colour, 0.0) + part.count * grams
    return dict(sorted(total.items()))


def spools(grams: float) -> int:
    """Spools of a kilogram that so many grams of a colour take."""
    return math.ceil(grams / SPOOL_G)


def _key(job: str, part: PrintedPart) -> str:
    """Task, body and piece, without the number of a variant."""
    body, slash, rest = part.body.partition("/")
    stem = body.rpartition("_")[0] if body.rpartition("_")[2].isdigit() else body
    return "/".join(filter(None, (job, stem + slash + rest, part.piece)))


def _range(grams: float) -> tuple[float, float, float]:
    least, target, most = (grams * (1 + k * TOLERANCE) for k in (-1, 0, 1))
    return round(least, 1), round(target, 1), round(most, 1)


def _orientation(part: PrintedPart) -> str:
    up = part.print_from_object.rotation[2]
    axis = int(np.abs(up).argmax())
    if up[axis] < 1 - 1e-6 and up[axis] > -1 + 1e-6:
        return "as it lies in the 3MF"
    name = f"{'+' if up[axis] > 0 else '-'}{'xyz'[axis]}"
    return "as it stands on the table" if name == "+z" else f"its {name} side up"


def _notes(job: PrintJob) -> list[str]:
    notes = [*details.details_of(job.id).notes, *job.notes]
    if job.id == "ball_maze":
        for each in job.masses:
            number = each.body.rpartition("_")[2]
            if number.isdigit():
                maze = MAZES[int(number)]
                notes.append(
                    f"Maze {number}, seen from above as it lies in the 3MF: it starts "
                    f"{_corner(maze.start)}, its goal is {_corner(maze.goal)}."
                )
    return notes


def _corner(cell: Cell) -> str:
    column, row = cell
    return f"{'back' if row == CELLS - 1 else 'front'} {'right' if column == CELLS - 1 else 'left'}"


# --- the page ---

UNTRIED = (
    "Nothing of this was printed by us so far; a slicer, PrusaSlicer, takes all parts of the "
    "benchmark in tests. Weigh and measure."
)


def recipe_page(recipe: Recipe) -> str:
    """A recipe as a page for people, in Markdown."""
    return pages.render(
        "duobench.printing",
        "recipe.md.j2",
        recipe=recipe,
        bought=list(lines_of(recipe.bought)),
        mass=_mass,
        untried=UNTRIED,
        tolerance=f"{100 * TOLERANCE:.0f}",
    )


def _mass(grams: tuple[float, float, float] | None) -> str:
    if grams is None:
        return "any"
    least, target, most = grams
    return f"{target:.1f} ({least:.1f} to {most:.1f})"
