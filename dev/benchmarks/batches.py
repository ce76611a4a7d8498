"""What many episodes side by side cost: judging them, and stepping them on several threads."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import duobench
from dev.benchmarks.environments import expert_actions
from dev.benchmarks.measure import Measurement
from duobench.envs.sim_env import sim_of

JUDGED = 1024
"""Episodes that are judged at once."""
MICROSECONDS = 6.0
MANY = 12.0
OF_MANY = ("hinge_chest", "spring_door", "pour_marbles", "join_blocks", "bin_sort")
"""Bars of a judgement in microseconds, and the tasks whose stages ask the most."""
"""Control steps apart in an expert's episode at which all are judged."""
EPISODES = 16
"""Episodes that are stepped side by side."""
THREADS = (1, 2)
OF_BARE, OF_PROCESSES = 0.85, 1.4


def measure_judging(name: str, repeats: int = 5) -> Iterator[Measurement]:
    """Measure a judgement of many episodes along an expert's, and copying contacts, apart."""
    env = duobench.make(name, cameras=False)
    actions = expert_actions(env)
    env.reset(seed=0)
    sim = sim_of(env).simulation
    variants, states = sim.variants, [sim.get_state()]
    for action in actions:
        env.step(action)
        states.append(sim.get_state())
    vector = _made(name, JUDGED, 1)
    simulations, judge = vector.simulations, vector.judge
    vector.reset(options={"layout_seed": 0})
    everywhere, numbers = np.ones(JUDGED, dtype=bool), np.arange(JUDGED)
    # Every episode is a little later than the one before it, all along the expert's.
    judged, copied = [], []
    for offset in np.linspace(0, len(states) - 1, repeats, dtype=int):
        at = (offset + numbers) % len(states)
        simulations.load(numbers, [variants] * JUDGED, [states[n] for n in at])
        for times, work in (
            (copied, lambda: simulations.copy_contacts(numbers)),
            (judged, lambda: judge.update(everywhere)),
        ):
            times.append(min(_taken(work) for _ in range(3)))
    yield Measurement(
        what=f"{name}: a judgement of {JUDGED}",
        value=float(np.mean(judged)) / JUDGED * 1e6,
        unit="us",
        at_most=MANY if name in OF_MANY else MICROSECONDS,
    )
    yield Measurement(
        what=f"{name}: copying contacts", value=float(np.mean(copied)) / JUDGED * 1e6, unit="us"
    )
    env.close()
    vector.close()
