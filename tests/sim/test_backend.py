"""The simulated arms behind the interface of real ones."""

import numpy as np
import pytest

from duobench.sim.backend import SimBackend
from duobench.sim.duo import HOME
from duobench.sim.simulation import Simulation
from duobench.types import DuoCommand

AWAY = DuoCommand(joints=HOME.joints + 0.05, openings=np.full(2, 0.5))


@pytest.fixture
def backend() -> SimBackend:
    return SimBackend(Simulation())


def test_held_arms_stay_until_they_are_brought_home(backend: SimBackend) -> None:
    backend.start()
    assert backend.command(AWAY) is AWAY
    backend.hold("first")
    backend.hold("second")
    assert backend.held == "first"
    sent = backend.command(HOME)
    assert sent.flat == pytest.approx(AWAY.flat)
    assert backend.last_command.flat == pytest.approx(AWAY.flat)
    backend.home()
    assert (backend.held, backend.time) == (None, 0.0)
    assert backend.last_command.flat == pytest.approx(HOME.flat)
    state = backend.read()
    assert state.joints == pytest.approx(HOME.joints)
    assert state.openings == pytest.approx(1.0)
    assert backend.command(AWAY) is AWAY


def test_nothing_of_a_simulation_breaks_or_grows_old(backend: SimBackend) -> None:
    assert backend.health() is None
    assert backend.image_ages() == {}
