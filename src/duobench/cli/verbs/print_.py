"""`duobench print`: files and recipes to print the objects of a task with."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import tyro

from duobench.cli.shared.console import console

if TYPE_CHECKING:
    from duobench.errors import DuoBenchError
    from duobench.fabrication import Recipe
    from duobench.sim.layout import Layout
    from duobench.tasks.task import Task

ALL = "all"
"""In the place of a task: every one of the benchmark."""


def print_(
    task: tyro.conf.Positional[str],
    out: Path = Path("prints"),
    variants: tuple[str, ...] = (),
    seed: int | None = None,
    paper: Literal["a4", "a3"] = "a4",
) -> None:
    """Write what is needed to print a task's objects: STL, 3MF, recipes, layout sheet, coupon.

    The same command in the same folder writes the same files again.

    Args:
        task: Id of a task (see: duobench list) or module:ATTRIBUTE; all for every task.
        out: Folder of the files: a new one, or that of the same command.
        variants: Which variants of objects that have some, such as numbers of mazes; all for all
            of them. By default those of the seed's layout, or the first ones.
        seed: Seed of the layout on the sheets; without one, everything is in the middle of where
            it may be.
        paper: Size of the sheets.
    """
    from duobench.cli.shared.advice import advising
    from duobench.fabrication import Paper, write_prints
    from duobench.results.suite import find_tasks
    from duobench.tasks import catalog

    infos = find_tasks(() if task == ALL else (task,))
    tasks = [catalog.get(info.reference) for info in infos]
    layouts = None if seed is None else {each.id: _layout(each, seed) for each in tasks}
    screen = console()

    def tell(recipe: Recipe) -> None:
        parts = sum(part.count for part in recipe.parts)
        screen.print(
            f"{out / recipe.id}: {parts} parts, {recipe.filament_g:.0f} g, {recipe.hours:.1f} h"
            if parts
            else f"{out / recipe.id}: nothing is printed"
        )

    with advising(_advice):
        write_prints(
            out,
            tasks,
            variants=variants,
            layouts=layouts,
            seed=seed,
            paper=Paper(paper),
            progress=tell,
        )
    screen.print(f"Begin with {out / 'README.md'}; {out / 'shopping.md'} lists what is bought.")


def _layout(task: Task, seed: int) -> Layout:
    """The layout that a seed gives, tried on the simulated objects."""
    from duobench.envs import RandomizedReset
    from duobench.envs.config import checked_seed
    from duobench.envs.sim_env import SimEnv

    checked_seed(seed)
    env = SimEnv(task)
    RandomizedReset(env).reset(seed=seed)
    return env.layout


def _advice(error: DuoBenchError) -> str | None:
    from duobench.errors import LockedError, OtherRunError

    match error:
        case OtherRunError() | LockedError():
            return "Give --out another folder."
    return None
