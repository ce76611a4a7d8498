"""Write the tables that follow from the tasks: in README.md and in docs/object_states.md.

Part of `make docs`.
"""

import math
from collections.abc import Iterator
from pathlib import Path

from duobench.objects.prop import Prop
from duobench.objects.shapes import CIRCLE_SEGMENTS
from duobench.objects.solid import manifold_from, placed, printable
from duobench.spatial import SE3
from duobench.tasks import catalog
from duobench.tasks.task import Task

README = Path(__file__).parents[1] / "README.md"
OBJECT_STATES = Path(__file__).parent / "object_states.md"
BEGIN = "<!-- tasks: written by make docs -->\n"
END = "<!-- end of tasks -->\n"
LISTED = 6
"""Numbers that are named one by one; of more, the first and the last are."""
TURNS = {
    CIRCLE_SEGMENTS: "any turn",
    8: "eighth turns",
    6: "sixth turns",
    4: "quarter turns",
    3: "third turns",
    2: "half turns",
}
"""Turns that may lead to the same shape, by how many of them there are."""
SAME = 1e-3
"""Share of its volume by which a turned shape may differ: what print joints and facets make up."""


def table() -> str:
    """Return the tasks as a table in Markdown."""
    rows = ["| task | category | stages | horizon |", "| --- | --- | --- | --- |"]
    for task in map(catalog.get, catalog.names()):
        rows.append(f"| `{task.id}` | {task.category} | {task.max_stage} | {task.horizon} |")
    return "\n".join(rows) + "\n"


def object_states() -> str:
    """Return the order of the numbers of every task's object state as a table in Markdown."""
    heading = "| task | numbers | places | names | looks the same after |"
    rows = [heading, "| --- | ---: | --- | --- | --- |"]
    for task in map(catalog.get, catalog.names()):
        begin = f"`{task.id}` | {len(task.object_state.names)}"
        for cells in _parts(task):
            rows.append(f"| {begin} | {cells} |")
            begin = " | "
    return "\n".join(rows) + "\n"


def _parts(task: Task) -> Iterator[str]:
    """Where the numbers are, counted from 0, what they are called, and an object's symmetry."""
    turned = {f"{prop.name}_z_axis_z": prop for prop in task.props}
    first = 0
    for part in task.object_state.parts:
        last = first + len(part.names) - 1
        names = [f"`{name}`" for name in part.names]
        if len(names) > LISTED:
            names = [names[0], "…", names[-1]]
        places = f"{first}" if first == last else f"{first}–{last}"
        prop = turned.get(part.names[-1])
        yield f"{places} | {' '.join(names)} | {_symmetry(prop) if prop else ''}"
        first = last + 1


def _symmetry(prop: Prop) -> str:
    """Turns about an object's axes after which it is where it was; of one of its variants."""
    root, *others = prop.prints({prop.choice or "": min(prop.variants, default="")})
    whole = manifold_from(printable(root))
    for part, solid in zip(prop.parts, others, strict=True):
        whole += placed(manifold_from(printable(solid)), part.pose)
    found: dict[str, list[str]] = {}
    for name, axis in zip("xyz", ((1, 0, 0), (0, 1, 0), (0, 0, 1)), strict=True):
        for count, words in TURNS.items():
            turned = placed(whole, SE3.about(axis, 2 * math.pi / count))
            if (whole - turned).volume() < SAME * whole.volume():
                found.setdefault(words, []).append(name)
                break
    return ", ".join(f"{words} about {' '.join(axes)}" for words, axes in found.items()) or "none"


def with_table(page: str, written: str) -> str:
    """Return a page with the table between its marks brought up to date."""
    before, rest = page.split(BEGIN)
    _, after = rest.split(END)
    return f"{before}{BEGIN}\n{written}\n{END}{after}"


TABLES = {README: table, OBJECT_STATES: object_states}
"""What is written into which page."""

if __name__ == "__main__":
    for path, make in TABLES.items():
        path.write_text(with_table(path.read_text(encoding="utf-8"), make()), encoding="utf-8")
