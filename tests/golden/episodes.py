"""The golden episodes: what the experts do on two seeds of every task, on any machine.

Processors of one architecture give the same bits: there, hashes of the compiled model and of the
states at both ends of each episode must be met exactly. Others differ in the last bit of a sum, and
contact amplifies it. So the file also holds the control steps at which stages are reached, to be
met within a few steps, and states over the first second, before a grasp begins, to be met within a
tolerance; and what the physics is made of, to be met exactly (see `tests.golden.models`).

Renew it with `make golden`, only with a new `SUITE_VERSION` in `duobench.core.randomness`: who
compares scores must see that the episodes are others. So a file of this version is never written
over with other contents.
"""

import json
import platform
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from duobench.core.randomness import SUITE_VERSION
from duobench.tasks import catalog
from tests.golden import models
from tests.tasks.experts.baseline_episodes import SEEDS, Episode, play_alone

PATH = Path(__file__).with_name("episodes.json")
CHECKPOINTS = (10, 20, 30)
"""Control steps at which states are kept: a third, two thirds and one second."""
TOLERANCE = 1e-5
"""Largest difference of a joint (radians) or a position (metres) between two machines."""
STEP_TOLERANCE = 3
"""Largest difference in the control step at which a stage is reached between two machines: a
contact that begins a little sooner or later."""
DIGITS = 8
EXACT = platform.machine().lower() in ("x86_64", "amd64")
"""Whether this is the architecture that the hashes were made on."""
HASHES, COMPILED = "hashes", "compiled"
"""Keys of what is compared on that architecture only: in an episode, and in a model."""
MODEL = "model"
"""Key of what a task's physics is made of; the other keys of a task are seeds."""

MAX_TOLD = 30
"""Differences that a refusal names."""

Content = dict[str, Any]


class NotRenewedError(Exception):
    """The file would be others' under the same suite version."""


def summary(episode: Episode) -> dict[str, Any]:
    stages = [info["stage"] for *_, info in episode.results]
    changes = [
        [step, stages[step]] for step in range(1, len(stages)) if stages[step] != stages[step - 1]
    ]
    states = {
        str(step): [round(float(number), DIGITS) for number in episode.positions[step]]
        for step in CHECKPOINTS
    }
    ends = [state.hash for state in (episode.states[0], episode.states[-1])]
    return {"stages": changes, "states": states, HASHES: ends}


def record(names: Iterable[str]) -> Content:
    """The file's contents for some tasks, as this version of the benchmark has them."""
    tasks: Content = {}
    for name in names:
        played = zip(SEEDS, play_alone(name, *SEEDS), strict=True)
        tasks[name] = {MODEL: models.describe(catalog.get(name).props)}
        tasks[name] |= {str(seed): summary(episode) for seed, episode in played}
    return {"suite_version": SUITE_VERSION, "tasks": tasks}


def read(path: Path = PATH) -> Content:
    return json.loads(path.read_text(encoding="utf-8"))


def differences(golden: Content, content: Content) -> list[str]:
    """What differs beyond the tolerance, one sentence for each difference."""
    return [
        sentence
        for name, old, new in _pairs(golden["tasks"], content["tasks"])
        for sentence in _task_differences(name, old, new)
    ]


def _task_differences(name: str, old: Any, new: Any) -> Iterator[str]:
    for key, one, other in _pairs(old, new):
        if key != MODEL:
            yield from episode_differences(f"{name}, seed {key}", one, other)
            continue
        for part, was, is_now in _pairs(one, other):
            if part == COMPILED and not EXACT:
                continue
            if not (was and is_now):
                yield f"{name}: {part} is {'gone' if was else 'new'}"
                continue
            for quantity, before, after in _pairs(was, is_now):
                if before != after:
                    yield f"{name}: {part}, {quantity}: {before} became {after}"


def episode_differences(episode: str, old: Any, new: Any) -> Iterator[str]:
    for key, before, after in _pairs(old, new):
        if key == HASHES:
            if EXACT and before != after:
                yield f"{episode}: the hashes of the first and last state are others"
            continue
        if key == "stages":
            if not _same_stages(before, after):
                yield f"{episode}: the stages by control step: {before} became {after}"
            continue
        for step, one, other in _pairs(before, after):
            if len(one) != len(other):
                yield f"{episode}, step {step}: {len(one)} numbers became {len(other)}"
            elif (apart := np.abs(np.subtract(one, other)).max()) > TOLERANCE:
                yield f"{episode}, step {step}: a joint or a position is {apart:.2g} away"


def _same_stages(one: list[list[int]], other: list[list[int]]) -> bool:
    """Whether two episodes reach the same last stage, and each stage within the tolerance."""
    first, second = _reached(one), _reached(other)
    return len(first) == len(second) and np.allclose(first, second, rtol=0, atol=STEP_TOLERANCE)


def _reached(changes: list[list[int]]) -> list[int]:
    """The control step at which each stage, 1 to the last, was reached or passed over."""
    steps: list[int] = []
    for step, stage in changes:
        steps.extend([step] * (stage - len(steps)))
    return steps


def _pairs(old: Any, new: Any) -> Iterator[tuple[str, Any, Any]]:
    """Key and both values for every key of either; an empty one stands for a missing one."""
    old, new = old or {}, new or {}
    for key in dict.fromkeys([*old, *new]):
        yield key, old.get(key, ()), new.get(key, ())


def write(content: Content, path: Path = PATH) -> None:
    """Write the file, unless that would change what a suite version means.

    Raises:
        NotRenewedError: The file is of the same suite version and says something else.
    """
    if path.exists():
        golden = read(path)
        same_version = golden["suite_version"] == content["suite_version"]
        if same_version and (found := differences(golden, content)):
            if len(found) > MAX_TOLD:
                found[MAX_TOLD:] = [f"and {len(found) - MAX_TOLD} differences more"]
            raise NotRenewedError(
                f"The golden episodes of suite version {SUITE_VERSION!r} are not these:\n  "
                + "\n  ".join(found)
                + f"\n{path} was left as it is. If the change is meant, raise SUITE_VERSION in "
                "duobench.core.randomness first, so that nobody compares scores of other episodes; "
                "then renew the file again."
            )
    path.write_text(_text(content), encoding="utf-8")


def _text(content: Content) -> str:
    """JSON with a line for each part of a model and for each episode, so that a diff tells much."""
    tasks = []
    for name, task in content["tasks"].items():
        lines = [f'"{part}":{_compact(told)}' for part, told in task[MODEL].items()]
        model = f'"{MODEL}":{{\n' + ",\n".join(lines) + "}"
        played = [f'"{seed}":{_compact(e)}' for seed, e in task.items() if seed != MODEL]
        tasks.append(f'"{name}":{{' + ",\n".join([model, *played]) + "}")
    version = json.dumps(content["suite_version"])
    return f'{{"suite_version":{version},\n"tasks":{{\n' + ",\n".join(tasks) + "}}\n"


def _compact(value: Any) -> str:
    return json.dumps(value, separators=(",", ":"))


if __name__ == "__main__":
    try:
        write(record(catalog.names()))
    except NotRenewedError as refusal:
        sys.exit(str(refusal))
