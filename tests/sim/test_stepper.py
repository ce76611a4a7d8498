"""Steps that the engine's sparse solver cannot solve, and what is done instead."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from duobench.sim import physics
from duobench.sim.simulation import Simulation
from duobench.tasks import catalog
from duobench.types import Array, DuoCommand

JERKED_CUP = Path(__file__).with_name("jerked_cup.npz")
"""A state of `pour_marbles` and the flat command (16,) after which the engine diverged: a cup full
of marbles in a hand that shakes."""


@pytest.fixture(scope="module")
def shared() -> Simulation:
    task = catalog.get("pour_marbles")
    return Simulation(task.props, task.overview)


@pytest.fixture
def jerked(shared: Simulation) -> tuple[Simulation, DuoCommand]:
    return shared, jerk(shared)


def jerk(simulation: Simulation) -> DuoCommand:
    with np.load(JERKED_CUP) as kept:
        simulation.set_state(kept["state"])
        return DuoCommand.from_flat(kept["command"])


def fastest(simulation: Simulation) -> float:
    return float(np.abs(simulation.data.qvel).max())


def test_no_marble_is_fired(jerked: tuple[Simulation, DuoCommand]) -> None:
    simulation, command = jerked
    assert fastest(simulation) < 20
    for _ in range(10):
        simulation.step(command)
        assert fastest(simulation) < 50


def test_the_engine_alone_fires_one(
    jerked: tuple[Simulation, DuoCommand], monkeypatch: pytest.MonkeyPatch
) -> None:
    """If this fails, the engine is mended, and the stepper can go."""
    simulation, command = jerked
    monkeypatch.setattr(physics, "SOLVED", np.inf)
    simulation.step(command)
    assert fastest(simulation) > 1000


def test_what_was_repeated_goes_on_as_from_its_saved_state(
    jerked: tuple[Simulation, DuoCommand],
) -> None:
    simulation, command = jerked
    simulation.step(command)
    saved = simulation.get_state()
    states = []
    for _ in range(2):
        simulation.set_state(saved)
        states.append(after(simulation, command))
    jerk(simulation)
    simulation.step(command)
    states.append(after(simulation, command))
    assert states[0].tobytes() == states[1].tobytes() == states[2].tobytes()
    assert simulation.model.opt.jacobian == mujoco.mjtJacobian.mjJAC_AUTO


def after(simulation: Simulation, command: DuoCommand) -> Array:
    for _ in range(3):
        simulation.step(command)
    return simulation.get_state()
