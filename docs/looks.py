"""Draw every task in every named look, and some at random: the images of looks.md.

`make docs` draws all of them. `python docs/looks.py bin_sort --out images` draws some tasks into
another folder. The seeds are fixed, so the same version of everything draws the same images.
"""

from __future__ import annotations

import argparse
import hashlib
import json
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import PIL.Image
from gallery import aim
from gallery_shots import shot
from gallery_sources import DIGITS, model_digest
from PIL import ImageDraw, ImageFont

from duobench.cli.shared.console import console
from duobench.tasks import catalog
from duobench.world.looks.catalog import LOOKS, look
from duobench.world.looks.look import CLASSIC
from duobench.world.robot.cameras import HEAD, OVERVIEW
from duobench.world.sim.rendering import Renderer
from duobench.world.sim.simulation import Simulation

DRAWER = Path(__file__).parent / "tasks"
"""Where the page is."""
FOLDER = "looks"
"""Where the images are, beside the page."""
DRAWN = "drawn.json"
"""Beside the images: what they were drawn from."""
NAMES = (
    *(name for name, each in LOOKS.items() if each.renderer == CLASSIC),
    *("random:1", "random:4", "random:5", "random:7"),
)
COLUMNS = 4
CELL = (204, 272)
"""Height and width of one look in pixels."""
HEAD_TASK, HEAD_FILE = "bin_sort", "head.jpg"
"""The task that is also shown as a policy sees it, and the file."""
PAIR, PAIRS_FILE = ("default", "studio"), "studio.jpg"
"""Looks of the two renderers, side by side of every task, and the file."""
SAMPLES = 8
QUALITY = 77


def sheet(
    name: str, camera: str, samples: int, names: Sequence[str] = NAMES
) -> PIL.Image.Image:
    """Draw the start of a task from one camera in all looks."""
    task = catalog.get(name)
    simulation = Simulation(task.props, task.overview)
    simulation.apply(next(iter(task.layouts(0))))
    simulation.settle()
    aim(simulation, shot(name).view)
    simulation.forward()
    height, width = CELL
    columns = min(COLUMNS, len(names))
    rows = -(-len(names) // columns)
    whole = PIL.Image.new("RGB", (columns * width, rows * height))
    font = ImageFont.load_default(size=15)
    with Renderer(
        simulation.model, height=height, width=width, samples=samples
    ) as renderer:
        for number, one in enumerate(names):
            renderer.set_look(look(one))
            row, column = divmod(number, columns)
            at = column * width, row * height
            whole.paste(
                PIL.Image.fromarray(renderer.render(simulation.data, camera)), at
            )
            ImageDraw.Draw(whole).text(
                (at[0] + 7, at[1] + 4), one, font=font, fill="white", stroke_width=2,
                stroke_fill="black",
            )  # fmt: skip
    return whole


def pairs() -> PIL.Image.Image:
    """Draw the start of every task by both renderers, two tasks in a row."""
    sheets = [sheet(name, OVERVIEW, SAMPLES, PAIR) for name in catalog.names()]
    width, height = sheets[0].size
    whole = PIL.Image.new("RGB", (2 * width, -(-len(sheets) // 2) * height), "white")
    for number, one in enumerate(sheets):
        row, column = divmod(number, 2)
        whole.paste(one, (column * width, row * height))
    return whole


def sources() -> dict[str, str]:
    """Return digests of what the images are drawn from: the looks, and each task's model."""
    found = {"looks": digest(NAMES), PAIR[1]: digest(PAIR)}
    for name in catalog.names():
        found[name] = model_digest(catalog.get(name))
    return found


def digest(names: Sequence[str]) -> str:
    """Return the SHA-256 of looks."""
    looks = json.dumps([look(name).to_json() for name in names])
    # Sines on two processors agree in so many decimals.
    rounded = json.loads(looks, parse_float=lambda text: round(float(text), DIGITS))
    return hashlib.sha256(json.dumps(rounded).encode()).hexdigest()


def main() -> None:
    """Draw what is asked for; if that is everything, note what it was drawn from."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("tasks", nargs="*", metavar="task", help="ids; default: all")
    parser.add_argument("--out", type=Path, default=DRAWER, help="folder of the page")
    given = parser.parse_args()
    folder = given.out / FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    files = {
        f"{name}.jpg": (name, OVERVIEW, SAMPLES)
        for name in given.tasks or catalog.names()
    }
    if not given.tasks:
        files[HEAD_FILE] = HEAD_TASK, HEAD, 1
        for old in folder.glob("*.jpg"):
            old.unlink()
    images = {file: partial(sheet, *what) for file, what in files.items()}
    if not given.tasks:
        images[PAIRS_FILE] = pairs
    for file, draw in images.items():
        draw().save(folder / file, quality=QUALITY, optimize=True)
        console().print(str(folder / file), soft_wrap=True)
    if not given.tasks:
        (folder / DRAWN).write_text(
            json.dumps(sources(), indent=1) + "\n", encoding="utf-8"
        )


if __name__ == "__main__":
    main()
