"""Write what the pages show of the tasks: the picture of all of them, and the table in README.md.

Run as `make docs`. A test compares the table with the catalog.
"""

import math
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

from duobench.envs.duo_env import DuoEnv
from duobench.envs.wrappers import RandomizedReset
from duobench.scene.cameras import OVERVIEW
from duobench.sim.rendering import Renderer
from duobench.tasks import catalog

DOCS = Path(__file__).parent
README = DOCS.parent / "README.md"
TABLE = ("<!-- tasks: written by make docs -->\n", "<!-- end of tasks -->\n")
TILE = (360, 480)
"""Height and width of one task in the picture, in pixels."""
SAMPLES = 16
COLUMNS = 4
JPEG_QUALITY = 88


def table() -> str:
    """Return the tasks as a table in Markdown."""
    rows = ["| task | category | stages | horizon |", "| --- | --- | --- | --- |"]
    for task in map(catalog.get, catalog.names()):
        rows.append(f"| `{task.id}` | {task.category} | {task.max_stage} | {task.horizon} |")
    return "\n".join(rows) + "\n"


def with_table(page: str) -> str:
    """Return a page with the table between its marks brought up to date."""
    before, rest = page.split(TABLE[0])
    _, after = rest.split(TABLE[1])
    return before + TABLE[0] + "\n" + table() + "\n" + TABLE[1] + after


def tile(name: str) -> Image.Image:
    """Draw how an episode of a task begins, with the task's title."""
    height, width = TILE
    base = DuoEnv(catalog.get(name))
    RandomizedReset(base).reset(seed=0)
    simulation = base.simulation
    with Renderer(simulation.model, height=height, width=width, samples=SAMPLES) as renderer:
        picture = Image.fromarray(renderer.render(simulation.data, OVERVIEW))
    font = ImageFont.load_default(size=22)
    ImageDraw.Draw(picture).text(
        (12, 8), base.definition.title, font=font, fill="white", stroke_width=2, stroke_fill="black"
    )
    return picture


def overview() -> Image.Image:
    """Draw all tasks side by side."""
    names = catalog.names()
    height, width = TILE
    columns = min(COLUMNS, math.ceil(math.sqrt(len(names))))
    sheet = Image.new("RGB", (columns * width, math.ceil(len(names) / columns) * height), "white")
    for number, name in enumerate(names):
        row, column = divmod(number, columns)
        sheet.paste(tile(name), (column * width, row * height))
    return sheet


def main() -> None:
    """Write the picture and the table."""
    overview().save(DOCS / "tasks.jpg", quality=JPEG_QUALITY)
    README.write_text(with_table(README.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
