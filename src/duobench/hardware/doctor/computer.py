"""The computer that leads the arms: its kernel, the rights of its user, and versions."""

from __future__ import annotations

import platform
import resource
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from duobench.hardware.doctor.checks import Check, Outcome
from duobench.hardware.rig import ArmDriver, CameraDriver, GripperDriver, Rig
from duobench.machine import install_extra
from duobench.versions import __version__

PRIORITY = 80
"""Realtime priority that the arm's library asks for [libfranka: the highest that is allowed]."""
LIBRARIES = {
    ArmDriver.FRANKY: ("franky-control",),
    GripperDriver.ROBOTIQ: ("pymodbus", "pyserial"),
    CameraDriver.REALSENSE: ("pyrealsense2",),
}
"""What drivers need, by the names that pip knows."""


def computer_checks(rig: Rig, sys: Path = Path("/sys")) -> list[Check]:
    """Look at the computer.

    Args:
        rig: What it leads; a rig without real arms asks little of it.
        sys: Where Linux tells of devices.
    """
    is_needed = any(
        arm.driver is not ArmDriver.SIMULATED and arm.is_realtime for arm in rig.arms.values()
    )
    return [
        _kernel(is_needed, sys),
        _rights(is_needed),
        _governor(is_needed, sys),
        *_versions(rig),
    ]


def _kernel(is_needed: bool, sys: Path) -> Check:
    try:
        is_realtime = (sys / "kernel" / "realtime").read_text().strip() == "1"
    except OSError:
        is_realtime = "PREEMPT_RT" in platform.version()
    return _needed(
        "realtime kernel",
        is_realtime,
        is_needed,
        f"{platform.release()} {'with' if is_realtime else 'without'} PREEMPT_RT",
        "Boot a kernel with PREEMPT_RT (Ubuntu Pro: pro enable realtime-kernel).",
    )


def _rights(is_needed: bool) -> Check:
    priority = resource.getrlimit(resource.RLIMIT_RTPRIO)[0]
    locked = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
    is_unlimited = resource.RLIM_INFINITY in (priority, locked) or locked > 1 << 30
    words = "without limit" if locked == resource.RLIM_INFINITY else f"{locked >> 10} KiB"
    return _needed(
        "realtime rights",
        (priority == resource.RLIM_INFINITY or priority >= PRIORITY) and is_unlimited,
        is_needed,
        f"priority up to {priority}, locked memory {words}",
        f"Give the group of the user rtprio 99 and memlock unlimited in /etc/security/limits.conf; "
        f"at least {PRIORITY} is asked for.",
    )


def _governor(is_needed: bool, sys: Path) -> Check:
    files = sorted(sys.glob("devices/system/cpu/cpu[0-9]*/cpufreq/scaling_governor"))
    found = {file.read_text().strip() for file in files}
    if not found:
        return Check(
            name="processor speed", outcome=Outcome.SKIPPED, value="not told by the kernel"
        )
    is_fast = found == {"performance"}
    return Check(
        name="processor speed",
        outcome=Outcome.OK if is_fast or not is_needed else Outcome.NOTE,
        value=f"governor {', '.join(sorted(found))}",
        advice=""
        if is_fast or not is_needed
        else "Choose it: cpupower frequency-set -g performance",
    )


def _needed(name: str, is_well: bool, is_needed: bool, value: str, advice: str) -> Check:
    if is_well:
        return Check(name=name, outcome=Outcome.OK, value=value)
    if not is_needed:
        value = f"{value}; not needed by this rig"
        return Check(name=name, outcome=Outcome.SKIPPED, value=value)
    return Check(name=name, outcome=Outcome.FAILED, value=value, advice=advice)


def _versions(rig: Rig) -> Iterator[Check]:
    words = f"duobench {__version__}, Python {platform.python_version()}"
    yield Check(name="version", outcome=Outcome.OK, value=words)
    drivers = {each.driver for each in (*rig.arms.values(), *rig.grippers.values())}
    drivers |= {each.driver for each in rig.cameras.values()}
    wanted = {name for driver in drivers for name in LIBRARIES.get(driver, ())}
    if any(camera.calibration is not None for camera in rig.cameras.values()):
        wanted.add("opencv-python-headless")
    for name in sorted(wanted):
        try:
            yield Check(name=name, outcome=Outcome.OK, value=version(name))
        except PackageNotFoundError:
            yield Check(
                name=name,
                outcome=Outcome.FAILED if "opencv" not in name else Outcome.NOTE,
                value="not installed",
                advice=install_extra("hardware"),
            )
