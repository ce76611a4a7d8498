"""Draw the gallery: how every task begins, and its expert as it reaches stage after stage.

`make docs` draws all tasks, writes gallery.md, and puts one picture of each task into tasks.jpg.
`python docs/gallery.py transfer_cube --out pictures` draws some tasks into another folder. The
seeds are fixed, so the same version of everything draws the same pictures.
"""

from __future__ import annotations

import argparse
import re
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from inspect import cleandoc
from itertools import groupby
from pathlib import Path
from types import MappingProxyType

import gymnasium as gym
import mujoco
import numpy as np
from PIL import Image, ImageDraw, ImageFont

import duobench
from duobench.cli.console import console
from duobench.errors import DuoBenchError
from duobench.evaluation.loop import Info, Observation, Step, rollout
from duobench.evaluation.policies import ExpertPolicy
from duobench.scene.cameras import OVERVIEW, OVERVIEW_VIEW, POLICY_CAMERAS, View, looking
from duobench.scene.compose import CONTROL_HZ
from duobench.sim.rendering import Renderer
from duobench.sim.simulation import Simulation
from duobench.tasks import catalog
from duobench.tasks.task import Task

DOCS = Path(__file__).parent
PAGE = "gallery.md"
FOLDER = "gallery"
"""Where the pictures of the page are, beside it."""
COVER = "tasks.jpg"
"""The picture of all tasks, beside the page."""

START_SIZE = (540, 960)
CAMERA_SIZE = (180, 320)
STAGE_SIZE = (480, 640)
"""Height and width in pixels: the start, what a policy's camera shows of it, a stage."""
SAMPLES = 16
QUALITY = 82
COVER_WIDTH = 1440
COVER_QUALITY = 85
COLUMNS = 3
"""Pictures in a row of the page."""

CLOSE_UP = View(eye=(1.45, -0.72, 0.72), target=(0.47, 0.0, 0.08), fovy_deg=32.0)


@dataclass(frozen=True, kw_only=True, slots=True)
class Shot:
    """How the episode of a task is pictured."""

    seed: int = 0
    """Of the reset."""
    view: View = CLOSE_UP
    """Where stages are seen from."""
    best: int = 1
    """The stage that stands for the task in the picture of all tasks."""


SHOTS: Mapping[str, Shot] = MappingProxyType(
    {
        "hinge_chest": Shot(
            view=View(eye=(1.0, 0.75, 0.85), target=(0.50, -0.07, 0.11), fovy_deg=30.0), best=2
        ),
        "spring_door": Shot(
            # The door opens towards the robot: only from beside it can one see both sides of it.
            view=View(eye=(0.32, -1.48, 0.8), target=(0.46, -0.08, 0.17), fovy_deg=31.0),
            best=2,
        ),
        "pour_marbles": Shot(
            view=View(eye=(1.4, -0.12, 0.85), target=(0.44, 0.0, 0.14), fovy_deg=31.0), best=4
        ),
        "ball_maze": Shot(
            view=View(eye=(1.1, 0.6, 1.0), target=(0.5, 0.02, 0.10), fovy_deg=26.0), best=3
        ),
        "carry_pot": Shot(
            view=View(eye=(1.4, -0.6, 0.8), target=(0.45, 0.06, 0.12), fovy_deg=32.0), best=2
        ),
        "block_balance": Shot(
            view=View(eye=(1.3, -0.38, 0.62), target=(0.48, 0.0, 0.11), fovy_deg=28.0), best=4
        ),
        "join_blocks": Shot(
            view=View(eye=(1.0, 0.85, 0.6), target=(0.53, 0.0, 0.10), fovy_deg=26.0), best=2
        ),
        "transfer_cube": Shot(
            view=View(eye=(1.4, -0.6, 0.75), target=(0.42, 0.0, 0.20), fovy_deg=32.0), best=2
        ),
        "transfer_gate": Shot(
            view=View(eye=(1.5, -0.75, 0.75), target=(0.40, 0.0, 0.23), fovy_deg=34.0), best=2
        ),
        "transfer_reorient": Shot(
            view=View(eye=(1.35, -0.5, 0.78), target=(0.43, 0.04, 0.17), fovy_deg=32.0), best=2
        ),
        "bin_sort": Shot(
            view=View(eye=(1.55, -0.25, 0.95), target=(0.43, 0.0, 0.12), fovy_deg=34.0), best=4
        ),
    }
)
"""What differs from one task to the next."""


class Photographer:
    """Pictures one episode: its start from every camera, and the step that reaches each stage."""

    def __init__(self, simulation: Simulation, task: Task, folder: Path) -> None:
        """Remember what to draw.

        Args:
            simulation: That of the episode.
            task: The task.
            folder: Where the task's pictures go.
        """
        self._simulation = simulation
        self._task = task
        self._folder = folder
        self._view = SHOTS.get(task.id, Shot()).view
        self._stage = 0

    def on_episode_start(self, env: gym.Env, observation: Observation, info: Info) -> None:  # noqa: ARG002 - the protocol's signature
        """Draw the start, and move the overview camera to where stages are seen from."""
        aim(self._simulation, OVERVIEW_VIEW)
        self._draw((OVERVIEW,), START_SIZE, SAMPLES)
        self._draw(POLICY_CAMERAS, CAMERA_SIZE, 1)
        aim(self._simulation, self._view)

    def on_step(self, step: Step) -> None:
        """Draw a step that reaches a stage; one that is skipped has no picture of its own."""
        stage = step.info["stage"]
        if stage > self._stage:
            self._stage = stage
            self._draw((OVERVIEW,), STAGE_SIZE, SAMPLES, stage_file(stage))

    def on_episode_end(self) -> None:
        """See whether the last stage was drawn.

        Raises:
            DuoBenchError: The expert failed.
        """
        if self._stage < self._task.max_stage:
            raise DuoBenchError(
                f"The expert of {self._task.id!r} ended at stage {self._stage} of "
                f"{self._task.max_stage}; choose an episode that it solves, by a seed in SHOTS."
            )

    def _draw(
        self, cameras: Sequence[str], size: tuple[int, int], samples: int, name: str | None = None
    ) -> None:
        model, data = self._simulation.model, self._simulation.data
        with Renderer(model, height=size[0], width=size[1], samples=samples) as renderer:
            for camera, picture in renderer.render_all(data, cameras).items():
                path = self._folder / (name or camera_file(camera))
                Image.fromarray(picture).save(path, quality=QUALITY, optimize=True)


def aim(simulation: Simulation, view: View) -> None:
    """Put the camera for people somewhere else."""
    eye = np.array(view.eye)
    pose = looking(eye, np.array(view.target) - eye, np.array([0.0, 0.0, 1.0]))
    camera = simulation.model.camera(OVERVIEW)
    camera.pos[:], camera.quat[:], camera.fovy[:] = pose.translation, pose.wxyz, view.fovy_deg
    mujoco.mj_camlight(simulation.model, simulation.data)


def camera_file(camera: str) -> str:
    """Return the name of the picture of the start from a camera."""
    return f"{camera}.jpg"


def stage_file(stage: int) -> str:
    """Return the name of the picture of a stage."""
    return f"stage_{stage}.jpg"


def draw(name: str, folder: Path) -> None:
    """Draw the pictures of one task into a folder of its name.

    Args:
        name: Id of a task of the catalog.
        folder: Where the task's folder will be.

    Raises:
        DuoBenchError: The expert fails in this episode.
    """
    own = folder / name
    shutil.rmtree(own, ignore_errors=True)
    own.mkdir(parents=True)
    env = duobench.make(name, cameras=False)
    photographer = Photographer(env.unwrapped.simulation, catalog.get(name), own)
    seed = SHOTS.get(name, Shot()).seed
    rollout(env, ExpertPolicy(env), seed=seed, subscribers=[photographer])
    env.close()


def cover(folder: Path) -> Image.Image:
    """Put one picture of each task together, in rows of equal width, the larger ones first."""
    font = ImageFont.load_default(size=20)
    tasks = [catalog.get(name) for name in catalog.names()]
    strips = []
    for members in rows(tasks):
        width = COVER_WIDTH // len(members)
        height = width * STAGE_SIZE[0] // STAGE_SIZE[1]
        strip = Image.new("RGB", (COVER_WIDTH, height))
        for column, task in enumerate(members):
            file = folder / task.id / stage_file(SHOTS.get(task.id, Shot()).best)
            with Image.open(file) as picture:
                strip.paste(picture.resize((width, height)), (column * width, 0))
            ImageDraw.Draw(strip).text(
                (column * width + 12, 8),
                task.title,
                font=font,
                fill="white",
                stroke_width=2,
                stroke_fill="black",
            )
        strips.append(strip)
    sheet = Image.new("RGB", (COVER_WIDTH, sum(strip.height for strip in strips)))
    top = 0
    for strip in strips:
        sheet.paste(strip, (0, top))
        top += strip.height
    return sheet


def rows(tasks: Sequence[Task]) -> Iterator[Sequence[Task]]:
    """Split tasks, in order, into rows of nearly equal length, the shorter ones first."""
    count = max(1, round(len(tasks) ** 0.5))
    shorter, longer = divmod(len(tasks), count)
    begin = 0
    for row in range(count):
        end = begin + shorter + (row >= count - longer)
        yield tasks[begin:end]
        begin = end


def page(folder: Path) -> str:
    """Return the page in Markdown: every task by category, with its pictures in a folder."""
    tasks = [catalog.get(name) for name in catalog.names()]
    lines = [
        "# The tasks in pictures",
        "",
        "Written and drawn by `make docs`. First how an episode begins, from the overview camera "
        "and as a policy sees it, from the head and the two wrists; then the scripted expert at "
        "the control steps that reach each stage.",
    ]
    for category, members in groupby(tasks, key=lambda task: task.category):
        lines += ["", f"## {category.capitalize()}"]
        for task in members:
            lines += ["", *section(task, folder)]
    return "\n".join(lines) + "\n"


def section(task: Task, folder: Path) -> Iterator[str]:
    """Give the lines of one task."""
    yield f"### {task.title}"
    yield ""
    yield explanation(task.id)
    yield ""
    facts = [
        f"`{task.id}`",
        str(task.category),
        f"{task.max_stage} stages",
        f"{task.horizon} control steps ({task.horizon / CONTROL_HZ:.0f} s)",
        *(["printable objects"] if task.printable else []),
        *(["rebuilt on the real robot in the paper"] if task.real else []),
    ]
    yield " · ".join(facts)
    yield ""
    yield f"![{task.title} at the start]({link(task, camera_file(OVERVIEW))})"
    yield ""
    cameras = [
        (camera.replace("_", " ") + " camera", link(task, camera_file(camera)))
        for camera in POLICY_CAMERAS
    ]
    stages = list(pictured(task, folder))
    yield row(caption for caption, _ in cameras)
    yield row(["---"] * COLUMNS)
    yield row(f"![{caption}]({file})" for caption, file in cameras)
    for first in range(0, len(stages), COLUMNS):
        some = stages[first : first + COLUMNS]
        yield row(f"**{caption}**" for caption, _ in some)
        yield row(f"![{caption}]({file})" for caption, file in some)


def pictured(task: Task, folder: Path) -> Iterator[tuple[str, str]]:
    """Give caption and link of each picture of the expert, which may show several stages.

    Raises:
        DuoBenchError: The last stage has no picture.
    """
    waiting = []
    for number, stage in enumerate(task.stages, start=1):
        waiting.append(f"{number}. {stage.name}")
        if (folder / task.id / stage_file(number)).exists():
            yield ", ".join(waiting), link(task, stage_file(number))
            waiting.clear()
    if waiting:
        raise DuoBenchError(
            f"Folder {folder} has no picture of the last stage of {task.id!r}; draw the task first."
        )


def row(cells: Iterable[str]) -> str:
    """Return a row of a table of `COLUMNS` columns."""
    texts = list(cells)
    return "| " + " | ".join(texts + [""] * (COLUMNS - len(texts))) + " |"


def link(task: Task, file: str) -> str:
    """Return where the page finds a picture of a task."""
    return f"{FOLDER}/{task.id}/{file}"


def explanation(name: str) -> str:
    """Return what the documentation of a task's module says under "Task:", on one line."""
    text = cleandoc(import_module(f"duobench.tasks.{name}").__doc__ or "")
    found = re.search(r"^Task:\n((?:    .*\n)+)", text, flags=re.MULTILINE)
    if found is None:
        raise DuoBenchError(f"The docstring of duobench.tasks.{name} has no section 'Task:'.")
    return " ".join(found[1].split())


def sweep(folder: Path) -> None:
    """Remove the pictures of tasks that the catalog no longer has."""
    for own in folder.iterdir():
        if own.name not in catalog.names():
            shutil.rmtree(own)


def main() -> None:
    """Draw what is asked for; if that is everything, write the page and the cover."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("tasks", nargs="*", metavar="task", help="ids; default: all, and the page")
    parser.add_argument("--out", type=Path, default=DOCS, help="folder of the page")
    given = parser.parse_args()
    folder = given.out / FOLDER
    for name in given.tasks or catalog.names():
        draw(name, folder)
        console().print(str(folder / name), soft_wrap=True)
    if given.tasks:
        return
    sweep(folder)
    (given.out / PAGE).write_text(page(folder), encoding="utf-8")
    cover(folder).save(given.out / COVER, quality=COVER_QUALITY, optimize=True)


if __name__ == "__main__":
    main()
