"""A folder with everything that printing needs: the same choice gives the same bytes."""

import re
from collections.abc import (
    Callable,
    Iterator,
    Mapping,
    Sequence,
)
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from duobench.core import pages
from duobench.core.errors import FabricationError, check_known
from duobench.core.files import (
    begin_or_continue,
    differences,
    encode,
    locked,
    remove_temporary,
    write,
)
from duobench.core.sheets import Paper
from duobench.core.versions import __version__
from duobench.printing.details import lines_of
from duobench.printing.formats import stl_bytes, threemf_bytes
from duobench.printing.jig import ID as JIG, Foot, placing_jig
from duobench.printing.parts import ALL_VARIANTS, PrintJob, job_of
from duobench.printing.recipe import (
    RECIPE_SCHEMA,
    UNTRIED,
    Recipe,
    recipe_of,
    recipe_page,
    spools,
    total_filament,
)
from duobench.printing.sheet import as_counted, layout_sheet, neutral_layout
from duobench.tasks.task import Task
from duobench.world.sim.layout import Layout

_NAME = re.compile(r"\w[\w.-]*")
DESCRIPTION = "print.json"
"""File of a folder that says what it holds."""
FOLDER_SCHEMA = 1


@dataclass(frozen=True, kw_only=True, slots=True)
class PrintChoice:
    """Choice of the content of a folder of prints."""

    tasks: list[str]
    variants: list[str]
    """Variants of their objects; empty for the first one, or for those of the seed's layout."""
    seed: int | None
    """Seed of the layout on the sheets; None for the neutral one."""
    paper: str
    trials: int = 0
    """Number of first episodes of an evaluation that decide the variants; 0 for none."""
    foot_mm: tuple[float, float] | None = None
    """Front edge and width of the mount's foot that the jig is for; None without a jig."""
    version: str = __version__

    def differences(self, other: Self) -> list[str]:
        """Differences from another folder, one phrase each."""
        now, before = (
            {
                "tasks": ", ".join(each.tasks) or "none",
                "variants": ", ".join(each.variants) or "by default",
                "seed": "none" if each.seed is None else each.seed,
                "trials": each.trials or "none",
                "paper": each.paper,
                "foot": each.foot_mm or "none",
                "version": each.version,
            }
            for each in (self, other)
        )
        return differences(now, before)


def write_prints(  # noqa: PLR0913 - everything that can be chosen
    folder: Path,
    tasks: Sequence[Task],
    *,
    variants: Sequence[str] = (),
    layouts: Mapping[str, Layout] | None = None,
    seed: int | None = None,
    episodes: Mapping[str, Sequence[Layout]] | None = None,
    paper: Paper = Paper.A4,
    foot: Foot | None = None,
    progress: Callable[[Recipe], None] = lambda _recipe: None,
) -> None:
    """Write everything that is needed to print the objects of tasks, and a jig.

    Args:
        folder: A new folder, or one that holds what the same choice gave.
        tasks: The tasks.
        variants: Which variants of objects that have some, see `parts.job_of`; by default those of
            the layouts, and without them the first ones.
        layouts: What is on the layout sheets, by the task's id; neutral layouts by default.
        seed: The seed that the layouts come from, for the title of the sheets.
        episodes: Layouts of the first episodes of an evaluation, by the task's id, which decide the
            variants.
        paper: What the sheets are printed on.
        foot: The foot of the mount that the jig is for; without one there is no jig.
        progress: Called with each recipe once its folder is written, that of the jig first.

    Raises:
        UnknownNameError: No object of the tasks has such a variant.
        FabricationError: A part does not fit a printer, two tasks have one name, or a name is no
            name of a folder.
        OtherRunError: The folder holds something else.
        OutputError: It cannot be written, or another process is writing into it.
    """
    ids = [task.id for task in tasks]
    _check_names(ids)
    choices = {
        name for task in tasks for p in task.props if p.choice for name in p.variants
    }
    for name in variants:
        check_known("variant", name, {*choices, ALL_VARIANTS})
    layouts, episodes = layouts or {}, episodes or {}
    trials = max(map(len, episodes.values()), default=0)
    jobs = [
        job_of(
            task,
            variants
            or _variants(task, episodes.get(task.id, ()))
            or _variants(task, [layouts[task.id]] if task.id in layouts else ()),
        )
        for task in tasks
    ]
    title = "neutral layout" if seed is None else f"layout of seed {seed}"
    choice = PrintChoice(
        tasks=ids,
        variants=list(variants),
        seed=seed,
        trials=trials,
        paper=paper.value,
        foot_mm=foot and (1000 * foot.front, 1000 * foot.width),
    )
    first = (placing_jig(foot),) if foot else ()
    with locked(folder):
        begin_or_continue(
            folder, folder / DESCRIPTION, choice, FOLDER_SCHEMA, what="print"
        )
        remove_temporary(folder)
        recipes = []
        for job, task in zip(
            (*first, *jobs), (*(None for _ in first), *tasks), strict=True
        ):
            recipes.append(_write_job(folder / job.id, job))
            if task is not None:
                layout = layouts.get(task.id) or neutral_layout(task)
                write(
                    folder / task.id / "layout.pdf",
                    layout_sheet(task, layout, title, paper),
                )
            progress(recipes[-1])
        overview = pages.render(
            "duobench.printing",
            "prints.md.j2",
            recipes=recipes,
            untried=UNTRIED,
            trials=trials,
            asked=list(_asked(tasks, episodes)),
            filament=total_filament(recipes),
            spools=spools,
            lines=lines_of,
        )
        write(folder / "README.md", overview)


def _check_names(ids: list[str]) -> None:
    taken = sorted({name for name in ids if ids.count(name) > 1 or name == JIG})
    if taken:
        raise FabricationError(
            f"Each folder needs a name of its own, got twice: {taken}."
        )
    odd = [name for name in ids if not _NAME.fullmatch(name)]
    if odd:
        raise FabricationError(
            f"{odd[0]!r} cannot be the name of a folder; a task's id has letters, digits and _."
        )


def _variants(task: Task, layouts: Sequence[Layout]) -> list[str]:
    """Variants that layouts ask for, each once."""
    asked = dict.fromkeys(
        layout.variants[prop.choice]
        for prop in task.props
        if prop.choice is not None
        for layout in layouts
    )
    return list(asked)


def _asked(
    tasks: Sequence[Task], episodes: Mapping[str, Sequence[Layout]]
) -> Iterator[tuple[str, str, list[int]]]:
    """Yield the variants that episodes ask for: object, variant, and numbers of episodes."""
    for task in tasks:
        layouts = episodes.get(task.id, ())
        for prop in task.props:
            values = (
                [] if prop.choice is None else sorted(prop.variants, key=as_counted)
            )
            for value in values:
                numbers = [
                    number
                    for number, layout in enumerate(layouts)
                    if layout.variants[prop.choice or ""] == value
                ]
                if numbers:
                    yield f"{task.id}: {prop.name}", value, numbers


def _write_job(folder: Path, job: PrintJob) -> Recipe:
    recipe = recipe_of(job)
    for part in job.parts:
        write(folder / f"{part.name}.stl", stl_bytes(part.mesh, part.name))
    if recipe.file is not None:
        write(folder / recipe.file, threemf_bytes(job))
    write(folder / "recipe.json", encode(recipe, RECIPE_SCHEMA))
    write(folder / "recipe.md", recipe_page(recipe))
    return recipe
