"""`duobench list`: the tasks, or the looks of images."""

from __future__ import annotations

import re

from duobench.cli.shared.console import (
    console,
    numeric,
    say,
    table,
    whole,
)
from duobench.tasks import catalog
from duobench.world.looks.catalog import LOOKS, RANDOM

NARROW = 80
"""Columns of a terminal below which the category stands above the instruction, not beside it."""


def run(stages: bool = False, looks: bool = False) -> None:
    """Show every task: id, category, number of stages, horizon in control steps, instruction.

    Args:
        stages: Also name the stages.
        looks: Show the looks of images instead, with what differs in each from the default.
    """
    if looks:
        rows = table(whole("Look", style="bold"), "What differs")
        for name, look in LOOKS.items():
            rows.add_row(name, ", ".join(look.to_json()).replace("_", " "))
        rows.add_row(
            f"{RANDOM}SEED", f"everything, sampled from a seed, such as {RANDOM}7"
        )
        say(rows)
        return
    screen = console()
    is_narrow = screen.width < NARROW
    rows = table(
        whole("Task", style="bold"),
        *([] if is_narrow else ["Category"]),
        *numeric("Stages", "Horizon"),
        "Instruction",
    )
    for name in catalog.names():
        task = catalog.get(name)
        lines = [re.sub(r"{(\w+)}", r"<\1>", task.instruction)]
        if stages:
            lines += [
                f"{number} {stage.name}" for number, stage in enumerate(task.stages, 1)
            ]
        numbers = (str(task.max_stage), str(task.horizon))
        if is_narrow:
            rows.add_row(task.id, *numbers, "\n".join([f"({task.category})", *lines]))
        else:
            rows.add_row(task.id, task.category, *numbers, "\n".join(lines))
    screen.print(rows)
