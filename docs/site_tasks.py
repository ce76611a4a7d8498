"""The page of a task: its film, its words, its stages, what must not count, what was reached."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from importlib import import_module
from inspect import cleandoc
from pathlib import Path

import gallery_page
import prints_page
from gallery_shots import FILM, FOLDER, camera_file
from tables import baselines, object_states_of, table

from duobench.core.types import CONTROL_HZ, POLICY_CAMERAS
from duobench.results.entrants import AUTHORS, PAPER, WARNING, published, value_of
from duobench.tasks.task import Task
from duobench.world.robot.cameras import OVERVIEW

DOCS = Path(__file__).parent
LEARNED = baselines.RESULTS
"""What the networks on object states reached, a folder for each number of demonstrations."""
TRAINED = re.compile(r"(?P<shown>\d+)(-self-(?P<own>\d+))?(?P<images>-images)?")
"""Names of the folders that a page tells of."""
RESULTS = DOCS / "reference" / "results.md"


def task_page(task: Task) -> str:
    """Return the page in Markdown."""
    parts = (begin, stages, ways, views, numbers, looks, printed, reached)
    return "\n".join(line for part in parts for line in part(task)) + "\n"


def begin(task: Task) -> Iterator[str]:
    """Film, facts, and what the task says of itself."""
    yield f"# {task.title}"
    yield ""
    yield gallery_page.explanation(task.id)
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
        yield f"**{heading}.** {section_of(task.id, heading)}"
        yield ""
    yield "```sh"
    yield f"duobench eval --policy my_policy:MyPolicy --tasks {task.id} --out runs/{task.id}"
    yield "```"
    yield ""


def told(instruction: str) -> str:
    """Return an instruction whose variants stand out."""
    return re.sub(r"{(\w+)}", r"*\1*", instruction)


def section_of(name: str, heading: str) -> str:
    """Return what the documentation of a task's module says under a heading, on one line."""
    text = cleandoc(import_module(f"duobench.tasks.{name}").__doc__ or "")
    found = re.search(rf"^{heading}:\n((?:    .*\n?|\n)+)", text, flags=re.MULTILINE)
    if found is None:
        raise ValueError(f"The docstring of duobench.tasks.{name} has no section {heading!r}.")
    return " ".join(found[1].split())


def stages(task: Task) -> Iterator[str]:
    """What is reached, and what a policy that asks is told to do for it."""
    yield "## Stages"
    yield ""
    rows = [(n, one.name, told(one.instruction)) for n, one in enumerate(task.stages, 1)]
    yield table(("stage:", "what is reached", "what to do"), rows)
    yield "[The rule](stages.md) of stages is the same in every task. The scripted expert, a "
    yield "moment after each:"
    yield ""
    yield from shots(gallery_page.pictured(task, DOCS / "tasks" / FOLDER))


def shots(pictures: Iterator[tuple[str, str]] | list[tuple[str, str]]) -> Iterator[str]:
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


def views(task: Task) -> Iterator[str]:
    """How an episode begins."""
    yield "## What a policy sees"
    yield ""
    yield from shots(
        [
            (
                f"From the {camera.replace('_', ' ')} camera",
                f"{FOLDER}/{task.id}/{camera_file(camera)}",
            )
            for camera in (*POLICY_CAMERAS, OVERVIEW)
        ]
    )
    yield "The overview camera is for people alone. [Frames](../reference/frames.md) has the units."
    yield ""


def numbers(task: Task) -> Iterator[str]:
    """The object state."""
    yield "## Object state"
    yield ""
    yield f"`object_state=True` adds {len(task.object_state.names)} numbers, which are "
    yield "[privileged](object_states.md):"
    yield ""
    yield object_states_of(task)


def looks(task: Task) -> Iterator[str]:
    """The same start in several looks."""
    yield "## Looks"
    yield ""
    yield f"![{task.title} in several looks](looks/{task.id}.jpg)"
    yield ""
    yield "[Looks](looks.md) names them and says how to make one."
    yield ""


def printed(task: Task) -> Iterator[str]:
    """The parts, where there are some."""
    yield "## Printing"
    yield ""
    lines = list(prints_page.section(task.id, DOCS / "tasks" / prints_page.FOLDER))
    yield from lines[2:]  # without its heading
    yield ""
    yield "[Printing](printing.md) has files, sizes and masses."
    yield ""


def reached(task: Task) -> Iterator[str]:
    """Known results: of this implementation, then those that were published elsewhere."""
    yield "## Known results"
    yield ""
    rows = [*expert(task), *learned(task)]
    yield table(("here", "success %:", "95 % interval:", "final progress:", "episodes:"), rows)
    yield "The expert reads the simulator, and networks on object states are told where objects "
    yield "are: both are privileged. [Results](../reference/results.md), "
    yield "[baselines](../reference/baselines.md)."
    yield ""
    yield f"Published results, {WARNING}:"
    yield ""
    rows = []
    for name in (PAPER, AUTHORS):
        source = published(name)
        for policy, title in source.policies.items():
            value = value_of(source, policy, [task.id])
            if isinstance(value, int):
                rows.append((f"{title} ({name})", f"{100 * value / source.rollouts:.1f}", ""))
            elif value is not None:
                rows.append((f"{title} ({name})", f"{value[0]:g}", f"{value[1]:.2f}"))
    yield table(("elsewhere", "success %:", "final progress:"), rows)


def expert(task: Task) -> Iterator[tuple[str, ...]]:
    """The row of the page of results."""
    found = re.search(rf"^\| `{task.id}` \| (\d+) \|", RESULTS.read_text("utf-8"), re.MULTILINE)
    if found is None:
        raise ValueError(f"{RESULTS.name} has no row of {task.id!r}")
    yield ("scripted expert", found[1], "", "", "100")


def learned(task: Task) -> Iterator[tuple[str, ...]]:
    """What the networks reached, all seeds together, in intervals that hold their spread."""
    for folder in sorted(LEARNED.glob("[0-9]*"), key=lambda one: one.name.zfill(9)):
        if (found := TRAINED.fullmatch(folder.name)) is None:
            continue  # demonstrations that were cut, or so many passes over them
        files = sorted(folder.glob(f"{task.id}-*.json"))
        runs = [json.loads(file.read_text(encoding="utf-8")) for file in files]
        if not runs:
            continue
        episodes, successes = (sum(run[key] for run in runs) for key in ("episodes", "successes"))
        rates = [run["successes"] / run["episodes"] for run in runs]
        low, high = baselines.interval(rates, runs[0]["episodes"])
        progress = sum(run["progress"] * run["episodes"] for run in runs) / episodes
        seen = "images" if found["images"] else "object states"
        own = f" and {found['own']} own successes" if found["own"] else ""
        seeds = "one seed" if len(runs) == 1 else f"{len(runs)} seeds"
        yield (
            f"network on {seen}, {found['shown']} demonstrations{own}, {seeds}",
            f"{100 * successes / episodes:.1f}",
            f"{100 * low:.1f}–{100 * high:.1f}",
            f"{progress:.3f}",
            str(episodes),
        )
