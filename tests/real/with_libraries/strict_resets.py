"""Resets an environment on both arms of franka-sim in full motion; run as a program.

`python -m tests.real.with_libraries.strict_resets COUNT` leads both arms with violent targets
for a second, as fast as a rig may ask for, resets, and begins again. At the end it prints what it
saw as JSON.
"""

from __future__ import annotations

import json
import sys
import time
from dataclasses import asdict, dataclass, field

import numpy as np

from duobench.core.errors import BackendError
from duobench.core.types import Array, DuoCommand
from duobench.real.duo import FrankaDuo
from duobench.real.env import make_real_env
from duobench.real.follower import MAX_STEP_S, Follower
from duobench.real.opening import open_rig
from duobench.real.rig import MAX_ACCELERATION, MAX_SPEED_FRACTION
from duobench.world.robot.joints import VELOCITY_LIMITS
from duobench.world.robot.mounts import HOME_JOINTS
from tests.real.programs import say
from tests.real.with_libraries.arms import become_realtime
from tests.real.with_libraries.leading import franky_rig, recover

HOME_FRACTION = 0.25
STEPS = 30
"""Control steps before each reset."""


@dataclass(kw_only=True)
class Seen:
    """What happened, for whoever reads the program's output."""

    resets: int = 0
    in_motion: int = 0
    """Resets that began while a reference moved by more than half a rad/s."""
    faults: list[tuple[str, str]] = field(default_factory=list)
    acceleration: float = 0.0
    """Largest of a reference in rad/s², over all calls."""
    fastest: float = 0.0
    """Largest speed of a reference, as a part of its joint's limit."""
    seconds: float = 0.0


class Noted:
    """A follower whose every call is looked at."""

    def __init__(self, follower: Follower, seen: Seen) -> None:
        self._advance, self._follower, self._seen = follower.advance, follower, seen
        follower.advance = self.advance  # type: ignore[method-assign]

    def advance(self, dt: float) -> tuple[Array, Array]:
        before = self._follower.velocity
        joints, velocity = self._advance(dt)
        if (took := min(max(dt, 0.0), MAX_STEP_S)) > 0.0:
            most = float(np.abs(velocity - before).max()) / took
            self._seen.acceleration = max(self._seen.acceleration, most)
        share = float(np.abs(velocity / VELOCITY_LIMITS).max())
        self._seen.fastest = max(self._seen.fastest, share)
        return joints, velocity


def play(duo: FrankaDuo, count: int, seen: Seen) -> None:
    env = make_real_env(duo, "bin_sort", horizon=10 * STEPS, cameras=False)
    rng = np.random.default_rng(0)
    followers = [each.follower for each in duo._controller.streamers.values()]
    for follower in followers:
        Noted(follower, seen)
    env.reset(seed=0)
    while seen.resets < count:
        goal = HOME_JOINTS
        for step in range(STEPS):
            if step % 10 == 0:
                goal = HOME_JOINTS + rng.uniform(-0.6, 0.6, (2, 7))
            *_, is_over, _ = env.step(DuoCommand(joints=goal, openings=np.ones(2)).flat)
            if is_over:
                break
        speed = max(float(np.abs(follower.velocity).max()) for follower in followers)
        try:
            env.reset(seed=0)
        except BackendError:
            if not duo.held:
                raise
        if duo.held:
            kind = "" if duo.fault is None else str(duo.fault.kind)
            seen.faults.append((kind, duo.held))
            recover(duo)
            env.reset(seed=0)
            continue
        seen.resets += 1
        seen.in_motion += speed > 0.5
    env.close()


def main() -> None:
    become_realtime(15)
    limits = {"speed_fraction": MAX_SPEED_FRACTION, "acceleration": MAX_ACCELERATION}
    duo = open_rig(franky_rig(**limits, home_fraction=HOME_FRACTION), guard=False)
    seen, begun = Seen(), time.monotonic()
    duo.start()
    duo.supervisor.confirm()
    play(duo, int(sys.argv[1]), seen)
    seen.seconds = time.monotonic() - begun
    say(json.dumps(asdict(seen)))


if __name__ == "__main__":
    main()
