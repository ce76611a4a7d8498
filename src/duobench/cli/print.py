"""`duobench print`: files to print the objects of a task with."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from duobench.cli.shared.advice import OTHER_OUT, AdvisedError, advising
from duobench.cli.shared.console import say
from duobench.cli.shared.resets import reset_env, sample_layouts
from duobench.core.files import taken_back
from duobench.core.randomness import episode_seed
from duobench.core.sheets import Paper
from duobench.results.suite import find_tasks
from duobench.tasks import catalog

if TYPE_CHECKING:
    from duobench.printing import Recipe


ALL = "all"
"""Word in place of a task: all tasks of the benchmark."""
JIG = "jig"
"""Word in place of a task: the jig instead of a task."""


def run(
    task: tyro.conf.Positional[str],
    out: Path = Path("prints"),
    variants: tuple[str, ...] = (),
    trials: int = 0,
    seed: int | None = None,
    paper: Paper = Paper.A4,
    foot: tuple[float, float] | None = None,
) -> None:
    """Write what is needed to print a task's objects: STL, 3MF, recipes, layout sheet.

    The same command in the same folder writes the same files again.

    Args:
        task: Id of a task (see: duobench list) or module:ATTRIBUTE; all for every task; jig for
            the jig alone from which objects are placed.
        out: Folder of the files: a new one, or that of the same command.
        variants: Which variants of objects that have some, such as numbers of mazes; all for all
            of them. By default those of the trials, of the seed's layout, or the first ones.
        trials: Number of trials a policy of duobench real eval, whose first layouts decide the
            variants: 15 gives the mazes of the paper's 15 trials.
        seed: Seed of the layout on the sheets; without one, everything is in the middle of where
            it may be.
        paper: Size of the sheets.
        foot: Front edge and width in mm of the foot of your mount, and the jig for it is written
            too; see the page real_setup. By default that of the simulated mount.
    """
    from duobench.printing import Foot, write_prints

    if trials < 0 or (trials and variants):
        raise AdvisedError("--trials is a number from 1 on, without --variants.")
    of = Foot() if task == JIG and foot is None else None
    if foot is not None:
        of = Foot(front=foot[0] / 1000, width=foot[1] / 1000)
    infos = [] if task == JIG else find_tasks(() if task == ALL else (task,))
    tasks = [catalog.get(info.reference) for info in infos]
    layouts = (
        None
        if seed is None
        else {each.id: reset_env(each, seed).layout for each in tasks}
    )

    episodes = {
        each.id: sample_layouts(
            each, (episode_seed(each.id, index) for index in range(trials))
        )
        for each in tasks
        if trials and any(prop.choice for prop in each.props)
    }

    def tell(recipe: Recipe) -> None:
        parts = sum(part.count for part in recipe.parts)
        say(f"{out / recipe.id}: {f'{parts} parts' if parts else 'nothing is printed'}")

    with advising(OTHER_OUT), taken_back(out):
        write_prints(
            out,
            tasks,
            variants=variants,
            layouts=layouts,
            seed=seed,
            episodes=episodes,
            paper=paper,
            foot=of,
            progress=tell,
        )
    say(f"Begin with {out / 'README.md'}.")
