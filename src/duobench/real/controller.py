"""Both arms and grippers as one thing that is engaged, led and held."""

import threading
from collections.abc import Mapping

from duobench.core.errors import BackendError, DuoBenchError, escaped
from duobench.core.types import (
    SIDES,
    Array,
    DuoCommand,
    Side,
)
from duobench.real.clock import Clock, Ticker
from duobench.real.devices import Arm, Gripper
from duobench.real.follower import Follower
from duobench.real.rig import FOLLOWER_HZ, ArmConfig
from duobench.world.robot.frames import Robot


class ReferenceStreamer:
    """Streams a follower's reference to one arm, five hundred times a second, from its own thread.

    Who uses `follower` holds `lock`.
    """

    def __init__(
        self,
        arm: Arm,
        follower: Follower,
        clock: Clock,
    ) -> None:
        self._arm = arm
        self._clock = clock
        self.follower = follower
        self.lock = threading.RLock()  # a signal may ask for a hold inside of it
        self._ticker: Ticker | None = None
        self._last = self._late = 0.0
        self.error: str | None = None
        """Reason why the arm could not be commanded, if so."""

    def start(self, joints: Array) -> None:
        """Begin at rest at the arm's measured joints (7,) in radians."""
        with self.lock:
            self.follower.reset(joints)
            self.error = None
            self._late = 0.0
            self._last = self._clock.now()
        self._ticker = self._clock.every(1.0 / FOLLOWER_HZ, self._advance, "follower")

    def stop(self) -> None:
        """Stream no more; stopping twice is harmless."""
        if self._ticker is not None:
            self._ticker.stop()
        with self.lock:
            self.follower.hold()

    def take_lateness(self) -> float:
        """The longest time in seconds between two calls since this was last asked."""
        with self.lock:
            late, self._late = max(self._late, self._clock.now() - self._last), 0.0
            return late

    def _advance(self) -> None:
        with self.lock:
            now = self._clock.now()
            dt, self._last = now - self._last, now
            self._late = max(self._late, dt)
            joints, velocities = self.follower.advance(dt)
        try:
            self._arm.command(joints, velocities)
        except DuoBenchError as error:
            self.error = str(error)
        except Exception as error:  # noqa: BLE001 - the thread goes on, and the watch is told
            self.error = escaped(repr(error))


class ArmsController:
    """Leads both arms along their followers' paths and commands both grippers.

    Its methods may be called from any thread. At first the arms track nothing.
    """

    def __init__(
        self,
        arms: Mapping[Side, Arm],
        grippers: Mapping[Side, Gripper],
        configs: Mapping[Side, ArmConfig],
        clock: Clock,
        robot: Robot,
    ) -> None:
        self.arms = arms
        self.grippers = grippers
        self._configs = configs
        self.streamers: dict[Side, ReferenceStreamer] = {}
        for side in SIDES:
            follower = Follower(robot.home[side.index], configs[side], robot)
            self.streamers[side] = ReferenceStreamer(arms[side], follower, clock)
        self.is_engaged = False
        """Whether the arms track what they are told."""

    def engage(self) -> None:
        """Let both arms track their followers, which begin at the measured joints."""
        started: list[Arm] = []
        try:
            for side, arm in self.arms.items():
                started.append(arm)
                arm.start()
                self.streamers[side].start(arm.read().joints)
        except BackendError:
            self._stop(started)
            raise
        self.is_engaged = True

    def disengage(self) -> None:
        """Stop both arms, damped; calling it twice is harmless."""
        if self.is_engaged:
            self.is_engaged = False
            self._stop([*self.arms.values()])

    def _stop(self, arms: list[Arm]) -> None:
        for streamer in self.streamers.values():
            streamer.stop()
        for arm in arms:
            arm.stop()

    def limit(self, *, is_home: bool) -> None:
        """Bound both arms by the speed of the way home, or of everything else."""
        for side, streamer in self.streamers.items():
            config = self._configs[side]
            slow = min(config.home_fraction, config.speed_fraction)
            with streamer.lock:
                streamer.follower.speed_fraction = (
                    slow if is_home else config.speed_fraction
                )

    def aim(self, joints: Array) -> None:
        """Lead both arms towards joint positions (2, 7) in radians over the next control period."""
        for side, streamer in self.streamers.items():
            with streamer.lock:
                streamer.follower.aim(joints[side.index])

    def send(self, command: DuoCommand) -> None:
        """Lead both arms towards a command, and tell the grippers."""
        self.aim(command.joints)
        for side, gripper in self.grippers.items():
            gripper.command(float(command.openings[side.index]))

    def hold(self) -> None:
        """Bring both arms and both grippers to rest."""
        for streamer in self.streamers.values():
            with streamer.lock:
                streamer.follower.hold()
        for gripper in self.grippers.values():
            gripper.hold()

    @property
    def is_at_rest(self) -> bool:
        """Whether both arms are told to stand still."""
        for streamer in self.streamers.values():
            with streamer.lock:
                if not streamer.follower.is_at_rest:
                    return False
        return True
