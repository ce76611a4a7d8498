"""`duobench render`: images of how an episode begins."""

from __future__ import annotations

from pathlib import Path

import tyro

from duobench.cli.shared.console import console
from duobench.cli.shared.engine import load_engine

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
        look: Look of the images: wood_table, dark, random:7, ... (see docs/looks.md).
        out: Folder of the images.
    """
    load_engine()
    from PIL import Image

    from duobench.envs import RandomizedReset
    from duobench.envs.config import checked_seed
    from duobench.envs.sim_env import SimEnv
    from duobench.files import make_folder, writing
    from duobench.results.suite import find_tasks
    from duobench.robot.cameras import OVERVIEW
    from duobench.sim.rendering import Renderer
    from duobench.tasks import catalog
    from duobench.types import POLICY_CAMERAS

    checked_seed(seed)
    (info,) = find_tasks([task])
    height, width = size
    base = SimEnv(catalog.get(info.reference), look=look)
    make_folder(out)
    RandomizedReset(base).reset(seed=seed)
    simulation = base.simulation
    images = {}
    for cameras, samples in ((POLICY_CAMERAS, 1), ((OVERVIEW,), SAMPLES)):
        with Renderer(
            simulation.model, height=height, width=width, samples=samples, look=base.look
        ) as renderer:
            images |= renderer.render_all(simulation.data, cameras)
    screen = console()
    for camera, image in images.items():
        path = out / f"{info.id}-{seed}-{camera}.png"
        with writing(path):
            Image.fromarray(image).save(path)
        screen.print(str(path))
