"""The page on the printed parts of every task, from the recipes."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from duobench.printing import Foot, PrintJob, fit_coupon, job_of, placing_jig, recipe_of
from duobench.printing.details import shopping_lines
from duobench.tasks import catalog

PAGE = "printing_parts.md"
FOLDER = "printing"
"""Where the pictures are, beside the page."""
DRAWN = "drawn.json"
"""Beside the pictures: what they were drawn from."""
COUPON, JIG = "coupon", "jig"
JOBS = (COUPON, JIG, *catalog.names())
INTRODUCTION = """# The printed parts of every task

Written and rendered by `make docs`: the parts as they lie on the printer's bed, and, where some of
them go together, how they do. `duobench print TASK` writes the files of a task with the whole
recipe: sizes to measure, masses, supports, layers. [Printing](printing.md) says why the objects are
as they are.

Nothing of this was printed by us so far; a slicer, PrusaSlicer, takes all parts in tests. Grams
and hours are estimated from the volume.
"""


@cache
def job(name: str) -> PrintJob:
    """Return what is printed of a task, of the first maze; or the coupon, or the jig."""
    if name == COUPON:
        return fit_coupon()
    return placing_jig(Foot()) if name == JIG else job_of(catalog.get(name))


def together_file(name: str) -> str:
    """Return the name of the picture of parts that go together."""
    return f"{name}_together.jpg"


def digest(what: PrintJob) -> str:
    """Return a hash of what the pictures of a job show, the same on every machine."""
    total = hashlib.sha256()
    for part in what.parts:
        points = {tuple(point) for point in (part.mesh.vertices.round(7) + 0.0).tolist()}
        total.update(f"{part.name} {part.rgba} {part.count} {sorted(points)}\n".encode())
    return total.hexdigest()


def page(pictures: Path) -> str:
    """Return the page in Markdown, with the pictures that there are in a folder."""
    sections = ["\n".join(section(name, pictures)) for name in JOBS]
    return "\n\n".join([INTRODUCTION.rstrip(), *sections]) + "\n"


def section(name: str, pictures: Path) -> Iterator[str]:
    """Give the lines about one of the jobs."""
    recipe = recipe_of(job(name))
    yield f"## {recipe.title}"
    yield ""
    yield f"`duobench print {recipe.id}`" if recipe.id != COUPON else "Part of every folder."
    for file, words in (
        (f"{recipe.id}.jpg", f"The parts of {recipe.title} on the bed"),
        (together_file(recipe.id), f"How the parts of {recipe.title} go together"),
    ):
        if (pictures / file).exists():
            yield from ("", f"![{words}]({FOLDER}/{file})")
    if recipe.parts:
        yield ""
        yield "| part | count | size (mm) | up | infill | mass of one (g) | hours |"
        yield "| --- | ---: | --- | --- | --- | ---: | ---: |"
        for part in recipe.parts:
            mass = "any" if part.mass_g is None else f"{part.mass_g[1]:.0f}"
            size = " × ".join(f"{edge:.0f}" for edge in part.size_mm)
            yield (
                f"| `{part.name}` | {part.count} | {size} | {part.orientation} | "
                f"{part.infill_percent} %, {part.infill_pattern} | {mass} | {part.hours:.1f} |"
            )
        yield ""
        yield f"About {recipe.filament_g:.0f} g of filament and {recipe.hours:.1f} hours."
    else:
        yield from ("", "Nothing of this task is printed.")
    for title, lines in (
        ("Put together:", [f"{n}. {line}" for n, line in enumerate(recipe.assembly, 1)]),
        ("Bought:", list(shopping_lines(recipe.bought))),
        ("Notes:", [f"- {line}" for line in recipe.notes]),
    ):
        if lines:
            yield from ("", title, "", *lines)
