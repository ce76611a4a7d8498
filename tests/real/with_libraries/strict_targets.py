"""Plays random targets on both arms of franka-sim through an environment; run as a program.

`python -m tests.real.with_libraries.strict_targets COUNT SPEED ACCELERATION` sends that many
targets, thirty a second, with the limits of a rig. At the end it prints what it saw as JSON. After
a fault it recovers the arms, goes home and goes on. A fourth word, `guard`, keeps the targets near
home and has the guard look at each.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, field
from itertools import islice

import numpy as np

from duobench.core.errors import BackendError
from duobench.core.types import DuoCommand
from duobench.envs.duo_env import DuoWrapper
from duobench.real.duo import FrankaDuo
from duobench.real.env import make_real_env
from duobench.real.opening import open_rig
from duobench.world.robot.joints import VELOCITY_LIMITS
from duobench.world.robot.mounts import HOME_JOINTS
from tests.real.programs import say
from tests.real.with_libraries.arms import become_realtime
from tests.real.with_libraries.leading import franky_rig, recover

GUARDED = 0.3
"""How far from home in radians targets are that the guard looks at."""


@dataclass(kw_only=True)
class Seen:
    """What happened, for whoever reads the program's output."""

    targets: int = 0
    faults: list[tuple[str, str]] = field(default_factory=list)
    """Kind and text of each."""
    fastest: list[float] = field(default_factory=lambda: [0.0, 0.0])
    """Largest measured speed of a joint, as a part of its limit, left then right."""
    success_rate: list[float] = field(default_factory=lambda: [1.0, 1.0])
    """Smallest part of an arm's last 100 control commands that came in time."""
    late_s: float = 0.0
    """Longest time that a target came too late."""
    seconds: float = 0.0
    is_realtime: bool = False


def targets(is_near: bool) -> Iterator[DuoCommand]:
    """Random targets for both arms: half a second near home, or for moments at the range's ends."""
    rng, goal, number = np.random.default_rng(0), HOME_JOINTS, 0
    while True:
        if number % 15 == 0:
            reach = GUARDED if is_near else 0.6
            goal = HOME_JOINTS + rng.uniform(-reach, reach, (2, 7))
        if not is_near and rng.random() < 0.1:
            goal = HOME_JOINTS + rng.uniform(-3.0, 3.0, (2, 7))
        number += 1
        yield DuoCommand(joints=goal, openings=np.ones(2))


def note(seen: Seen, duo: FrankaDuo, late_s: float) -> None:
    seen.targets += 1
    seen.late_s = max(seen.late_s, late_s)
    speeds = np.abs(duo.joint_velocities() / np.array(VELOCITY_LIMITS)).max(axis=1)
    for number, reading in enumerate(duo.readings().values()):
        seen.fastest[number] = max(seen.fastest[number], float(speeds[number]))
        if reading.is_tracking:
            rate = float(reading.state["control_command_success_rate"][0])
            seen.success_rate[number] = min(seen.success_rate[number], rate)


def episode(env: DuoWrapper, duo: FrankaDuo, ways: Iterable[DuoCommand], seen: Seen) -> None:
    """Play targets until none is left or a fault ends the episode."""
    env.reset(seed=0)
    for command in ways:
        *_, is_over, info = env.step(command.flat)
        note(seen, duo, info["late_s"])
        if is_over:
            return


def play(env: DuoWrapper, duo: FrankaDuo, ways: Iterator[DuoCommand], count: int) -> Seen:
    """Play a number of targets, whatever happens on the way."""
    seen = Seen()
    while seen.targets < count:
        try:
            episode(env, duo, islice(ways, count - seen.targets), seen)
        except BackendError:
            if not duo.held:  # not a fault on the way home
                raise
        if duo.held:
            kind = "" if duo.fault is None else str(duo.fault.kind)
            seen.faults.append((kind, duo.held))
            recover(duo)
    return seen


def main() -> None:
    count, speed, acceleration = int(sys.argv[1]), float(sys.argv[2]), float(sys.argv[3])
    has_guard, is_realtime = sys.argv[4:] == ["guard"], become_realtime(15)
    duo = open_rig(franky_rig(speed_fraction=speed, acceleration=acceleration), guard=has_guard)
    env = make_real_env(duo, "bin_sort", horizon=count, cameras=False)
    begun = time.monotonic()
    duo.supervisor.confirm()
    seen = play(env, duo, targets(has_guard), count)
    seen.seconds, seen.is_realtime = time.monotonic() - begun, is_realtime
    env.close()
    say(json.dumps(asdict(seen)))


if __name__ == "__main__":
    main()
