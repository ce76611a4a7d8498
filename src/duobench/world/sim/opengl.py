"""Offscreen OpenGL: the choice of a library, and its contexts; MuJoCo, which may load one.

A driver can be missing, crash its process or hang it for good, and a process that has loaded one
library cannot turn to another. So child processes try the candidates under a time limit, and
contexts are made in child processes only.
"""

import ctypes
import json
import logging
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib import import_module
from typing import Any, cast

from duobench.core.errors import RenderingError
from duobench.core.machine import (
    DEVICE,
    OPENGL_PACKAGES,
    OSMESA_PACKAGES,
    is_software_renderer,
    unsupported,
)

ASKED = "MUJOCO_GL"
"""Environment variable with which people choose what renders, for MuJoCo and for us."""
BACKENDS = ("egl", "osmesa")
"""Libraries that render without a display, best first: all that we take."""
VULKAN = "vulkan"
"""What renders the looks of the studio; it takes no library of `BACKENDS`."""
CHOSEN = "DUOBENCH_GL"
"""Environment variable that carries the choice to child processes, so that they need not probe."""
PROBE_TIMEOUT_S = 30.0
"""A child that has not rendered by then hangs; it needs less than a second on an idle machine."""
PARALLEL_PROBES = 8
"""Most processes that a probe runs at the same time: with eight, a data-centre driver
hung that serves one [mujoco issue 3444]."""
PARALLEL_PROBE_S = 1.0
"""Seconds for which they render at the same time."""
HELP = f"""Install one of these, then try again:
  Debian, Ubuntu:  apt-get install {OPENGL_PACKAGES}   (EGL)
              or:  apt-get install {OSMESA_PACKAGES}   (OSMesa)
  conda:           conda install -c conda-forge libegl libopengl mesalib
With an NVIDIA card inside a container, also set NVIDIA_DRIVER_CAPABILITIES=all.
Set MUJOCO_GL to egl or osmesa to choose without a probe."""
"""Advice where no library works."""

_AUTOMATIC = ("", "enable", "enabled", "on", "true", "1")
_OFF = ("disable", "disabled", "off", "false", "0")
_log = logging.getLogger(__name__)
_SUSPECTS = (
    DEVICE,
    "__EGL_VENDOR_LIBRARY_FILENAMES",
    "__EGL_VENDOR_LIBRARY_DIRS",
    "EGL_PLATFORM",
    "LIBGL_DRIVERS_PATH",
    "LIBGL_ALWAYS_SOFTWARE",
    "GALLIUM_DRIVER",
    "MESA_LOADER_DRIVER_OVERRIDE",
    "MESA_GL_VERSION_OVERRIDE",
)
"""Environment variables that may be why nothing renders; where they are set, it is said."""


@dataclass(frozen=True, kw_only=True, slots=True)
class RenderingInfo:
    """Renderer of the images; the renderer, its vendor and version as OpenGL reports them."""

    backend: str
    """Backend of the context: egl or osmesa."""
    renderer: str
    vendor: str
    version: str
    software: bool
    """Whether the processor renders instead of a graphics card."""


def load_engine() -> None:
    """Import MuJoCo, which opens the OpenGL library that `MUJOCO_GL` names.

    Raises:
        RenderingError: It does not run on this platform, or that library cannot be opened.
    """
    problem = unsupported()
    if problem:
        raise RenderingError(problem)
    try:
        import_module("mujoco")
    except Exception as error:
        asked = os.environ.get(ASKED)
        if not asked:
            raise
        raise RenderingError(
            f"MuJoCo cannot load what {ASKED}={asked} stands for ({error}). Set {ASKED} to "
            f"{' or '.join(BACKENDS)}, whichever is installed, or unset it: then one that works is "
            "found."
        ) from error


def choose(processes: int = 1) -> str:
    """Find a backend that renders (what `MUJOCO_GL` says, or the best), and tell child processes.

    Call it before starting several processes that render, so that not each of them finds out for
    itself. No OpenGL is loaded into this process.

    `MUJOCO_GL` is used without a probe, and so is the choice of a parent process. Otherwise a
    child process renders an image with each candidate, best first, until one succeeds. Where more
    than one process will render at the same time, a graphics card has to serve several children at
    once before it is chosen. The first process that finds only software rendering logs it.
    """
    asked = _asked()
    if asked:
        return asked
    inherited = os.environ.get(CHOSEN, "")
    if inherited in BACKENDS:
        return inherited
    failures = ""
    for backend in _candidates():
        outcome = probe(backend)
        if (
            isinstance(outcome, RenderingInfo)
            and not outcome.software
            and processes > 1
        ):
            parallel = min(processes, PARALLEL_PROBES)
            outcome = probe(backend, processes=parallel, seconds=PARALLEL_PROBE_S)
            if isinstance(outcome, str):
                outcome = f"works for one process, but with {parallel} at the same time: {outcome}"
        if isinstance(outcome, RenderingInfo):
            os.environ[CHOSEN] = backend
            if outcome.software:
                _log.info(
                    "No graphics card renders here, so the processor does: %s through %s.",
                    outcome.renderer,
                    backend,
                )
            return backend
        if outcome.startswith(DEVICE):
            raise RenderingError(outcome)
        failures += f"\n  {backend}: {outcome}"
    raise RenderingError(
        f"No offscreen OpenGL works on this machine:{failures}\n{_advice()}"
    )


def _asked() -> str:
    """Choice of a person; empty where it is left to us."""
    name = os.environ.get(ASKED, "").lower().strip()
    if name in _OFF:
        raise RenderingError(
            f"Rendering is switched off by {ASKED}={name}; unset it to get images."
        )
    if name not in (*_AUTOMATIC, *BACKENDS):
        raise RenderingError(
            f"{ASKED}={name} is nothing that renders without a display; try one of "
            f"{', '.join(BACKENDS)}, or unset it."
        )
    return "" if name in _AUTOMATIC else name


def _candidates() -> Sequence[str]:
    """Libraries to try where no person has chosen."""
    if (
        DEVICE in os.environ
    ):  # a device of EGL was asked for: nothing else takes its place
        return BACKENDS[:1]
    bound = os.environ.get("PYOPENGL_PLATFORM", "").lower()
    return (bound,) if bound in BACKENDS else BACKENDS


def probe(
    backend: str, *, processes: int = 1, seconds: float = 0.0
) -> RenderingInfo | str:
    """Let some child processes render with a backend at the same time.

    Each goes on rendering for some seconds after its first image. Returns what rendered, or, where
    any child failed, the reason.
    """
    call = f"import sys; sys.path[:] = {sys.path!r}; from duobench.world.sim import offscreen; "
    call += f"offscreen.answer({backend!r}, {seconds!r})"
    environment = child_environment(backend)
    with ThreadPoolExecutor(processes) as pool:
        outcomes = list(
            pool.map(_outcome, [call] * processes, [environment] * processes)
        )
    failures = [outcome for outcome in outcomes if isinstance(outcome, str)]
    return failures[0] if failures else outcomes[0]


def child_environment(backend: str) -> dict[str, str]:
    """Variables of a child process that renders with a backend.

    With rendering switched off, MuJoCo itself opens no library.
    """
    return {**os.environ, ASKED: _OFF[0], "PYOPENGL_PLATFORM": backend}


def _outcome(call: str, environment: dict[str, str]) -> RenderingInfo | str:
    try:
        child = subprocess.run(
            [sys.executable, "-c", call],
            check=False,
            env=environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=PROBE_TIMEOUT_S,
        )
    except OSError as error:
        return f"no child process could be started to try it: {error}"
    except subprocess.TimeoutExpired:
        return f"no image within {PROBE_TIMEOUT_S:g} s; the driver hangs"
    lines = child.stdout.splitlines()
    if child.returncode == 0 and lines:
        return RenderingInfo(**json.loads(lines[-1]))
    words = [line.strip() for line in child.stderr.splitlines() if line.strip()]
    return words[-1] if words else f"the process ended with status {child.returncode}"


def open_context(
    backend: str,
    height: int,
    width: int,
) -> Any:
    """Make an OpenGL context and make it current; for child processes only.

    Raises:
        RenderingError: It does not work, for any reason.
    """
    library = None
    try:
        # This binds PyOpenGL to a library: nothing of PyOpenGL may be imported before.
        library = import_module(f"mujoco.{backend}")
        context = library.GLContext(width, height)
        context.make_current()
    except Exception as error:
        if backend == "egl" and DEVICE in os.environ:
            _check_device(library)
        raise RenderingError(
            f"The OpenGL backend {backend!r} does not work here: {in_words(error)}\n{_advice()}"
        ) from error
    return context


def _check_device(library: Any) -> None:
    """Raise where EGL works, so that the device that people asked for is why nothing renders."""
    try:
        count = len(library.EGL.eglQueryDevicesEXT())
    except Exception:  # noqa: BLE001 - what was raised before tells more
        return
    there = (
        "there is 1, number 0" if count == 1 else f"there are {count}, from number 0"
    )
    raise RenderingError(
        f"{DEVICE}={os.environ[DEVICE]!r} is no graphics device that renders: {there}. Set it to "
        "another number, or unset it: then the first that works is taken."
    )


def _advice() -> str:
    """Advice where nothing renders."""
    suspects = [
        f"{name}={os.environ[name]!r}" for name in _SUSPECTS if name in os.environ
    ]
    first = (
        f"Perhaps because of {', '.join(suspects)}: unset it first.\n"
        if suspects
        else ""
    )
    return first + HELP


def in_words(error: BaseException) -> str:
    """An error in words; PyOpenGL has none of its own for a library that is not there."""
    if isinstance(error, AttributeError):
        return f"its library is missing or lacks a function ({error})"
    return str(error) or type(error).__name__


def info_of(backend: str) -> RenderingInfo:
    """Renderer of the context that is current on the calling thread."""
    # The low-level module: importing all of `OpenGL.GL` would take longer than an image.
    from OpenGL.raw.GL.VERSION import GL_1_0

    read = cast(Callable[[int], Any], GL_1_0.glGetString)
    vendor, renderer, version = (
        (ctypes.cast(read(number), ctypes.c_char_p).value or b"unknown").decode()
        for number in (GL_1_0.GL_VENDOR, GL_1_0.GL_RENDERER, GL_1_0.GL_VERSION)
    )
    software = backend == "osmesa" or is_software_renderer(renderer)
    return RenderingInfo(
        backend=backend,
        renderer=renderer,
        vendor=vendor,
        version=version,
        software=software,
    )
