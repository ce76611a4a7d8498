"""How many control steps MuJoCo Warp makes, stages judged; it has to be installed."""

from __future__ import annotations

import time
from collections.abc import Iterator
from importlib import import_module

import numpy as np

import duobench
from dev.benchmarks.environments import expert_actions
from dev.benchmarks.measure import Measurement

ON_CARD, ON_PROCESSOR = 8192, 8
"""Episodes side by side."""
UNTIMED, STEPS = 2, 10
"""Steps that compile and capture, and those that are timed."""
SPEED = 50_000
"""Bar of control steps a second on a graphics card."""
SPEEDS = {"pour_marbles": 8_000}
"""Bars of tasks with larger models."""
START = {"layout_seed": 0}


def measure(name: str) -> Iterator[Measurement]:
    """Measure episodes at all phases of an expert's, so that the mean of its contacts is there."""
    env = duobench.make(name, cameras=False)
    actions = expert_actions(env)
    env.reset(options=START)
    states = []
    for action in actions:
        states.append(env.get_wrapper_attr("save_state")())
        env.step(action)
    env.close()
    is_card = bool(import_module("warp").get_device().is_cuda)
    count = ON_CARD if is_card else ON_PROCESSOR
    phases = np.arange(count) * (len(states) - UNTIMED - STEPS) // count
    vector = duobench.make_vec(name, count, engine="warp")
    vector.reset(options={"states": [states[phase] for phase in phases]})
    for number in range(UNTIMED):
        vector.step(actions[phases + number])
    begin = time.perf_counter()
    for number in range(UNTIMED, UNTIMED + STEPS):
        vector.step(actions[phases + number])
    taken = time.perf_counter() - begin
    vector.close()
    yield Measurement(
        what=f"{name}: control steps on Warp, {count} at once, judged",
        value=count * STEPS / taken,
        unit="/s",
        at_least=SPEEDS.get(name, SPEED) if is_card else None,
    )
