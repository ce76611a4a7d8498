"""`duobench render`: images of a reset."""

from __future__ import annotations

from pathlib import Path

import tyro

from duobench.cli.shared.console import say
from duobench.cli.shared.process import load_engine
from duobench.cli.shared.resets import reset_env
from duobench.core.files import make_folder, taken_back, writing
from duobench.results.suite import find_tasks
from duobench.tasks import catalog
from duobench.world.robot.cameras import OVERVIEW, POLICY_CAMERAS

SAMPLES = 16
"""Images averaged into the one for people; what policies see has one."""


def run(
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
        look: Look of the images: wood_table, dark, random:7, ... (see the page looks).
        out: Folder of the images.
    """
    load_engine()
    from PIL import Image

    from duobench.world.sim.rendering import Renderer

    (info,) = find_tasks([task])
    height, width = size
    base = reset_env(catalog.get(info.reference), seed, look)
    simulation = base.simulation
    images = {}
    with taken_back(out):
        make_folder(out)
        for cameras, samples in ((POLICY_CAMERAS, 1), ((OVERVIEW,), SAMPLES)):
            with Renderer(
                simulation.model,
                height=height,
                width=width,
                samples=samples,
                look=base.look,
            ) as renderer:
                images |= renderer.render_all(simulation.data, cameras)
        for camera, image in images.items():
            path = out / f"{info.id}-{seed}-{camera}.png"
            with writing(path):
                Image.fromarray(image).save(path)
            say(str(path))
