"""The simulated arms behind the interface of real ones, and their slower limits."""

import numpy as np
import pytest

import duobench
from duobench.core.errors import OptionError
from duobench.core.types import CONTROL_HZ, DuoCommand
from duobench.envs import EnvConfig, base_of
from duobench.envs.protocol import make_env
from duobench.world.robot.frames import ROBOT
from duobench.world.robot.joints import JOINT_RANGES, VELOCITY_LIMITS
from duobench.world.sim.backend import SimBackend
from duobench.world.sim.simulation import Simulation

AWAY = DuoCommand(joints=ROBOT.home_command.joints + 0.05, openings=np.full(2, 0.5))


@pytest.fixture
def backend() -> SimBackend:
    return SimBackend(Simulation())


def test_held_arms_stay_until_they_are_brought_home(backend: SimBackend) -> None:
    backend.start()
    assert (backend.health(), backend.image_ages()) == (None, {}), "nothing breaks or grows old"
    assert backend.command(AWAY) is AWAY
    backend.hold("first")
    backend.hold("second")
    assert backend.held == "first"
    sent = backend.command(ROBOT.home_command)
    assert sent.flat == pytest.approx(AWAY.flat)
    assert backend.last_command.flat == pytest.approx(AWAY.flat)
    backend.home()
    assert (backend.held, backend.time) == (None, 0.0)
    assert backend.last_command.flat == pytest.approx(ROBOT.home_command.flat)
    state = backend.read()
    assert state.joints == pytest.approx(ROBOT.home_command.joints)
    assert state.openings == pytest.approx(1.0)
    assert backend.command(AWAY) is AWAY


def sent_in(env: duobench.envs.DuoWrapper, action: np.ndarray, steps: int) -> np.ndarray:
    env.reset(seed=0)
    start = base_of(env).backend.last_command.flat
    return np.array([start, *(env.step(action)[-1]["sent"] for _ in range(steps))])


def far() -> np.ndarray:
    """The far ends of all joints' ranges, with closed grippers."""
    return DuoCommand(joints=JOINT_RANGES.T[::-1], openings=np.zeros(2)).flat


@pytest.mark.parametrize("fraction", [0.4, 0.5])
def test_arms_move_no_faster_than_a_rig_lets_them_and_keep_away_from_the_ends_of_their_ranges(
    fraction: float,
) -> None:
    env = make_env("bin_sort", cameras=False, speed_fraction=fraction)
    assert env.get_wrapper_attr("config").speed_fraction == fraction
    sent = sent_in(env, far(), 5).reshape(-1, 2, 8)[:, :, :7]
    changes = np.abs(np.diff(sent, axis=0))
    most = fraction * np.array(VELOCITY_LIMITS) / CONTROL_HZ
    assert changes == pytest.approx(np.broadcast_to(most, changes.shape))
    turned = DuoCommand.from_flat(ROBOT.home_command.flat)
    turned.joints[:, -1] = [9.0, -9.0]  # all joints together would meet each other
    sent = sent_in(env, turned.flat, round(60 / fraction)).reshape(-1, 2, 8)[-1, :, 6]
    assert sent == pytest.approx(JOINT_RANGES[-1, ::-1] + np.array([-0.05, 0.05]))
    env.close()


def test_what_was_clipped_is_said_and_spaces_stay_as_they_are() -> None:
    plain = make_env("bin_sort", cameras=False)
    slow = make_env("bin_sort", cameras=False, speed_fraction=0.25)
    assert slow.action_space == plain.action_space
    assert slow.observation_space == plain.observation_space
    slow.reset(seed=0)
    action = base_of(slow).backend.last_command.flat
    action[0] += 0.05
    *_, info = slow.step(action)
    assert info["clipped"].nonzero()[0].tolist() == [0]
    plain.reset(seed=0)
    assert not plain.step(action)[-1]["clipped"].any()
    for env in (plain, slow):
        env.close()


@pytest.mark.parametrize("wrong", [0.0, -1.0, 1.5, float("nan"), "fast"])
def test_what_is_no_part_of_the_limits_is_refused(wrong: object) -> None:
    with pytest.raises(OptionError, match="speed_fraction"):
        EnvConfig(speed_fraction=wrong)  # type: ignore[arg-type]
