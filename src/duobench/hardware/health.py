"""What can be wrong with the devices of a rig, asked of their latest readings.

An arm that has stopped by itself raises nothing when it is told where to be, and a robot that is
gone is noticed only because its readings grow old: so everything is asked, all the time.
"""

from __future__ import annotations

from collections.abc import Mapping

from duobench.envs.duo_env import MAX_IMAGE_AGE_SECONDS
from duobench.hardware.clock import Clock
from duobench.hardware.devices import Arm, Camera, Fault, FaultKind, Frame, Gripper
from duobench.hardware.motion.leader import Leader
from duobench.types import Side

MAX_ARM_AGE_S = 0.1
"""Oldest reading of an arm that it is moved by, in seconds."""
MAX_GRIPPER_AGE_S = 0.5
"""Oldest reading of a gripper, in seconds; one that is told nothing new answers at 30 Hz."""
MAX_FREEZE_S = 0.2
"""Longest time in seconds that an arm may be told nothing: this process was stopped."""


def frames(cameras: Mapping[str, Camera]) -> dict[str, Frame]:
    """The latest frame of each camera that has one, as it came from it."""
    latest = {name: camera.latest() for name, camera in cameras.items()}
    return {name: frame for name, frame in latest.items() if frame is not None}


def image_ages(cameras: Mapping[str, Camera], now: float) -> dict[str, float]:
    """Seconds since the latest image of each camera was taken; infinite without one."""
    latest = frames(cameras)
    return {name: now - latest[name].time_s if name in latest else float("inf") for name in cameras}


def arm_fault(
    arms: Mapping[Side, Arm], leaders: Mapping[Side, Leader], clock: Clock, *, is_engaged: bool
) -> Fault | None:
    """What is wrong with the arms.

    Args:
        arms: Both arms.
        leaders: Who tells them where to be.
        clock: The rig's clock.
        is_engaged: Whether they should track what they are told.
    """
    for side, arm in arms.items():
        reading = arm.read()
        if reading.fault is not None:
            return _named(f"The {side} arm", reading.fault)
        if (age := clock.now() - reading.time_s) > MAX_ARM_AGE_S:
            return _lost(f"The {side} arm has given no reading for {age:.2f} s.")
        if not is_engaged:
            continue
        if not reading.is_tracking:
            text = f"The {side} arm follows no more commands, and says nothing about why."
            return Fault(kind=FaultKind.DEVICE, text=text)
        if (late := leaders[side].take_lateness()) > MAX_FREEZE_S:
            return _lost(f"This computer stood still for {late:.2f} s.")
        if (error := leaders[side].error) is not None:
            return _lost(f"The {side} arm cannot be told where to be: {error}")
    return None


def gripper_fault(grippers: Mapping[Side, Gripper], clock: Clock) -> Fault | None:
    """What is wrong with the grippers."""
    for side, gripper in grippers.items():
        reading = gripper.read()
        if reading.fault is not None:
            return _named(f"The {side} gripper", reading.fault)
        if (age := clock.now() - reading.time_s) > MAX_GRIPPER_AGE_S:
            return _lost(f"The {side} gripper has not answered for {age:.2f} s.")
    return None


def camera_fault(cameras: Mapping[str, Camera], clock: Clock, *, is_running: bool) -> Fault | None:
    """What is wrong with the cameras; while an episode runs, old images are a fault."""
    for name, camera in cameras.items():
        if camera.fault is not None:
            return _named(f"The camera {name}", camera.fault)
    if not is_running:
        return None
    for name, age in image_ages(cameras, clock.now()).items():
        if not age <= MAX_IMAGE_AGE_SECONDS:
            return _lost(
                f"The latest image of the camera {name} is {age:.2f} s old; at most "
                f"{MAX_IMAGE_AGE_SECONDS:g} s is right."
            )
    return None


def _named(device: str, fault: Fault) -> Fault:
    return Fault(kind=fault.kind, text=f"{device}: {fault.text}")


def _lost(text: str) -> Fault:
    return Fault(kind=FaultKind.COMMUNICATION, text=text)
