"""Machine of this process: software to install, network addresses, parent process, pauses.

The name of this package on the index is not that of the import: `duobench` there is the package of
the authors of the paper.
"""

import ipaddress
import os
import platform
import sys
import threading
import time
from collections.abc import Callable
from importlib import import_module
from typing import Any

from duobench.core.errors import DuoBenchError

DISTRIBUTION = "duobench-fr3"
"""Name of this package in pip once it is installed; no index knows the name yet."""
SOURCE, WHERE = ".", " in a clone of the repository"
"""Source to install with pip, and its place; pages say the same."""
OPENGL_PACKAGES = "libegl1 libopengl0 libgl1 libgl1-mesa-dri"
"""Packages of Debian and Ubuntu with which EGL renders offscreen, on a processor too."""
OSMESA_PACKAGES = "libosmesa6"
"""The same for OSMesa, which always renders on the processor."""
VULKAN_PACKAGES = "libvulkan1 mesa-vulkan-drivers"
"""The same for Vulkan, on a processor too."""
DEVICE = "MUJOCO_EGL_DEVICE_ID"
"""Environment variable with which people choose a graphics device for EGL."""
SOFTWARE_RENDERERS = ("llvmpipe", "softpipe", "swrast", "software rasterizer", "osmesa")
"""Parts of the names of OpenGL's renderers that need no graphics card."""
FIRST_PYTHON = {"lerobot": (3, 12)}
"""The oldest Python that can have an extra, where it is not that of the package."""
LAPSE_S = 2.0
"""Seconds without a note after which a process was stopped, not only busy."""
_KEPT = 100
"""Gaps that are remembered, the latest."""


def unsupported(system: str = sys.platform, architecture: str | None = None) -> str:
    """Reason why a platform is not supported, and what to do; empty if none is known."""
    if system == "win32":
        return "DuoBench does not run on Windows itself: install it in WSL 2, which is Linux."
    if system == "darwin" and (architecture or platform.machine()) == "x86_64":
        return (
            "MuJoCo 4 has no wheel for Macs with an Intel processor: install DuoBench on Linux, in "
            "a container or a virtual machine, or on a Mac with Apple's."
        )
    return ""


def install_extra(extra: str) -> str:
    """The sentence that says how to install an extra, such as "ray", in this Python."""
    first, command = FIRST_PYTHON.get(extra, (0, 0)), f"pip install '{SOURCE}[{extra}]'"
    if sys.version_info[:2] < first:
        running = f"{sys.version_info.major}.{sys.version_info.minor}"
        return (
            f"This is Python {running}, and the extra {extra} needs Python {first[0]}.{first[1]} "
            f"or newer; there,{WHERE}: {command}"
        )
    return f"Install it{WHERE}: {command}"


def fill_streams() -> None:
    """Put the null device in the place of closed standard streams, for children too.

    Else what is opened next gets the number of a stream, and what is printed lands in it.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free
            os.set_inheritable(number, True)


def load_extra(
    module: str,
    extra: str,
    needed: str,
    error: type[DuoBenchError],
) -> Any:
    """A module of an extra; where it is missing, an error that says what it is needed for."""
    try:
        return import_module(module)
    except ImportError as missing:
        raise error(f"{needed} ({missing}). {install_extra(extra)}") from missing


def is_software_renderer(renderer: str) -> bool:
    """Whether the processor renders with it, by its name as OpenGL reports it."""
    return any(name in renderer.lower() for name in SOFTWARE_RENDERERS)


def is_loopback(host: str) -> bool:
    """Whether a name, or an address with or without brackets, is reached from here only."""
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return host == "localhost"


class Awake:
    """Knows when a process was stopped, by the gaps between notes that come many times a second."""

    def __init__(self) -> None:
        self._noted: tuple[float, tuple[tuple[float, float], ...]] | None = None

    def note(self) -> None:
        """Say that the process runs."""
        now = time.monotonic()
        self._noted = now, self._gaps(now)

    def seconds_since(self, moment: float) -> float:
        """Seconds since a `time.monotonic()`, less those in which the process was stopped.

        All of them where nothing notes that it runs.
        """
        now = time.monotonic()
        stopped = (max(end - max(begin, moment), 0.0) for begin, end in self._gaps(now))
        return now - moment - sum(stopped)

    def _gaps(self, now: float) -> tuple[tuple[float, float], ...]:
        last, gaps = self._noted or (now, ())
        return gaps if now - last <= LAPSE_S else (*gaps, (last, now))[-_KEPT:]


HERE = Awake()
"""State of this process, if it is one of an evaluation; set by the watch of its parent."""


def watch_parent(parent: int, end: Callable[[], object]) -> None:
    """Call a function in a thread as soon as the parent of this process is gone, however it went.

    It ends this process, and what it has started.
    """

    def watch() -> None:
        while os.getppid() == parent:
            HERE.note()
            time.sleep(0.1)
        end()

    threading.Thread(target=watch, daemon=True).start()
