"""Draw the gallery: how every task begins, and its expert as it reaches stage after stage.

`make docs` draws all tasks, and shows all at once in tasks.webp.
`python docs/gallery.py transfer_cube --out images` draws some tasks into another folder. The
seeds are fixed, so the same version of everything draws the same images.
"""

from __future__ import annotations

import argparse
import json
import shutil
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path

import gymnasium as gym
import numpy as np
import PIL.Image
from gallery_page import cover
from gallery_shots import (
    CAMERA_SIZE,
    FILM,
    FILM_FRAMES,
    FILM_QUALITY,
    FILM_SAMPLES,
    FILM_SIZE,
    FOLDER,
    FRAME_MS,
    LATER,
    LOOK,
    QUALITY,
    REST_MS,
    SAMPLES,
    STAGE_SIZE,
    START_SIZE,
    Shot,
    camera_file,
    shot,
    stage_file,
)
from gallery_sources import sources

import duobench
from duobench.cli.shared.console import console
from duobench.core.backend import Image
from duobench.core.errors import DuoBenchError
from duobench.core.types import Array
from duobench.evaluation.policies import ExpertPolicy
from duobench.evaluation.rollouts import Info, Observation, Step, Watcher, rollout
from duobench.tasks import catalog
from duobench.world.looks.catalog import DEFAULT, look
from duobench.world.robot.cameras import OVERVIEW, POLICY_CAMERAS, View
from duobench.world.sim.rendering import Renderer
from duobench.world.sim.simulation import Simulation

DRAWER = Path(__file__).parent / "tasks"
"""Where the page is."""
COVER = "tasks.webp"
"""The moving image of all tasks, beside the page."""
COVER_QUALITY = 50
DRAWN = "drawn.json"
"""Beside the images of a task: what they were drawn from."""


class StateRecorder(Watcher):
    """Keeps every state of an episode, and the control steps at which it reached a stage."""

    def __init__(self, simulation: Simulation) -> None:
        """Remember whose states to keep."""
        self._simulation = simulation
        self.states: list[Array] = []
        """The start and the state after each control step."""
        self.reached: list[tuple[int, int]] = []
        """Control step and stage, each time the stage rose."""

    def on_episode_start(
        self, env: gym.Env, observation: Observation, info: Info
    ) -> None:
        """Keep the start."""
        del env, observation, info
        self.states.append(self._simulation.get_state())

    def on_step(self, step: Step) -> None:
        """Keep the state, and the stage if it is a new one."""
        self.states.append(self._simulation.get_state())
        if step.info["stage"] > (self.reached[-1][1] if self.reached else 0):
            self.reached.append((step.number, step.info["stage"]))


def moments(reached: Sequence[tuple[int, int]]) -> Iterator[tuple[int, int]]:
    """Give the control step at which each stage is drawn, and the stage.

    That is a little after it was reached, at most halfway to where the next one is; the last one
    ends the episode.

    Args:
        reached: Control step and stage, each time the stage rose.
    """
    for (step, stage), (following, _) in pairwise([*reached, reached[-1]]):
        yield step + min(LATER, (following - step) // 2), stage


def draw(name: str, folder: Path) -> list[PIL.Image.Image]:
    """Draw the images of one task into a folder of its name.

    Args:
        name: Id of a task of the catalog.
        folder: Where the task's folder will be.

    Returns:
        Its part of the cover, from the start to the end of the episode.

    Raises:
        DuoBenchError: The expert fails in this episode.
    """
    task, own = catalog.get(name), folder / name
    env = duobench.make(name, cameras=False)
    simulation = env.unwrapped.simulation
    recorder = StateRecorder(simulation)
    rollout(env, ExpertPolicy(env), seed=shot(name).seed, watchers=[recorder])
    stage = recorder.reached[-1][1] if recorder.reached else 0
    if stage < task.max_stage:
        raise DuoBenchError(
            f"The expert of {name!r} ended at stage {stage} of {task.max_stage}; choose an episode "
            "that it solves, by a seed in SHOTS."
        )
    shutil.rmtree(own, ignore_errors=True)
    own.mkdir(parents=True)
    draw_start(simulation, recorder, own)
    draw_stages(simulation, recorder, shot(name), own)
    lines = (
        f'"{key}": {json.dumps(value)}'
        for key, value in sources(task, recorder.reached).items()
    )
    (own / DRAWN).write_text("{" + ",\n".join(lines) + "}\n", encoding="utf-8")
    film = list(filmed(simulation, recorder, shot(name)))
    move(film, own / FILM, quality=FILM_QUALITY, speed=6)
    env.close()
    return film


def filmed(
    simulation: Simulation, recorder: StateRecorder, plan: Shot
) -> Iterator[PIL.Image.Image]:
    """Show the whole episode in few images."""
    height, width = FILM_SIZE
    aim(simulation, plan.view)
    with Renderer(
        simulation.model,
        height=height,
        width=width,
        samples=FILM_SAMPLES,
        look=look(LOOK),
    ) as renderer:
        for step in (
            np.linspace(0, len(recorder.states) - 1, FILM_FRAMES).round().astype(int)
        ):
            simulation.set_state(recorder.states[step])
            yield PIL.Image.fromarray(renderer.render(simulation.data, OVERVIEW))


def draw_start(simulation: Simulation, recorder: StateRecorder, folder: Path) -> None:
    """Draw the start from every camera."""
    simulation.set_state(recorder.states[0])
    for cameras, (height, width), samples, name in (
        ((OVERVIEW,), START_SIZE, SAMPLES, LOOK),
        (POLICY_CAMERAS, CAMERA_SIZE, 1, DEFAULT),
    ):
        with Renderer(
            simulation.model,
            height=height,
            width=width,
            samples=samples,
            look=look(name),
        ) as renderer:
            for camera, image in renderer.render_all(simulation.data, cameras).items():
                save(image, folder / camera_file(camera))


def draw_stages(
    simulation: Simulation, recorder: StateRecorder, plan: Shot, folder: Path
) -> None:
    """Draw each stage that was not skipped, from where the plan says."""
    height, width = STAGE_SIZE
    last = recorder.reached[-1][1]
    with Renderer(
        simulation.model,
        height=height,
        width=width,
        samples=SAMPLES,
        look=look(LOOK),
    ) as renderer:
        for step, stage in moments(recorder.reached):
            aim(simulation, (plan.last or plan.view) if stage == last else plan.view)
            simulation.set_state(recorder.states[step])
            save(renderer.render(simulation.data, OVERVIEW), folder / stage_file(stage))


def aim(simulation: Simulation, view: View) -> None:
    """Put the camera for people somewhere else, from the next restored state on."""
    camera = simulation.model.camera(OVERVIEW)
    camera.pos[:], camera.quat[:] = view.pose.translation, view.pose.wxyz
    camera.fovy[:] = view.fovy_deg


def save(image: Image, path: Path) -> None:
    """Write an image."""
    PIL.Image.fromarray(image).save(path, quality=QUALITY, optimize=True)


def move(images: Iterable[PIL.Image.Image], path: Path, **how: int) -> None:
    """Write images as a moving one."""
    first, *others = images
    times = [FRAME_MS] * len(others) + [REST_MS]
    first.save(path, save_all=True, append_images=others, duration=times, loop=0, **how)


def sweep(folder: Path) -> None:
    """Remove the images of tasks that the catalog no longer has."""
    for own in folder.iterdir():
        if own.name not in catalog.names():
            shutil.rmtree(own)


def main() -> None:
    """Draw what is asked for; if that is everything, also the cover."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument(
        "tasks", nargs="*", metavar="task", help="ids; default: all, and the cover"
    )
    parser.add_argument("--out", type=Path, default=DRAWER, help="folder of the page")
    given = parser.parse_args()
    folder = given.out / FOLDER
    films: dict[str, list[PIL.Image.Image]] = {}
    for name in given.tasks or catalog.names():
        films[name] = draw(name, folder)
        console().print(str(folder / name), soft_wrap=True)
    if given.tasks:
        return
    sweep(folder)
    frames = (
        cover({name: film[number] for name, film in films.items()})
        for number in range(FILM_FRAMES)
    )
    move(frames, given.out / COVER, quality=COVER_QUALITY, method=6)


if __name__ == "__main__":
    main()
