"""What is bought instead of printed, with the sizes of the simulated objects.

The paper names no products. What is bought should come as near to these sizes as can be had: where
it differs, the real task differs from the simulated one by as much.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from duobench.objects import cup, microwave, pot
from duobench.objects.prop import Prop
from duobench.objects.solid import mass_properties, printable
from duobench.tasks.task import Task


@dataclass(frozen=True, kw_only=True, slots=True)
class Item:
    """Something to buy, or to make by other means."""

    name: str
    """What it is called."""
    props: tuple[str, ...] = ()
    """The objects of the task that it stands for; none for screws and the like."""
    count: int = 1
    """How many are needed."""
    sizes: tuple[str, ...] = ()
    """Its sizes, one phrase each."""
    note: str = ""
    """What else matters, in a sentence."""


def items_of(task: Task) -> tuple[Item, ...]:
    """What to buy for a task: nothing for one whose objects are all printed.

    Objects of a task that is not the benchmark's, and not printable, are listed with their sizes.
    """
    if task.id in _ITEMS:
        return _ITEMS[task.id](task)
    return () if task.printable else tuple(_plain(prop) for prop in task.props)


def _plain(prop: Prop) -> Item:
    solids = prop.prints({prop.choice or "": min(prop.variants, default="")})
    names = (prop.name, *(prop.part_name(part.name) for part in prop.parts))
    sizes = tuple(
        f"{name}: {_times(*np.ptp(printable(solid).vertices, axis=0))} mm, "
        f"{1000 * mass_properties(solid).mass:.0f} g"
        for name, solid in zip(names, solids, strict=True)
    )
    return Item(name=prop.name, props=(prop.name,), sizes=sizes)


def _chest(_task: Task) -> tuple[Item, ...]:
    return (
        Item(
            name="M3 × 20 mm screw",
            count=2,
            note="The hinge of the chest: each turns in a lug and cuts its thread into the lid.",
        ),
        Item(
            name="M3 nut",
            count=2,
            note="The paper lists them with the screws; this chest needs none, so they are spare.",
        ),
    )


def _microwave(_task: Task) -> tuple[Item, ...]:
    depth, width, height = microwave.CAVITY
    thickness, door_width, door_height = microwave.DOOR
    angle = math.degrees(microwave.DOOR_LIMITS[1])
    return (
        Item(
            name="microwave oven",
            props=("microwave",),
            sizes=(
                f"housing {_times(microwave.WIDTH, microwave.DEPTH, microwave.HEIGHT)} mm "
                "(width, depth, height)",
                f"cavity {_times(width, depth, height)} mm (width, depth, height)",
                f"cavity floor {_mm(microwave.FLOOR)} mm above the table",
                f"door {_times(door_width, door_height, thickness)} mm (width, height, "
                f"thickness), {microwave.DOOR_MASS:g} kg with its handle",
                f"handle: upright bar of {_mm(2 * microwave.BAR_RADIUS)} mm in diameter, "
                f"{_mm(microwave.BAR_LENGTH)} mm long, its axis "
                f"{_mm(microwave.BAR_STANDOFF)} mm in front of the door and "
                f"{_mm(microwave.BAR_INSET)} mm from the door's free edge",
                f"hinge at its left, opens to {angle:.0f}°",
            ),
            note=f"A spring of {microwave.DOOR_STIFFNESS:g} N·m/rad shuts the door: fit one, or a "
            "rubber band, and take out the latch. It stays unplugged.",
        ),
    )


def _cups(task: Task) -> tuple[Item, ...]:
    names = [prop.name for prop in task.props]
    marbles = tuple(name for name in names if name.startswith("marble"))
    squares = tuple(name for name in names if name.endswith("_square"))
    (square,) = {
        tuple(np.ptp(printable(prop.solid).vertices, axis=0)[:2].tolist())
        for prop in task.props
        if prop.name in squares
    }
    grams = 1000 * cup.GLASS_DENSITY * 4 / 3 * math.pi * cup.MARBLE_RADIUS**3
    return (
        Item(
            name="glass marble, blue",
            props=marbles,
            count=len(marbles),
            sizes=(f"diameter {_mm(2 * cup.MARBLE_RADIUS)} mm", f"{grams:.1f} g"),
        ),
        Item(
            name="square of green film or tape",
            props=squares,
            count=len(squares),
            sizes=(f"{_times(*square)} mm",),
            note="Stuck to the table, flat: a cup must not catch on its edge.",
        ),
    )


def _pot(_task: Task) -> tuple[Item, ...]:
    return (
        Item(
            name="cooking pot with its lid and two rigid loop handles",
            props=("pot",),
            sizes=(
                f"diameter {_mm(2 * pot.RADIUS)} mm, height {_mm(pot.HEIGHT)} mm with its lid",
                f"{pot.MASS:g} kg in all, filled",
                f"handles: bars of {_mm(2 * pot.BAR_RADIUS)} mm in diameter, "
                f"{_mm(pot.BAR_LENGTH)} mm long, their axes {_mm(2 * pot.HANDLE_OFFSET)} mm apart "
                f"and {_mm(pot.HEIGHT / 2 + pot.HANDLE_Z)} mm above the table",
            ),
            note="The lid is taped on. Fill it with sand, not with something hot.",
        ),
        Item(
            name="dark plate in the place of a stove",
            props=("stove",),
            sizes=(f"{_times(*pot.PLATE)} mm",),
            note="Wood or plastic, fixed to the table.",
        ),
    )


def _mm(metres: float) -> str:
    return f"{1000 * metres:.0f}"


def _times(*edges: float) -> str:
    return " × ".join(map(_mm, edges))


_ITEMS: Mapping[str, Callable[[Task], tuple[Item, ...]]] = {
    "hinge_chest": _chest,
    "spring_door": _microwave,
    "pour_marbles": _cups,
    "carry_pot": _pot,
}


def shopping_lines(items: tuple[Item, ...]) -> Iterator[str]:
    """Items as lines of a list in Markdown."""
    for item in items:
        yield f"- {item.count} × {item.name}{f' ({item.note})' if item.note else ''}"
        yield from (f"    - {size}" for size in item.sizes)
