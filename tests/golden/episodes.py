"""The golden episodes: what the experts do on two seeds of every task, on any machine.

Processors differ in the last bit of a sum, and contact amplifies it. So the file holds the stages
by control step, which must be met exactly, and states over the first second only, which must be
met within a tolerance; afterwards a grasp has begun.

Renew it with `make golden`. That is allowed only together with a new `SUITE_VERSION` in
`duobench.randomness`: whoever compares scores must be able to see that the episodes are others.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from duobench.experts.registry import find_script
from duobench.randomness import SUITE_VERSION
from duobench.tasks import catalog
from tests.stageplay import Stageplay

PATH = Path(__file__).with_name("episodes.json")
SEEDS = (0, 1)
CHECKPOINTS = (10, 20, 30)
"""Control steps at which states are kept: a third, two thirds and one second."""
TOLERANCE = 1e-5
"""Largest difference of a joint (radians) or a position (metres) between two machines."""
DIGITS = 8


def play(name: str, seeds: tuple[int, ...] = SEEDS) -> dict[str, Any]:
    """Expert episodes of one task, by seed."""
    stageplay = Stageplay(catalog.get(name))
    return {str(seed): _episode(stageplay, seed) for seed in seeds}


def _episode(stageplay: Stageplay, seed: int) -> dict[str, Any]:
    task = stageplay.task
    stageplay.start(seed)
    running = find_script(task.id)(stageplay.arms)
    states: dict[str, list[float]] = {}
    changes: list[list[int]] = []
    for step in range(1, task.horizon + 1):
        before = stageplay.stage
        next(running, None)
        stageplay.advance()
        if stageplay.stage != before:
            changes.append([step, stageplay.stage])
        if step in CHECKPOINTS:
            states[str(step)] = _state(stageplay)
        if stageplay.progress.success:
            break
    return {"stages": changes, "states": states}


def _state(stageplay: Stageplay) -> list[float]:
    """Proprioception, then the position of every object."""
    sim = stageplay.sim
    numbers = [*sim.duo.read().flat]
    for name in sim.props:
        numbers.extend(sim.position(name))
    return [round(float(number), DIGITS) for number in numbers]


def read() -> dict[str, Any]:
    """The golden file."""
    return json.loads(PATH.read_text(encoding="utf-8"))


def renew() -> None:
    """Play all golden episodes and write the file."""
    tasks = {name: play(name) for name in catalog.names()}
    content = {"suite_version": SUITE_VERSION, "tasks": tasks}
    text = json.dumps(content, indent=None, separators=(",", ":"))
    PATH.write_text(text.replace('"tasks":', '\n"tasks":').replace('},"', '},\n"') + "\n", "utf-8")


if __name__ == "__main__":
    renew()
