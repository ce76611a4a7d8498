"""A recipe as a page for people, in Markdown."""

from __future__ import annotations

from collections.abc import Iterator

from duobench.fabrication.recipe import (
    LAYER,
    MATERIAL_PER_SECOND,
    SPARSE,
    TOLERANCE,
    WASTE,
    PartRecipe,
    Recipe,
)
from duobench.fabrication.shopping import shopping_lines

UNTRIED = (
    "Nothing of this was printed by us so far, and no printer's program was tried with the files: "
    "print the coupon first, weigh and measure."
)
"""What to know before anything is printed."""


SOLID = 100
"""Percent of infill of a part without hollows."""


def recipe_page(recipe: Recipe) -> str:
    """A recipe as Markdown."""
    return "\n".join(_lines(recipe)) + "\n"


def _lines(recipe: Recipe) -> Iterator[str]:
    yield f"# Printing: {recipe.title}"
    yield ""
    yield UNTRIED
    yield ""
    if recipe.parts:
        yield from _settings(recipe)
        yield from _parts(recipe)
        yield from _sizes(recipe)
    else:
        yield "Nothing of this task is printed."
        yield ""
    yield from _objects(recipe)
    for title, lines in (
        ("Putting it together", [f"{n}. {line}" for n, line in enumerate(recipe.assembly, 1)]),
        ("What is bought", list(shopping_lines(tuple(recipe.bought)))),
        ("Notes", [f"- {line}" for line in recipe.notes]),
    ):
        if lines:
            yield from (f"## {title}", "", *lines, "")


def _settings(recipe: Recipe) -> Iterator[str]:
    yield f"- Printer: {recipe.printer}; nozzle of {recipe.nozzle_mm} mm"
    yield f"- Material: {recipe.material}"
    where = "on one bed" if recipe.beds == 1 else f"on {recipe.beds} beds side by side"
    yield f"- `{recipe.file}` has all parts as they lie, {where}; each is an STL too, in mm"
    yield f"- In all about {recipe.filament_g:.0f} g of filament and {recipe.hours:.1f} hours"
    yield ""
    yield (
        f"Filament and hours are estimates: the volume that is laid down, {100 * (WASTE - 1):.0f} "
        f"% more for brims and supports, and {1e9 * MATERIAL_PER_SECOND:.0f} mm³ a second in "
        f"layers of {LAYER} mm. A printer may need "
        "half or twice that time. What is not solid counts its walls, floor and roof, and "
        f"{100 * SPARSE:.0f} % of the rest."
    )
    yield ""


def _parts(recipe: Recipe) -> Iterator[str]:
    yield "## Parts"
    yield ""
    heading = ("part", "count", "bed", "size (mm)", "up", "colour", "layer (mm)", "walls")
    more = ("infill", "supports", "mass of one (g)", "filament (g)", "hours")
    yield _row(*heading, *more)
    yield _row(*("---" for _ in (*heading, *more)))
    for part in recipe.parts:
        yield _row(
            f"`{part.name}`",
            str(part.count),
            ", ".join(map(str, part.beds)),
            " × ".join(f"{edge:g}" for edge in part.size_mm),
            part.orientation,
            _colour(part),
            f"{part.layer_mm:g}",
            str(part.walls),
            _infill(part),
            part.supports,
            _mass(part.mass_g),
            f"{part.filament_g:.0f}",
            f"{part.hours:.1f}",
        )
    yield ""


def _infill(part: PartRecipe) -> str:
    """Solid parts name the pattern: some slicers refuse 100 % with the one that they begin with."""
    return f"{part.infill_percent} %" + (" rectilinear" if part.infill_percent == SOLID else "")


def _sizes(recipe: Recipe) -> Iterator[str]:
    yield "## To measure with calipers"
    yield ""
    yield _row("part", "what", "mm", "±")
    yield _row("---", "---", "---:", "---:")
    for part in recipe.parts:
        for size in part.dimensions:
            yield _row(f"`{part.name}`", size.what, f"{size.mm:g}", f"{size.tolerance_mm:g}")
    yield ""


def _objects(recipe: Recipe) -> Iterator[str]:
    if not recipe.objects:
        return
    yield "## To weigh, and to fix"
    yield ""
    yield (
        f"What is lifted weighs what it weighs in simulation, ± {100 * TOLERANCE:.0f} %: put it on "
        "a scale. What is too light gets ballast in a drilled hole, what is too heavy less infill."
    )
    yield ""
    yield _row("object", "mass (g)", "fixed to the table")
    yield _row("---", "---", "---")
    for each in recipe.objects:
        yield _row(f"`{each.body}`", _mass(each.mass_g), each.fixing or "no")
    yield ""


def _colour(part: PartRecipe) -> str:
    changes = (f"from {height:g} mm up {colour}" for height, colour in part.colour_changes)
    return ", ".join((part.colour, *changes))


def _mass(grams: tuple[float, float, float] | None) -> str:
    if grams is None:
        return "any"
    least, target, most = grams
    return f"{target:.1f} ({least:.1f} to {most:.1f})"


def _row(*cells: str) -> str:
    return f"| {' | '.join(cells)} |"
