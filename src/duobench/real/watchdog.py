"""Watchdog, which checks the devices of a rig for faults all the time.

An arm that has stopped by itself raises nothing when it is told where to be, and a robot that is
gone is noticed only because its readings grow old. So everything is asked a hundred times a second,
whether or not commands come.
"""

import logging
from collections.abc import Callable, Mapping

from duobench.core.errors import escaped
from duobench.envs.duo_env import MAX_IMAGE_AGE_SECONDS
from duobench.real.clock import Clock, Ticker
from duobench.real.controller import ArmsController
from duobench.real.devices import Camera, image_ages
from duobench.real.follower import PERIOD
from duobench.real.supervisor import State, Supervisor
from duobench.results.labels import Fault, FaultKind

_log = logging.getLogger(__name__)

WATCH_HZ = 100.0
"""Health checks a second."""
STOP_AFTER_S = 30.0
"""Seconds without a command after which the arms stop, damped, instead of holding."""
MAX_ARM_AGE_S = 0.1
"""Oldest reading of an arm that it is moved by, in seconds."""
MAX_GRIPPER_AGE_S = 0.5
"""Oldest reading of a gripper, in seconds; an idle gripper is read at 30 Hz."""
GRACE_S = 0.5
"""Seconds that an image may be late, while the arms rest, before an episode is lost by it."""
MAX_FREEZE_S = 0.2
"""Longest time in seconds that an arm may be told nothing: this process was stopped."""


class Watchdog:
    """Holds both arms where a device is not well, and stops arms that get no commands.

    `hold` holds both arms, for a reason and a fault if there is one.
    """

    def __init__(
        self,
        controller: ArmsController,
        cameras: Mapping[str, Camera],
        supervisor: Supervisor,
        clock: Clock,
        hold: Callable[[str, Fault | None], None],
    ) -> None:
        self._controller, self._cameras = controller, cameras
        self._supervisor = supervisor
        self._clock = clock
        self._hold = hold
        self._ticker: Ticker | None = None
        self._fed = 0.0
        self.seen = frozenset(cameras)
        """Cameras in use while commands are followed."""
        self.waits = 0
        self.look: Callable[[], None] = lambda: None
        """Check for a person while arms or fingers may move; see `watch_person`."""

    def start(self) -> None:
        """Watch from now on, in a thread of its own."""
        self.feed()
        self._ticker = self._clock.every(1.0 / WATCH_HZ, self._watch, "watch")

    def stop(self) -> None:
        """Watch no more; stopping twice is harmless."""
        if self._ticker is not None:
            self._ticker.stop()

    def feed(self) -> None:
        """Take note of a command."""
        self._fed = self._clock.now()

    def check(self) -> None:
        """Hold both arms where something is wrong."""
        if self._supervisor.state in {State.OFF, State.FAULTED, State.RECOVERING}:
            return
        fault = self.find_fault()
        if fault is not None:
            self._hold(fault.text, fault)

    def find_fault(self) -> Fault | None:
        """Return the fault of arms, grippers or cameras, or None."""
        return self._arm_fault() or self._gripper_fault() or self._camera_fault()

    def _watch(self) -> None:
        try:
            self.check()
            if self._supervisor.is_moving:
                self.look()
        except Exception as error:  # noqa: BLE001 - after any error the arms are unwatched
            _log.exception("The watch failed.")
            text = f"What is wrong cannot be told: {escaped(repr(error))}"
            self._hold(text, FaultKind.CONTROLLER.fault(text))
        if self._controller.is_engaged and self._clock.now() - self._fed > STOP_AFTER_S:
            self._controller.disengage()
            if self._supervisor.state in {
                State.HOMING,
                State.RUNNING,
            }:  # asked now: it may be new
                reason = (
                    f"No command came for {STOP_AFTER_S:g} s; the arms were stopped."
                )
                self._hold(reason, None)

    def _arm_fault(self) -> Fault | None:
        for side, arm in self._controller.arms.items():
            reading, streamer = arm.read(), self._controller.streamers[side]
            if reading.fault is not None:
                return _named(f"The {side} arm", reading.fault)
            age = self._clock.now() - reading.time_s
            if age > MAX_ARM_AGE_S:
                return _lost(f"The {side} arm has given no reading for {age:.2f} s.")
            if not self._controller.is_engaged:
                continue
            if not reading.is_tracking:
                return FaultKind.CONTROLLER.fault(
                    f"The {side} arm follows no more commands, and says nothing about why."
                )
            late = streamer.take_lateness()
            if late > MAX_FREEZE_S:
                return _lost(f"This computer stood still for {late:.2f} s.")
            if streamer.error is not None:
                return _lost(
                    f"The {side} arm cannot be told where to be: {streamer.error}"
                )
        return None

    def _gripper_fault(self) -> Fault | None:
        for side, gripper in self._controller.grippers.items():
            reading = gripper.read()
            if reading.fault is not None:
                return _named(f"The {side} gripper", reading.fault)
            age = self._clock.now() - reading.time_s
            if age > MAX_GRIPPER_AGE_S:
                return _lost(f"The {side} gripper has not answered for {age:.2f} s.")
        return None

    def image_ages(self) -> dict[str, float]:
        """Seconds since the latest image of each camera that is seen; infinite without one."""
        seen = {name: each for name, each in self._cameras.items() if name in self.seen}
        return image_ages(seen, self._clock.now())

    def _camera_fault(self) -> Fault | None:
        """Return the fault of a camera, or None; while an episode runs, of those that are seen."""
        is_running = self._supervisor.state is State.RUNNING
        for name, camera in self._cameras.items():
            if camera.fault is not None and (name in self.seen or not is_running):
                return _named(f"The camera {name}", camera.fault)
        return self.late_image(GRACE_S) if is_running else None

    def wait_for_images(self) -> bool:
        """Bring the arms to rest while an image is late, and hold them if it does not come.

        Whether one was waited for.
        """
        if self._supervisor.state is not State.RUNNING or not self.late_image():
            return False
        self.waits += 1
        self._controller.hold()
        end = self._clock.now() + GRACE_S
        while (
            self._supervisor.reason is None
            and self.late_image()
            and self._clock.now() < end
        ):
            self._clock.wait_until(self._clock.now() + PERIOD)
        if self._supervisor.reason is None and (fault := self.late_image()) is not None:
            self._hold(fault.text, fault)
        return True

    def late_image(self, grace: float = 0.0) -> Fault | None:
        """Fault for a late image of a camera in use.

        By how many seconds more than is right it may be, is its grace.
        """
        for name, age in self.image_ages().items():
            if not age <= MAX_IMAGE_AGE_SECONDS + grace:
                return _lost(
                    f"The latest image of the camera {name} is {age:.2f} s old; at most "
                    f"{MAX_IMAGE_AGE_SECONDS:g} s is right."
                )
        return None


def _named(device: str, fault: Fault) -> Fault:
    return fault.kind.fault(f"{device}: {fault.text}")


_lost = FaultKind.COMMUNICATION.fault
