"""`duobench render`: images of a reset."""

from __future__ import annotations

from pathlib import Path

import tyro

from duobench.cli.shared.console import say
from duobench.cli.shared.process import load_engine
from duobench.cli.shared.resets import reset_env
from duobench.core.backend import DEPTH, SEGMENTATION, Sizes
from duobench.core.files import make_folder, taken_back, writing
from duobench.results.suite import find_tasks
from duobench.tasks import catalog
from duobench.world.robot.cameras import OVERVIEW, POLICY_CAMERAS, Camera
from duobench.world.robot.gripper import DEFAULT_GRIPPER

SAMPLES = 16
"""Images averaged into the one for people; what policies see has one."""


def run(  # noqa: PLR0913, PLR0917 - each is an argument of the command line
    task: tyro.conf.Positional[str],
    seed: int = 0,
    cameras: tuple[str | Camera, ...] = (*POLICY_CAMERAS, OVERVIEW),
    size: tuple[int, int] = (720, 1280),
    depth: bool = False,
    segmentation: bool = False,
    look: str = "default",
    gripper: str = DEFAULT_GRIPPER,
    out: Path = Path("renders"),
) -> None:
    """Render a reset of a task from every camera, as PNG files.

    Args:
        task: Id of a task (see: duobench list) or module:ATTRIBUTE.
        seed: Seed of the reset.
        cameras: What is rendered: names, or cameras of your own as JSON or module:NAME.
        size: Height and width of the images in pixels.
        depth: Show depth too, in colours, with a legend.
        segmentation: Show too which part of the scene each pixel shows, with a legend.
        look: Look of the images: wood_table, dark, random:7, ... (see the page looks).
        gripper: Gripper on both arms, such as franka_hand, or module:ATTRIBUTE.
        out: Folder of the images.
    """
    load_engine()
    from PIL import Image

    from duobench.core.false_colours import (
        depth_legend,
        depth_picture,
        segmentation_legend,
        segmentation_picture,
        with_legend,
    )
    from duobench.envs.camera_options import wanted_images
    from duobench.world.sim.rendering import Renderer

    (info,) = find_tasks([task])
    height, width = size
    base = reset_env(catalog.get(info.reference), seed, look, gripper)
    simulation = base.simulation
    images = {}
    known = (*POLICY_CAMERAS, OVERVIEW)
    wanted_images(cameras, (), (), size, {}, known)  # rejects one name of two cameras
    sizes: Sizes = {**dict.fromkeys(cameras, size)}
    with taken_back(out):
        make_folder(out)
        of_people = [camera for camera in cameras if camera == OVERVIEW]
        others = [camera for camera in cameras if camera != OVERVIEW]
        for seen, samples in ((others, 1), (of_people, SAMPLES)):
            with Renderer(
                simulation.model,
                height=height,
                width=width,
                samples=samples,
                look=base.look,
            ) as renderer:
                images |= renderer.render_all(simulation.data, seen)
        if depth:
            for camera, metres in base.backend.images_by_kind({DEPTH: sizes})[
                DEPTH
            ].items():
                picture = with_legend(depth_picture(metres), depth_legend())
                images[f"{camera}-depth"] = picture
        if segmentation:
            seen = base.backend.images_by_kind({SEGMENTATION: sizes})[SEGMENTATION]
            for camera, parts in seen.items():
                legend = segmentation_legend(parts, base.segmentation_ids)
                picture = with_legend(segmentation_picture(parts), legend)
                images[f"{camera}-segmentation"] = picture
        for camera, image in images.items():
            path = out / f"{info.id}-{seed}-{camera}.png"
            with writing(path):
                Image.fromarray(image).save(path)
            say(str(path))
