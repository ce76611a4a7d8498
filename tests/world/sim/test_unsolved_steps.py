"""Steps that the engine's sparse solver cannot solve, and what is done instead."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from duobench.core.types import DuoCommand
from duobench.tasks import catalog
from duobench.world.sim import simulation
from duobench.world.sim.simulation import Simulation

JERKED_CUP = Path(__file__).with_name("jerked_cup.npz")
"""A state of `pour_marbles` and the flat command (16,) after which the engine diverged: a cup full
of marbles in a hand that shakes."""
with np.load(JERKED_CUP) as kept:
    STATE, COMMAND = kept["state"], DuoCommand.from_flat(kept["command"])


@pytest.fixture(scope="module")
def shared() -> Simulation:
    task = catalog.get("pour_marbles")
    return Simulation(task.props, task.overview)


@pytest.fixture
def jerked(shared: Simulation) -> Simulation:
    shared.set_state(STATE)
    return shared


def fastest(sim: Simulation) -> float:
    return float(np.abs(sim.data.qvel).max())


def test_no_marble_is_fired(jerked: Simulation) -> None:
    assert fastest(jerked) < 20
    for _ in range(10):
        jerked.step(COMMAND)
        assert fastest(jerked) < 50


def test_the_engine_alone_fires_one(jerked: Simulation, monkeypatch: pytest.MonkeyPatch) -> None:
    """If this fails, the engine is mended, and what repeats a step can go."""
    monkeypatch.setattr(simulation, "SOLVED", np.inf)
    jerked.step(COMMAND)
    assert fastest(jerked) > 1000


def test_what_was_repeated_goes_on_as_from_its_saved_state(jerked: Simulation) -> None:
    jerked.step(COMMAND)
    starts = [(jerked.get_state(), 3)] * 2 + [(STATE, 4)]
    ends = set()
    for state, steps in starts:
        jerked.set_state(state)
        for _ in range(steps):
            jerked.step(COMMAND)
        ends.add(jerked.get_state().tobytes())
    assert len(ends) == 1
    assert jerked.model.opt.jacobian == mujoco.mjtJacobian.mjJAC_AUTO
