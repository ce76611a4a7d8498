"""Rigs of simulated devices on a virtual clock."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Any, cast

import numpy as np
import pytest

from duobench.core.errors import BackendError
from duobench.core.types import CONTROL_HZ, SIDES, Array, DuoCommand, Side
from duobench.envs.protocol import make_env
from duobench.evaluation import rollout
from duobench.evaluation.policies import ExpertPolicy
from duobench.real.clock import VirtualClock
from duobench.real.duo import FrankaDuo
from duobench.real.opening import open_rig, rehearsal_rig
from duobench.real.rig import Rig
from duobench.real.supervisor import State
from duobench.world.robot.mounts import HOME_JOINTS
from duobench.world.sim.layout import Layout
from tests.real.simulated import SimulatedArm, SimulatedCamera, SimulatedGripper, simulated_rig

PERIOD = 1.0 / CONTROL_HZ


def new_rig(rig: Rig | None = None, *, guard: bool = False) -> FrankaDuo:
    """A simulated rig that is not started, or another one."""
    return open_rig(rig or simulated_rig(), VirtualClock(), guard=guard)


def quick_rig(*, cameras: bool = False, **changes: Any) -> Rig:
    """The rehearsal, whose arms go home as fast as they may; changes are fields of its arms."""
    rig = rehearsal_rig()
    arms = {
        side: replace(arm, **{"home_fraction": arm.speed_fraction} | changes)
        for side, arm in rig.arms.items()
    }
    return replace(rig, arms=arms, cameras=rig.cameras if cameras else {})


def confirmed(duo: FrankaDuo) -> FrankaDuo:
    """A rig that is started and may move."""
    duo.start()
    duo.supervisor.confirm()
    return duo


def ready_rig(rig: Rig | None = None, *, guard: bool = False) -> FrankaDuo:
    """A simulated rig at home that waits for the first command."""
    duo = confirmed(new_rig(rig, guard=guard))
    duo.home()
    return duo


def home(duo: FrankaDuo, **options: bool) -> None:
    """Confirm and go home, as an operator does after each stop."""
    duo.supervisor.confirm()
    duo.home(**options)


def refused(move: Callable[[], object]) -> str:
    """The words in which something is refused."""
    with pytest.raises(BackendError) as error:
        move()
    return str(error.value)


def arm(duo: FrankaDuo, side: Side) -> SimulatedArm:
    return cast("SimulatedArm", duo.arms[side])


def gripper(duo: FrankaDuo, side: Side) -> SimulatedGripper:
    return cast("SimulatedGripper", duo.grippers[side])


def camera(duo: FrankaDuo, name: str) -> SimulatedCamera:
    return cast("SimulatedCamera", duo.cameras[name])


def shifted(change: float) -> DuoCommand:
    """Home with the first joint of both arms elsewhere."""
    joints = HOME_JOINTS.copy()
    joints[:, 0] += change
    return DuoCommand(joints=joints, openings=np.ones(2))


def move_on(duo: FrankaDuo, steps: int = 15) -> None:
    """Move the first joint of both arms from home, by 0.9 rad/s."""
    for number in range(1, steps + 1):
        duo.command(shifted(0.03 * number))


def put(duo: FrankaDuo, joints: Array) -> None:
    """Put both arms elsewhere (2, 7), as a person does who leads them by hand."""
    for side in SIDES:
        arm(duo, side).put(joints[side.index])


def once_while_homing(duo: FrankaDuo, act: Callable[[], object]) -> None:
    """Do something once while the arms go home the next time."""
    left = [act]

    def look() -> None:
        if left and duo.supervisor.state is State.HOMING:
            left.pop()()

    duo.watch_person(look)


def is_tracking(duo: FrankaDuo) -> list[bool]:
    return [reading.is_tracking for reading in duo.readings().values()]


class Log:
    """Everything that an arm is told from now on."""

    def __init__(self, duo: FrankaDuo, side: Side = Side.LEFT) -> None:
        self.joints: list[Array] = []
        self.velocities: list[Array] = []
        told = arm(duo, side)
        tell = told.command

        def command(joints: Array, velocities: Array) -> None:
            self.joints.append(joints)
            self.velocities.append(velocities)
            tell(joints, velocities)

        told.command = command  # type: ignore[method-assign]


class Steps:
    """Keeps all steps of an episode."""

    def on_episode_start(self, _env: Any, _observation: Any, info: Any) -> None:
        self.info, self.steps = info, []

    def on_step(self, step: Any) -> None:
        self.steps.append(step)

    def on_episode_end(self, error: BaseException | None) -> None:
        self.error = error


def shown(task: str, seeds: Iterable[int] = (0,)) -> Iterator[tuple[Array, Layout]]:
    """Commands (n, 16) of an expert in simulated episodes, and their layouts."""
    env = make_env(task, cameras=False)
    for seed in seeds:
        watcher: Any = Steps()
        rollout(env, ExpertPolicy(env), seed=seed, watchers=[watcher])
        commands = np.array([step.info["sent"] for step in watcher.steps])
        yield commands, Layout.from_json(watcher.info["layout"])
    env.close()


def half_tempo(task: str) -> tuple[list[Array], Layout]:
    """Commands of an expert in its first episode, the middles between them, and its layout."""
    ((commands, layout),) = shown(task)
    assert len(commands) > 50
    return [each for one, two in pairwise(commands) for each in ((one + two) / 2.0, two)], layout


def wait(duo: FrankaDuo, seconds: float) -> None:
    """Let time pass in which nobody sends commands."""
    duo.clock.wait_until(duo.clock.now() + seconds)


def joints(duo: FrankaDuo) -> Array:
    """Where both arms are at this moment (2, 7)."""
    return np.array([reading.joints for reading in duo.readings().values()])


def speeds(duo: FrankaDuo) -> Array:
    """How fast both arms are at this moment (2, 7)."""
    return np.array([reading.velocities for reading in duo.readings().values()])
