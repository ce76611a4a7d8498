"""The page of a task: its film, its words, its stages, what must not count, what is seen."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from importlib import import_module
from pathlib import Path

import gallery_page
from gallery_shots import FILM, FOLDER, camera_file
from tables import table

from duobench.core.types import CONTROL_HZ
from duobench.tasks.task import Task
from duobench.world.robot.cameras import OVERVIEW, POLICY_CAMERAS

DOCS = Path(__file__).parent


def task_page(task: Task) -> str:
    """Return the page in Markdown."""
    parts = (begin, stages, ways, more)
    return "\n".join(line for part in parts for line in part(task)) + "\n"


def begin(task: Task) -> Iterator[str]:
    """Film, facts, and what the task says of itself."""
    yield f"# {task.title}"
    yield ""
    yield gallery_page.section_of(task.id, "Task")
    yield ""
    yield f"```{{image}} {FOLDER}/{task.id}/{FILM}"
    yield f":alt: The scripted expert in {task.title}"
    yield ":class: film"
    yield "```"
    yield ""
    yield f'<a href="replays/{task.id}.html">A whole episode in 3D</a>, to turn and to stop.'
    yield ""
    rows = [
        ("id", f"`{task.id}`"),
        ("category", task.category),
        ("stages", task.max_stage),
        ("horizon", f"{task.horizon} control steps, {task.horizon / CONTROL_HZ:.0f} s"),
        ("instruction", told(task.instruction)),
        ("variants", ", ".join(f"`{name}`" for name in task.variants) or "none"),
        ("objects that can be printed", "yes" if task.printable else "no"),
        ("on the real robot in the paper", "yes" if task.real else "no"),
    ]
    yield table(("fact", "value"), rows)
    for heading in ("Randomization", "Success"):
        yield f"**{heading}.** {gallery_page.section_of(task.id, heading)}"
        yield ""
    yield "```sh"
    yield f"duobench eval --policy my_policy:MyPolicy --tasks {task.id} --out runs/{task.id}"
    yield "```"
    yield ""


def told(instruction: str) -> str:
    """Return an instruction whose variants stand out."""
    return re.sub(r"{(\w+)}", r"*\1*", instruction)


def stages(task: Task) -> Iterator[str]:
    """What is reached, and what a policy that asks is told to do for it."""
    yield "## Stages"
    yield ""
    rows = [
        (n, one.name, told(one.instruction)) for n, one in enumerate(task.stages, 1)
    ]
    yield table(("stage:", "what is reached", "what to do"), rows)
    yield "[The rule](stages.md) of stages is the same in every task. The scripted expert, a "
    yield "moment after each:"
    yield ""
    yield from shots(gallery_page.pictured(task, DOCS / "tasks" / FOLDER))


def shots(pictures: Iterable[tuple[str, str]]) -> Iterator[str]:
    """Give pictures side by side, as many as fit."""
    yield "::::{grid} 1 2 3 3"
    yield ":gutter: 2"
    yield ""
    for caption, file in pictures:
        yield ":::{grid-item}"
        yield f"![{caption}]({file})"
        yield ""
        yield re.sub(r"^(\d+)\.", r"\1\.", caption)  # no list
        yield ":::"
    yield "::::"
    yield ""


def ways(task: Task) -> Iterator[str]:
    """What scripts of the tests try: what must not count, and what must."""
    known = import_module(f"tests.ways.{task.id}")
    yield "## What must not count"
    yield ""
    yield f"Scripts that try it, and the stage of {task.max_stage} beyond which none may come:"
    yield ""
    rows = sorted((way.gets, said) for said, way in known.ADVERSARIES.items())
    yield table(("gets at most:", "what is tried"), rows)
    yield ":::{dropdown} Ways other than the expert's that must count"
    yield ""
    yield from (f"- {said}" for said in known.SINCERE)
    yield ":::"
    yield ""


def more(task: Task) -> Iterator[str]:
    """Give what pages on all tasks tell of this one."""
    yield "## What a policy sees"
    yield ""
    cameras = (*POLICY_CAMERAS, OVERVIEW)
    yield from shots(
        (
            f"From the {camera.replace('_', ' ')} camera",
            gallery_page.link(task, camera_file(camera)),
        )
        for camera in cameras
    )
    yield "The overview camera is for people alone. [Frames](../reference/frames.md) has the units,"
    yield f"[object states](object_states.md) the {len(task.object_state.names)} numbers that"
    yield "`object_state=True` adds."
    yield ""
    yield f"![{task.title} in several looks](looks/{task.id}.jpg)"
    yield ""
    yield "[Looks](looks.md) names them, [printing](printing_parts.md) has the parts,"
    yield "[results](../reference/results.md) and [baselines](../reference/baselines.md) what was"
    yield "reached."
