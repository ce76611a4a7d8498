"""The computer that leads the arms: its kernel, the rights of its user, and versions."""

import platform
import resource
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from duobench.core.machine import install_extra
from duobench.core.versions import __version__
from duobench.real.catalog import DRIVERS, is_computed
from duobench.real.doctor.checks import Check, CheckOutcome
from duobench.real.rig import Rig

PRIORITY = 80
"""Realtime priority that the arm's library asks for [libfranka: the highest that is allowed]."""
OPENCV = "opencv-python-headless"


def computer_checks(rig: Rig, sys: Path = Path("/sys")) -> list[Check]:
    """Look at the computer, of which a rig without real arms asks little."""
    is_needed = any(
        arm.is_realtime and not is_computed("arms", arm.driver)
        for arm in rig.arms.values()
    )
    checks = (_kernel(is_needed, sys), _rights(is_needed), _governor(is_needed, sys))
    return [*checks, *_versions(rig)]


def _kernel(is_needed: bool, sys: Path) -> Check:
    try:
        is_realtime = (sys / "kernel" / "realtime").read_text().strip() == "1"
    except OSError:
        is_realtime = "PREEMPT_RT" in platform.version()
    value = f"{platform.release()} {'with' if is_realtime else 'without'} PREEMPT_RT"
    advice = "Boot a kernel with PREEMPT_RT (Ubuntu Pro: pro enable realtime-kernel)."
    return _needed(is_needed, is_realtime, "realtime kernel", value, advice)


def _rights(is_needed: bool) -> Check:
    priority = resource.getrlimit(resource.RLIMIT_RTPRIO)[0]
    locked = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
    is_high = priority == resource.RLIM_INFINITY or priority >= PRIORITY
    is_unlimited = resource.RLIM_INFINITY in (priority, locked) or locked > 1 << 30
    words = (
        "without limit" if locked == resource.RLIM_INFINITY else f"{locked >> 10} KiB"
    )
    value = f"priority up to {priority}, locked memory {words}"
    advice = (
        "Give the group of the user rtprio 99 and memlock unlimited in /etc/security/limits.conf; "
        f"at least {PRIORITY} is asked for."
    )
    return _needed(
        is_needed, is_high and is_unlimited, "realtime rights", value, advice
    )


def _needed(
    is_needed: bool, is_well: bool, name: str, value: str, advice: str
) -> Check:
    if is_needed or is_well:
        return CheckOutcome.FAILED.unless(is_well, name, value, advice)
    return CheckOutcome.SKIPPED.of(name, f"{value}; not needed by this rig")


def _governor(is_needed: bool, sys: Path) -> Check:
    name, pattern = (
        "processor speed",
        "devices/system/cpu/cpu[0-9]*/cpufreq/scaling_governor",
    )
    found = {file.read_text().strip() for file in sys.glob(pattern)}
    if not found:
        return CheckOutcome.SKIPPED.of(name, "not told by the kernel")
    is_well = found == {"performance"} or not is_needed
    advice = "Choose it: cpupower frequency-set -g performance"
    return CheckOutcome.NOTE.unless(
        is_well, name, f"governor {', '.join(sorted(found))}", advice
    )


def _versions(rig: Rig) -> Iterator[Check]:
    python = platform.python_version()
    yield CheckOutcome.OK.of("version", f"duobench {__version__}, Python {python}")
    wanted: set[str] = set()
    for part, _, device in rig.devices():
        driver = DRIVERS[part].get(device.driver)
        if driver is not None:
            wanted.update(driver.packages)
    if any(camera.calibration is not None for camera in rig.cameras.values()):
        wanted.add(OPENCV)
    for name in sorted(wanted):
        try:
            yield CheckOutcome.OK.of(name, version(name))
        except PackageNotFoundError:
            missing = CheckOutcome.NOTE if name == OPENCV else CheckOutcome.FAILED
            yield missing.of(name, "not installed", install_extra("hardware"))
