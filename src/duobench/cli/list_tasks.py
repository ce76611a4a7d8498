"""`duobench list`: what tasks there are."""

from __future__ import annotations

import re

from duobench.cli.console import console
from duobench.cli.engine import load_engine


def list_tasks(stages: bool = False) -> None:
    """Show every task: id, category, number of stages, horizon in control steps, instruction.

    Args:
        stages: Also name the stages.
    """
    load_engine()
    from rich import box
    from rich.table import Table

    from duobench.tasks import catalog

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("Task", no_wrap=True, style="bold")
    table.add_column("Category", overflow="fold")
    table.add_column("Stages", justify="right", no_wrap=True)
    table.add_column("Horizon", justify="right", no_wrap=True)
    table.add_column("Instruction", overflow="fold")
    for name in catalog.names():
        task = catalog.get(name)
        told = [re.sub(r"{(\w+)}", r"<\1>", task.instruction)]
        if stages:
            told += [f"{number} {stage.name}" for number, stage in enumerate(task.stages, 1)]
        table.add_row(
            task.id, task.category, str(task.max_stage), str(task.horizon), "\n".join(told)
        )
    console().print(table)
