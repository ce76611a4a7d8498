"""What there is of tasks: `duobench list`, `render`, `view` and `print`."""

from __future__ import annotations

import re
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from duobench.cli.shared.advice import OTHER_OUT, advising
from duobench.cli.shared.console import console, numeric, say, table, whole
from duobench.cli.shared.page import PageOptions
from duobench.cli.shared.process import load_engine, stopping
from duobench.core.files import make_folder, taken_back, writing
from duobench.core.sheets import Paper
from duobench.core.types import POLICY_CAMERAS
from duobench.envs.config import checked_seed
from duobench.results.folder import RunFolder
from duobench.results.suite import find_tasks
from duobench.tasks import catalog
from duobench.tasks.task import Task
from duobench.world.looks.catalog import DEFAULT, LOOKS, RANDOM
from duobench.world.robot.cameras import OVERVIEW

if TYPE_CHECKING:
    from duobench.envs.sim_env import SimEnv
    from duobench.printing import Recipe


NARROW = 80
"""Columns of a terminal below which the category stands above the instruction, not beside it."""


def list_tasks(stages: bool = False, looks: bool = False) -> None:
    """Show every task: id, category, number of stages, horizon in control steps, instruction.

    Args:
        stages: Also name the stages.
        looks: Show the looks of images instead, with what differs in each from the default.
    """
    if looks:
        rows = table(whole("Look", style="bold"), "What differs")
        for name, look in LOOKS.items():
            rows.add_row(name, ", ".join(look.to_json()).replace("_", " "))
        rows.add_row(f"{RANDOM}SEED", f"everything, sampled from a seed, such as {RANDOM}7")
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
        told = [re.sub(r"{(\w+)}", r"<\1>", task.instruction)]
        if stages:
            told += [f"{number} {stage.name}" for number, stage in enumerate(task.stages, 1)]
        numbers = (str(task.max_stage), str(task.horizon))
        if is_narrow:
            rows.add_row(task.id, *numbers, "\n".join([f"({task.category})", *told]))
        else:
            rows.add_row(task.id, task.category, *numbers, "\n".join(told))
    screen.print(rows)


SAMPLES = 16
"""Images averaged into the one for people; what policies see has one."""


def render(
    task: tyro.conf.Positional[str],
    seed: int = 0,
    size: tuple[int, int] = (720, 1280),
    look: str = "default",
    out: Path = Path("renders"),
) -> None:
    """Render a reset of a task from every camera, as PNG files.

    Args:
        task: Id of a task (see: duobench list) or module:ATTRIBUTE.
        seed: Seed of the reset.
        size: Height and width of the images in pixels.
        look: Look of the images: wood_table, dark, random:7, ... (see duobench docs looks).
        out: Folder of the images.
    """
    load_engine()
    from PIL import Image

    from duobench.world.sim.rendering import Renderer

    (info,) = find_tasks([task])
    height, width = size
    base = _reset(catalog.get(info.reference), seed, look)
    simulation = base.simulation
    images = {}
    with taken_back(out):
        make_folder(out)
        for cameras, samples in ((POLICY_CAMERAS, 1), ((OVERVIEW,), SAMPLES)):
            with Renderer(
                simulation.model, height=height, width=width, samples=samples, look=base.look
            ) as renderer:
                images |= renderer.render_all(simulation.data, cameras)
        for camera, image in images.items():
            path = out / f"{info.id}-{seed}-{camera}.png"
            with writing(path):
                Image.fromarray(image).save(path)
            say(str(path))


_PAGE = PageOptions()


def view(
    what: tyro.conf.Positional[str],
    tasks: tuple[str, ...] = (),
    page: tyro.conf.OmitArgPrefixes[PageOptions] = _PAGE,
    look: str = "default",
    import_tasks: bool = False,
    follow: bool = False,
) -> None:
    """Show a task, a data set or a run on a page in the browser, until Ctrl-C.

    A task is shown as its resets leave it. Recorded episodes are shown as their states were;
    episodes of a run are played again from the joint targets in their records. Everybody who has
    the page open sees the same, and may choose.

    Args:
        what: Id of a task (see: duobench list) or module:ATTRIBUTE, the folder of a data set or of
            a run, or a file that duobench bundle has written.
        tasks: Only the episodes of these tasks; of all if none is named.
        page: Where the page is served.
        look: Look of the scene, without textures: wood_table, dark, random:7, ... (see
            duobench docs looks).
        import_tasks: Import tasks of episodes that are not of the benchmark, which runs the code of
            the modules that the data set or the run names.
        follow: Follow a run that is going on, or is going to be started: successes so far, the
            time that is left, and every finished episode; at its end the page shows the report.
    """
    load_engine()
    from duobench.evaluation.replay.sources import FollowedRun, open_view
    from duobench.evaluation.replay.viewer import Viewer

    source = None if follow else open_view(what, look, tasks, import_tasks=import_tasks)
    with closing(page.serve()) as server:
        run = None
        if source is None:
            folder = RunFolder(Path(what))
            source = run = FollowedRun(folder, server, look, tasks, import_tasks=import_tasks)
        viewer = Viewer(source, server, run and run.refresh)
        with stopping(viewer.stop):
            say(f"Open {server.url}\nCtrl-C ends it.")
            viewer.run()
        if run is not None:
            run.wait_for_visitors()


ALL = "all"
"""In the place of a task: every one of the benchmark."""
JIG = "jig"
"""In the place of a task: none, but the jig."""


def print_(
    task: tyro.conf.Positional[str],
    out: Path = Path("prints"),
    variants: tuple[str, ...] = (),
    seed: int | None = None,
    paper: Paper = Paper.A4,
    foot: tuple[float, float] | None = None,
) -> None:
    """Write what is needed to print a task's objects: STL, 3MF, recipes, layout sheet, coupon.

    The same command in the same folder writes the same files again.

    Args:
        task: Id of a task (see: duobench list) or module:ATTRIBUTE; all for every task; jig for
            the jig alone from which objects are placed.
        out: Folder of the files: a new one, or that of the same command.
        variants: Which variants of objects that have some, such as numbers of mazes; all for all
            of them. By default those of the seed's layout, or the first ones.
        seed: Seed of the layout on the sheets; without one, everything is in the middle of where
            it may be.
        paper: Size of the sheets.
        foot: Front edge and width in mm of the foot of your mount, and the jig for it is written
            too; see duobench docs real_setup. By default that of the simulated mount.
    """
    from duobench.printing import Foot, write_prints

    of = Foot() if task == JIG and foot is None else None
    if foot is not None:
        of = Foot(front=foot[0] / 1000, width=foot[1] / 1000)
    infos = [] if task == JIG else find_tasks(() if task == ALL else (task,))
    tasks = [catalog.get(info.reference) for info in infos]
    layouts = None if seed is None else {each.id: _reset(each, seed).layout for each in tasks}

    def tell(recipe: Recipe) -> None:
        parts = sum(part.count for part in recipe.parts)
        say(
            f"{out / recipe.id}: {parts} parts, {recipe.filament_g:.0f} g, {recipe.hours:.1f} h"
            if parts
            else f"{out / recipe.id}: nothing is printed"
        )

    with advising(OTHER_OUT), taken_back(out):
        write_prints(
            out,
            tasks,
            variants=variants,
            layouts=layouts,
            seed=seed,
            paper=paper,
            foot=of,
            progress=tell,
        )
    say(f"Begin with {out / 'README.md'}; {out / 'shopping.md'} lists what is bought.")


def _reset(task: Task, seed: int, look: str = DEFAULT) -> SimEnv:
    """An environment with the layout that a seed gives, tried on the simulated objects."""
    from duobench.envs import RandomizedReset
    from duobench.envs.sim_env import SimEnv

    checked_seed(seed)
    env = SimEnv(task, look=look)
    env.make_judge()  # an error where a stage names what is not there
    RandomizedReset(env).reset(seed=seed)
    return env
