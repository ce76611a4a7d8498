"""Errors that a user is likely to meet, in the words that they are promised in.

`errors.json` holds the words; `python -m tests.promised_errors` writes them anew. Elsewhere tests
ask for the class of an error, and for a word of it where one class stands for several.
"""

import json
import math
import re
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import duobench
from duobench.core.randomness import Choice, Uniform, around
from duobench.core.spatial import SE3
from duobench.core.types import Side
from duobench.data import ExportOptions
from duobench.envs import EnvConfig
from duobench.evaluation.policies import PolicyChoice
from duobench.policy import make as make_policy
from duobench.real.rig import Rig
from duobench.tasks import Placement, Task, catalog
from duobench.tasks.experts.expert import find_script
from duobench.tasks.shifts import shift
from duobench.tasks.stages.logic import held_for
from duobench.tasks.stages.placing import low_over
from duobench.tasks.stages.predicates import (
    BoxRegion,
    CylinderRegion,
    backs,
    hinge_open,
    raised,
    still,
    upright,
)
from duobench.world.looks.catalog import look
from duobench.world.objects.blocks import RED, block, cube
from duobench.world.objects.prop import Hinge, Part, Prop, Variant
from duobench.world.objects.shapes import box, hull
from duobench.world.objects.solid import Solid
from duobench.world.scene.compose import compose

WORDS = Path(__file__).with_name("errors.json")
TASK = catalog.get("bin_sort")
BLOCK = cube(RED)


def env(**options: Any) -> Any:
    return duobench.make("bin_sort", **{"cameras": False, **options})


def step(action: Any, **options: Any) -> None:
    played = env(**options)
    played.reset(seed=0)
    played.step(action)


def reset(**options: Any) -> None:
    env().reset(options=options)


def task(**changes: Any) -> Task:
    return replace(TASK, **changes)


def place(**changes: Any) -> Placement:
    return replace(TASK.placements["white_cube"], **changes)


def begun(name: str) -> Path:
    """A file with what nobody can read."""
    path = Path(tempfile.mkdtemp()) / name
    path.write_text('{"schema": 999}')
    return path


def composed(**changes: Any) -> None:
    compose([Prop(name="chest", solid=BLOCK, **changes)])


Trigger = Callable[[], object]
TRIGGERS: Mapping[str, Trigger] = {
    "task: misspelt": lambda: catalog.get("bin-sort"),
    "task: misspelt id of an environment": lambda: catalog.get("duobench/bin-sort-v1"),
    "task: version of an environment": lambda: catalog.get("duobench/bin_sort-v2"),
    "task: module that is not there": lambda: catalog.get("no_such_module:TASK"),
    "task: attribute that is not there": lambda: catalog.get("duobench.tasks.bin_sort:TSAK"),
    "task: package that is not there": lambda: catalog.get("no_such.module:TASK"),
    "task: attribute that is no task": lambda: catalog.get("duobench.tasks.bin_sort:COLOURS"),
    "task: module without tasks": lambda: catalog.get("json:TASK"),
    "task: no attribute": lambda: catalog.get(":TASK"),
    "task: placement of no prop": lambda: task(
        placements={"white_cub": TASK.placements["white_cube"]}
    ),
    "task: no stages": lambda: task(stages=()),
    "task: title that cannot be written": lambda: task(title="w\udcff"),
    "task: instruction that cannot be written": lambda: task(instruction="w\udcff"),
    "task: stage that cannot be written": lambda: task(
        stages=(replace(TASK.stages[0], name="w\udcff"),)
    ),
    "task: instruction with a brace": lambda: task(instruction="Put {"),
    "task: instruction without a name": lambda: task(kept_paraphrases=("Put {}",)),
    "task: instruction of a stage": lambda: task(
        stages=(replace(TASK.stages[0], instruction="Put {0}"),)
    ),
    "task: horizon": lambda: task(horizon=1.5),
    "task: stage of a function": lambda: replace(TASK.stages[0], holds=lambda _: True),
    "task: stays without a predicate": lambda: replace(TASK.stages[0], stays=True),
    "task: predicates with and": lambda: still("cube") and still("base"),
    "task: time of nothing": lambda: held_for(still("cube"), 0),
    "task: time that is no number": lambda: held_for(still("cube"), math.nan),
    "task: choice of nothing": lambda: Choice(()),
    "task: arrange without a layout": lambda: next(task(arrange=lambda _: None).layouts(0)),
    "task: prop with a name of the scene": lambda: compose([Prop(name="table", solid=BLOCK)]),
    "task: two parts of one name": lambda: composed(parts=(Part(name="lid", solid=BLOCK),) * 2),
    "task: variant without a shape": lambda: composed(
        variants={"open": Variant(without_shapes=frozenset({7}))}
    ),
    "task: variant without an image": lambda: composed(
        variants={"open": Variant(without_images=frozenset({1}))}
    ),
    "task: colour without opacity": lambda: cube((1, 0, 0)),  # pyright: ignore[reportArgumentType]
    "task: colour of 255": lambda: box(1, 1, 1, rgba=(255, 0, 0, 255)),
    "task: size": lambda: block(0.1, 0.0, 0.1, RED),
    "task: size in millimetres": lambda: block(80, 80, 40, RED),
    "task: hull in millimetres": lambda: hull([(0, 0, 0), (80, 0, 0)]),
    "task: shape that is no solid": lambda: Prop(name="cup", solid=box(0.1, 0.1, 0.1)),  # pyright: ignore[reportArgumentType]
    "task: function of a shape": lambda: Prop(name="cup", solid=lambda: box(0.1, 0.1, 0.1)).solid,  # pyright: ignore[reportArgumentType]
    "task: solid of one shape": lambda: Solid(shapes=box(0.1, 0.1, 0.1), rgba=RED),  # pyright: ignore[reportArgumentType]
    "task: placement of numbers": lambda: Placement(x=0.5, y=around(0, 0.1)),  # pyright: ignore[reportArgumentType]
    "task: placement of pairs": lambda: Placement(x=around(0.5, 0.1), y=(0.1, 0.2)),  # pyright: ignore[reportArgumentType]
    "task: placement in millimetres": lambda: Placement(x=around(500, 100), y=around(0, 100)),
    "task: height that is a range": lambda: place(z=around(0, 0.1)),
    "task: yaw in degrees": lambda: place(yaw=around(0, 90)),
    "task: height in millimetres": lambda: raised("cube", 50),
    "task: gap in millimetres": lambda: low_over("cube", "base", 20),
    "task: region in millimetres": lambda: BoxRegion(
        body="base", low=(-40, -40, 0), high=(40, 40, math.inf)
    ),
    "task: round region in millimetres": lambda: CylinderRegion(
        body="base", radius=40, low=0, high=math.inf
    ),
    "task: distance in millimetres": lambda: backs(Side.LEFT, "chest/lid", 30),
    "task: tilt in degrees": lambda: upright("cup", 10),
    "task: angle in degrees": lambda: hinge_open("chest/lid", 45),
    "task: one prop alone": lambda: task(props=Prop(name="cube", solid=BLOCK)),
    "task: place that is no placement": lambda: task(placements={"white_cube": (0.5, 0.2)}),
    "task: placements without names": lambda: task(placements=[place()]),
    "task: tilt without end": lambda: upright("cup", math.inf),
    "task: place without end": lambda: place(x=Uniform(-math.inf, math.inf)),
    "task: solid that makes a function": lambda: Prop(name="cube", solid=lambda: lambda: 0).solid,
    "task: two props of one name": lambda: task(props=(*TASK.props, TASK.props[0])),
    "task: hinge in degrees": lambda: Hinge(axis=(0, 0, 1), limits=(0, 90)),
    "task: accepts no layout": lambda: next(task(accept=lambda _: False).layouts(0)),
    "expert: none": lambda: find_script(task(id="my_sort", expert=None)),
    "expert: module that is not there": lambda: find_script(
        task(id="my_sort", expert="nowhere:script")
    ),
    "expert: misspelt script": lambda: find_script(
        task(id="my_sort", expert="duobench.tasks.experts.scripts.bin_sort:scrpt")
    ),
    "expert: variety": lambda: PolicyChoice.parse("expert:hmuan"),
    "environment: option": lambda: env(acton_mode="joint"),
    "environment: action mode": lambda: env(action_mode="joints"),
    "environment: look": lambda: env(look="dark_woood"),
    "environment: camera": lambda: env(cameras=("haed",)),
    "environment: image size": lambda: env(cameras=True, image_size=(0, 224)),
    "environment: horizon": lambda: env(horizon=0),
    "environment: chunk": lambda: env(chunk=0),
    "environment: split": lambda: env(split="test"),
    "environment: rate": lambda: EnvConfig(control_rate_hz=20.0),
    "environment: step before reset": lambda: env().step(np.zeros(16, np.float32)),
    "action: shape": lambda: step(np.zeros(14, np.float32)),
    "action: not finite": lambda: step(np.full(16, np.nan, np.float32)),
    "action: quaternion": lambda: step(np.zeros(16, np.float32), action_mode="cartesian"),
    "reset: option": lambda: reset(layuot={}),
    "reset: seed": lambda: reset(seed=3),
    "reset: layout of another task": lambda: reset(layout={"poses": {}, "variants": {}}),
    "policy: misspelt": lambda: make_policy("rnadom"),
    "policy: misspelt expert": lambda: PolicyChoice.parse("exprt"),
    "policy: module that is not there": lambda: make_policy("no_such_module:POLICY"),
    "look: misspelt": lambda: look("dark_woood"),
    "shift: misspelt": lambda: shift.Shift.parse("camrea-3"),
    "shift: level": lambda: shift.Shift.parse("camera-9"),
    "transform: quaternion": lambda: SE3.from_wxyz((0, 0, 0, 0), (0, 0, 0)),
    "data: cameras of an export": lambda: ExportOptions(cameras=("haed",)),
    "export: look misspelt": lambda: ExportOptions(look="random_per_episod"),
    "export: part of a state that is not known": lambda: ExportOptions(
        state=("tcp_poses",)  # pyright: ignore[reportArgumentType]
    ),
    "rig: file that is not there": lambda: Rig.read(Path("nowhere.json")),
    "rig: file that is none": lambda: Rig.read(begun("rig.json")),
}


def words(trigger: Trigger) -> str:
    """The class and the words of the error, without folders of this machine."""
    try:
        trigger()
    except Exception as error:  # noqa: BLE001 - which one it is, is what is compared
        return re.sub(r"/[^ ]*/(?=rig.json)", "", f"{type(error).__name__}: {error}")
    return "nothing was raised"


def found() -> dict[str, str]:
    return {name: words(trigger) for name, trigger in TRIGGERS.items()}


if __name__ == "__main__":
    WORDS.write_text(json.dumps(found(), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
