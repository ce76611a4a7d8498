"""Write what follows from the code into pages: tables, lists of names, and numbers in sentences.

Part of `make docs`. A place for a table is `<!-- NAME: written by make docs -->` to
`<!-- end of NAME -->`, one for a number `<!-- number:NAME -->12<!-- / -->` (constants.py).
"""

import ast
import inspect
import math
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from importlib import import_module
from itertools import pairwise
from pathlib import Path

import numpy as np

import duobench
from duobench.core.spatial import SE3
from duobench.core.types import SIDES
from duobench.envs import action_labels, spaces
from duobench.envs.action_modes import ACTION_MODES
from duobench.policy.serving.vla_eval import MODES
from duobench.results.entrants import PAPER, published
from duobench.results.records import Record
from duobench.results.suite import SUITES
from duobench.tasks import catalog
from duobench.tasks.shifts import levels
from duobench.tasks.task import Task
from duobench.world.objects.prop import Prop
from duobench.world.objects.shapes import CIRCLE_SEGMENTS
from duobench.world.objects.solid import (
    Solid,
    manifold_from,
    mass_properties,
    pieces_of,
    placed,
    printable,
)
from duobench.world.robot.cameras import POLICY_CAMERAS
from duobench.world.robot.joints import JOINT_RANGES, VELOCITY_LIMITS
from duobench.world.robot.mounts import HOME_JOINTS

DOCS = Path(__file__).parent
ROOT = DOCS.parent
sys.path += [str(ROOT), str(ROOT / "examples" / "object_states"), str(DOCS)]
baselines = import_module("table")  # of the example
constants, failures, gallery_page, prints_page = map(
    import_module, ("constants", "failures", "gallery_page", "prints_page")
)
PLACE = re.compile(
    r"(<!-- (?P<name>[\w ]+): written by make docs -->\n)(?P<now>.*?)(<!-- end of (?P=name) -->\n)",
    flags=re.DOTALL,
)
NUMBER = re.compile(r"(<!-- number:([\w ]+) -->).*?(<!-- / -->)")
LISTED = 6
"""Numbers that are named one by one; of more, the first and the last are."""
TURNS = {
    CIRCLE_SEGMENTS: "any turn",
    8: "eighth turns",
    6: "sixth turns",
    4: "quarter turns",
    3: "third turns",
    2: "half turns",
}
"""Turns that may lead to the same shape, by how many of them there are."""
SAME = 1e-3
"""Share of its volume by which a turned shape may differ: what print joints and facets make up."""


def table(headings: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """Return a table in Markdown; a heading that ends in a colon is that of a column of numbers."""
    names = list(headings)
    marks = ["---:" if name.endswith(":") else "---" for name in names]
    lines = [
        [name.rstrip(":") for name in names],
        marks,
        *(map(str, row) for row in rows),
    ]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def tasks() -> str:
    """All of them."""
    found = map(catalog.get, catalog.names())
    rows = [
        (f"`{task.id}`", task.category, task.max_stage, task.horizon) for task in found
    ]
    return table(("task", "category", "stages", "horizon"), rows)


def object_states() -> str:
    """The order of the numbers of every task's object state."""
    rows = []
    for task in map(catalog.get, catalog.names()):
        begin: tuple[object, object] = (f"`{task.id}`", len(task.object_state.names))
        for cells in _parts(task):
            rows.append((*begin, *cells))
            begin = ("", "")
    return table(("task", "numbers:", "places", "names", "looks the same after"), rows)


def _parts(task: Task) -> Iterator[tuple[str, str, str]]:
    """Where the numbers are, counted from 0, what they are called, and an object's symmetry."""
    turned = {f"{prop.name}_z_axis_z": prop for prop in task.props}
    first = 0
    for part in task.object_state.parts:
        last = first + len(part.names) - 1
        names = [f"`{name}`" for name in part.names]
        if len(names) > LISTED:
            names = [names[0], "…", names[-1]]
        places = f"{first}" if first == last else f"{first}–{last}"
        prop = turned.get(part.names[-1])
        yield places, " ".join(names), _symmetry(prop) if prop else ""
        first = last + 1


def _symmetry(prop: Prop) -> str:
    """Turns about an object's axes after which it is where it was; of one of its variants."""
    root, *others = prop.prints({prop.choice or "": min(prop.variants, default="")})
    whole = manifold_from(printable(root))
    for part, solid in zip(prop.parts, others, strict=True):
        whole += placed(manifold_from(printable(solid)), part.pose)
    found: dict[str, list[str]] = {}
    for name, axis in zip("xyz", ((1, 0, 0), (0, 1, 0), (0, 0, 1)), strict=True):
        for count, words in TURNS.items():
            turned = placed(whole, SE3.about(axis, 2 * math.pi / count))
            if (whole - turned).volume() < SAME * whole.volume():
                found.setdefault(words, []).append(name)
                break
    return (
        ", ".join(f"{words} about {' '.join(axes)}" for words, axes in found.items())
        or "none"
    )


def fields_of(cls: type) -> Callable[[], str]:
    """The fields of a data class, by the docstring under each."""
    (definition,) = ast.parse(inspect.getsource(cls)).body
    assert isinstance(definition, ast.ClassDef)
    rows = [
        (f"`{ast.unparse(field.target)}`", _cell(below))
        for field, below in pairwise(definition.body)
        if isinstance(field, ast.AnnAssign)
        and isinstance(below, ast.Expr)
        and isinstance(below.value, ast.Constant)
    ]
    return lambda: table(("field", "meaning"), rows)


def _cell(docstring: ast.Expr) -> str:
    """What a docstring says, as a cell of a table."""
    return " ".join(ast.literal_eval(docstring.value).split())


def every_task() -> str:
    """Headings and images of all tasks, each in all looks."""
    found = map(catalog.get, catalog.names())
    parts = [
        f"### {task.title}\n\n![{task.title} in all looks](looks/{task.id}.jpg)\n"
        for task in found
    ]
    return "\n".join(parts)


def names(of: tuple[str, ...]) -> Callable[[], str]:
    """A list of names of numbers, one side a line."""
    half = len(of) // len(SIDES)
    return lambda: (
        "```text\n" + " ".join(of[:half]) + "\n" + " ".join(of[half:]) + "\n```\n"
    )


def joints() -> str:
    """Ranges, speeds and home of an arm's joints."""
    arm = zip(JOINT_RANGES, VELOCITY_LIMITS, *HOME_JOINTS, strict=True)
    rows = [
        (
            number,
            f"{low:.4f}",
            f"{high:.4f}",
            f"{speed:.2f}",
            f"{left:.4f}",
            f"{right:.4f}",
        )
        for number, ((low, high), speed, left, right) in enumerate(arm, 1)
    ]
    headings = (
        "smallest",
        "largest",
        "speed limit, rad/s",
        "home, left",
        "home, right",
    )
    return table(("joint", *headings), rows)


MEANINGS = {
    "joint": "absolute joint targets, radians",
    "joint_relative": "displacements from the last sent joint targets, radians",
    "cartesian": "absolute pose of the tool in the table frame",
    "cartesian_relative": "translation and rotation vector of the tool, along the axes of the "
    "table frame",
}
"""What the numbers of one side are, in each action mode."""


def modes() -> str:
    """Action modes and how many numbers an environment takes in them."""
    rows = []
    for name in ACTION_MODES:
        env = duobench.make("bin_sort", cameras=False, action_mode=name)
        (size,) = env.action_space.shape or ()
        rows.append((f"`{name}`", size, MEANINGS[name]))
        env.close()
    return table(("mode", "size", "joints or pose of one side"), rows)


MOUNTS = {
    "world": "the table frame",
    "left/link7": "the left flange",
    "right/link7": "the right flange",
}
"""What cameras are mounted on, by body."""


def cameras() -> str:
    """Where cameras are and what they see, from a compiled model."""
    env = duobench.make("bin_sort", cameras=False)
    model = env.unwrapped.simulation.model  # pyright: ignore[reportAttributeAccessIssue]
    env.reset(seed=0)
    rows = []
    for name in POLICY_CAMERAS:
        camera = model.cam(name)
        mount = MOUNTS[model.body(int(camera.bodyid[0])).name]
        position = np.array(camera.pos)
        if camera.bodyid[0]:
            position -= model.site(f"{name.split('_')[0]}/flange").pos
        vertical = float(model.cam_fovy[camera.id])
        width, height = model.cam_resolution[camera.id].tolist()
        half = math.tan(math.radians(vertical / 2)) * width / height
        at = " ".join(f"{number + 0.0:.4f}" for number in position)
        horizontal = math.degrees(2 * math.atan(half))
        rows.append((f"`{name}`", mount, at, f"{vertical:.1f}", f"{horizontal:.1f}"))
    env.close()
    angles = ("vertical field of view, degrees", "horizontal, degrees")
    return table(("name", "mounted on", "position, m", *angles), rows)


def suites() -> str:
    """The suites by name."""
    rows = [
        (
            f"`{one.name}`",
            one.revision,
            one.episodes,
            one.execution.execute,
            one.purpose,
        )
        for one in SUITES.values()
    ]
    chunk = "actions executed of a chunk"
    return table(("suite", "version", "episodes of each task", chunk, "for"), rows)


def owners() -> str:
    """Whose each failure is, and what comes of it."""
    rows = [(row.moment, row.what, row.owner, row.effect) for row in failures.ROWS]
    return table(("when", "what happens", "whose", "effect"), rows)


def serving_modes() -> str:
    """Action modes by the words of vla-eval."""
    rows = [
        (*(f"`{word}`" for word in key), f"`{mode}`") for key, mode in MODES.items()
    ]
    headings = (
        "`control_mode`",
        "`relative_to`",
        "action mode, see [frames.md](../reference/frames.md)",
    )
    return table(headings, rows)


def by_level(values: Iterable[float], unit: str = "", scale: float = 1) -> list[str]:
    """Return the values of the levels from 1 on, as people read them."""
    _, *rest = values
    return [f"{scale * value:g}{unit}" for value in rest]


def axes() -> str:
    """Axes of shifts, and what they change at each level."""
    degrees = 180 / math.pi
    rows = {
        "look | images": (
            "other light and exposure",
            "and colours of table, floor, walls, robot",
            "and their textures",
            "and 8 to 24 pieces of furniture in the background",
            "and textures and shades of objects",
        ),
        "renderer | images: by the studio; not part of `robust`, nor of all": (
            "look `studio`",
            "and other light and exposure",
            "and colours of table, floor, walls, robot",
            "and their textures",
            "and 8 to 24 pieces of furniture in the background",
        ),
        "camera | images: offset of the head camera along each axis up to": by_level(
            levels.CAMERA_METRES, " mm", 1000
        ),
        " | its turn about each axis, and its field of view, up to": by_level(
            levels.CAMERA_RADIANS, "°", degrees
        ),
        "layout | how far beyond the range of training objects start, up to": by_level(
            levels.MARGIN_METRES, " mm", 1000
        ),
        " | how far they are turned beyond it, up to": by_level(
            levels.MARGIN_RADIANS, "°", degrees
        ),
        "physics | mass of all objects times, or divided by, up to": by_level(
            levels.MASS_FACTORS
        ),
        " | friction of all surfaces times, or divided by, up to": by_level(
            levels.FRICTION_FACTORS
        ),
        " | springs of hinges, with the mass that they move, times, or divided by, up "
        "to": by_level(levels.SPRING_FACTORS),
        "instruction | share of episodes with one of the task's three kept "
        "paraphrases, which no demonstration has": by_level(
            levels.REWORDED_SHARE, " %", 100
        ),
        "sensing | noise in images, standard deviation of full brightness": by_level(
            levels.IMAGE_NOISE, " %", 100
        ),
        " | frames that each camera drops": by_level(levels.DROPPED_SHARE, " %", 100),
        " | noise in joint positions (mrad), in positions of tools (mm) and in numbers "
        "of objects (1/1000)": by_level(levels.JOINT_NOISE, scale=1000),
        " | depth: error of a stereo camera's disparity, pixels": by_level(
            levels.DEPTH_SUBPIXEL
        ),
        " | depth: end of the range of all cameras but the head's": by_level(
            levels.DEPTH_FARTHEST, " m"
        ),
        " | depth: share of bare metal and glass without": by_level(
            levels.DEPTH_SHINY_SHARE, " %", 100
        ),
        "latency | control steps from an observation to the chunk that answers "
        "it": by_level(levels.LATENCY_STEPS),
    }
    headings = ("axis", "what changes", "level 1", "2", "3", "4", "5")
    return table(headings, [(about, *cells) for about, cells in rows.items()])


def paper() -> str:
    """Success rates and progress that the paper has."""
    found = published(PAPER)
    rows = []
    for name, values in {
        **found.tasks,
        "overall": found.means["overall"].values,
    }.items():
        row = [f"`{name}`" if name in found.tasks else name]
        for policy in found.policies:
            rate, progress = values[policy]
            row.append(f"{rate:.0f} ({progress:.2f})".replace("(0.", "(."))
        rows.append(row)
    return table(("task", *found.policies.values()), rows)


def lowered() -> str:
    """Tasks whose levels of an axis are lower than those of the others."""
    found = [
        (axis, *each)
        for axis, tasks in levels.LOWERED.items()
        for each in tasks.items()
    ]
    rows = [(f"`{axis}`", f"`{task}`", level) for axis, task, level in found]
    return table(("lowered on", "task", "bounds of level"), rows)


def prints() -> str:
    """Objects that can be printed, as their first variant."""
    rows = []
    for task in map(catalog.get, catalog.names()):
        for prop in task.props if task.printable else ():
            rows += printed(task.id, prop, min(prop.variants, default=""))
    headings = ("task", "object", "pieces:", "largest piece (mm):", "mass (g):")
    return table(headings, rows)


def printed(task: str, prop: Prop, value: str) -> list[tuple[str, ...]]:
    """Rows of an object's variant: the size of its largest piece in falling order."""
    parts = (prop.name, *(prop.part_name(part.name) for part in prop.parts))
    solids = prop.prints({prop.choice or "": value})
    return [
        (f"`{task}`", f"`{name}`", *_print_of(solid))
        for name, solid in zip(parts, solids, strict=True)
    ]


def _print_of(solid: Solid) -> tuple[str, str, str]:
    pieces = pieces_of(solid)
    largest = max((np.ptp(piece.vertices, axis=0) for piece in pieces), key=np.prod)
    size = " × ".join(f"{1000 * edge:.0f}" for edge in sorted(largest)[::-1])
    return str(len(pieces)), size, f"{1000 * mass_properties(solid).mass:.0f}"


def learned(setting: str, what: str = "table") -> Callable[[], str]:
    """What the baselines on object states reached, as their own program prints it."""
    return lambda: "\n".join(
        [*getattr(baselines, what)(baselines.RESULTS, setting), ""]
    )


def learned_further() -> str:
    """What networks of `join_blocks` reached: few demonstrations, with what else, and more."""
    called = {
        "10": "10 demonstrations",
        "10-corrections": "and 50 corrections",
        "10-self-50": "and 50 own successes",
        "60": "60 demonstrations",
        "86": "86 demonstrations",
    }
    rows = baselines.compared(baselines.RESULTS, "join_blocks", called)
    return "\n".join([*rows, ""])


Places = Mapping[str, Callable[[], str]]
TABLES: Mapping[str, Places] = {
    "environments": {"tasks": tasks},
    "object_states": {"tasks": object_states},
    "frames": {
        "modes": modes,
        "JOINT_NAMES": names(spaces.JOINT_NAMES),
        "POSE_NAMES": names(spaces.POSE_NAMES),
        "SHIFT_NAMES": names(spaces.SHIFT_NAMES),
        "joints": joints,
        "cameras": cameras,
    },
    "lerobot": {
        "POSE_LABELS": names(action_labels.POSE_LABELS),
        "SHIFT_LABELS": names(action_labels.SHIFT_LABELS),
    },
    "looks": {"every task": every_task},
    "evaluation": {
        "suites": suites,
        "failures": owners,
        "record": fields_of(Record),
    },
    "baselines": {
        "learned from 50": learned("50"),
        "learned from 200": learned("200"),
        "failures with 50": learned("50", what="failures"),
        "learned from images": learned("200-images"),
        "learned from corrections": learned_further,
    },
    "results": {
        "learned from object states": learned("200"),
        "learned from images": learned("200-images"),
        "paper": paper,
    },
    "serving": {"modes": serving_modes},
    "robustness": {"axes": axes, "lowered": lowered},
    "printing": {"prints": prints},
}
"""What is written into which page, by the name of its place."""


PAGES = (*sorted(DOCS.rglob("*.md")), ROOT / "README.md")
WHOLE = {
    gallery_page.PAGE: lambda: gallery_page.page(DOCS / "tasks" / gallery_page.FOLDER),
    prints_page.PAGE: lambda: prints_page.page(DOCS / "tasks" / prints_page.FOLDER),
}
"""Pages that follow from the code and its pictures altogether."""


def written(page: Path) -> str:
    """Return a page with all that is written into it brought up to date.

    Raises:
        ValueError: If it lacks a place for a table, or has one for what is unknown.
    """
    if page.name in WHOLE:
        return WHOLE[page.name]()
    text = page.read_text(encoding="utf-8")
    tables = TABLES.get(page.stem, {})
    places = [found["name"] for found in PLACE.finditer(text)]
    if sorted(places) != sorted(tables):
        raise ValueError(f"{page.name} has places for {places}, not for {list(tables)}")
    unknown = {name for _, name, _ in NUMBER.findall(text)} - set(constants.NUMBERS)
    if unknown:
        raise ValueError(f"{page.name} has numbers that constants.py lacks: {unknown}")
    if re.search(r"^ *<!-- number", text, flags=re.MULTILINE):
        raise ValueError(
            f"A line of {page.name} begins with a number's comment, "
            "which ends a paragraph; break the line elsewhere."
        )
    text = PLACE.sub(lambda at: f"{at[1]}\n{tables[at['name']]()}\n{at[4]}", text)
    return NUMBER.sub(lambda at: f"{at[1]}{constants.NUMBERS[at[2]]}{at[3]}", text)


if __name__ == "__main__":
    for page in PAGES:
        page.write_text(written(page), encoding="utf-8")
