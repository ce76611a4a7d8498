"""`duobench list`: what tasks there are."""

from __future__ import annotations

import re

from duobench.cli.shared.console import console

NARROW = 80
"""Columns of a terminal below which the category stands above the instruction, not beside it."""


def list_tasks(stages: bool = False) -> None:
    """Show every task: id, category, number of stages, horizon in control steps, instruction.

    Args:
        stages: Also name the stages.
    """
    from rich import box
    from rich.table import Table

    from duobench.tasks import catalog

    screen = console()
    is_narrow = screen.width < NARROW
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("Task", no_wrap=True, style="bold")
    if not is_narrow:
        table.add_column("Category")
    table.add_column("Stages", justify="right", no_wrap=True)
    table.add_column("Horizon", justify="right", no_wrap=True)
    table.add_column("Instruction")
    for name in catalog.names():
        task = catalog.get(name)
        told = [re.sub(r"{(\w+)}", r"<\1>", task.instruction)]
        if stages:
            told += [f"{number} {stage.name}" for number, stage in enumerate(task.stages, 1)]
        numbers = (str(task.max_stage), str(task.horizon))
        if is_narrow:
            table.add_row(task.id, *numbers, "\n".join([f"({task.category})", *told]))
        else:
            table.add_row(task.id, task.category, *numbers, "\n".join(told))
    screen.print(table)
