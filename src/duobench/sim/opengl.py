"""Offscreen OpenGL: contexts of a library, and a thread that owns what was made with one.

A process that has loaded one library cannot turn to another; `duobench.sim.probe` chooses it. All
calls of one context run on one thread, which lets the caller stop waiting for a driver that does
not come back.
"""

from __future__ import annotations

import ctypes
import os
import queue
import threading
from collections.abc import Callable
from concurrent.futures import Future, wait
from dataclasses import dataclass
from importlib import import_module
from typing import Any, TypeVar, cast

import mujoco

from duobench.errors import RenderingError
from duobench.machine import OPENGL_PACKAGES, OSMESA_PACKAGES

T = TypeVar("T")
_Order = tuple[Future[Any], Callable[[], Any]]

BACKENDS = {
    "egl": "mujoco.egl",
    "osmesa": "mujoco.osmesa",
    "glfw": "mujoco.glfw",
    "cgl": "mujoco.cgl",
}
"""Module of the context class of every backend."""
ASKED = "MUJOCO_GL"
"""Environment variable with which people choose a backend, for MuJoCo and for us."""
FRAME_TIMEOUT_S = 60.0
"""An image that has not come by then never comes."""
_SOFTWARE = ("llvmpipe", "softpipe", "swrast", "software rasterizer", "osmesa")
_GL_VENDOR, _GL_RENDERER, _GL_VERSION = 0x1F00, 0x1F01, 0x1F02
HELP = f"""Install one of these, then try again:
  Debian, Ubuntu:  apt-get install {OPENGL_PACKAGES}   (EGL)
              or:  apt-get install {OSMESA_PACKAGES}   (OSMesa)
  conda:           conda install -c conda-forge libegl libopengl mesalib
With an NVIDIA card inside a container, also set NVIDIA_DRIVER_CAPABILITIES=all.
Set MUJOCO_GL to egl, osmesa or glfw to choose without a probe."""
"""What to do where no library works."""

_OPENING = threading.Lock()
"""Held while a context is made: MuJoCo keeps one display for all of a process's."""


@dataclass(frozen=True, kw_only=True, slots=True)
class RenderingInfo:
    """What renders the images."""

    backend: str
    """How the context is made: egl, osmesa, glfw or cgl."""
    renderer: str
    """Name of the renderer, as OpenGL reports it."""
    vendor: str
    """Name of its vendor, as OpenGL reports it."""
    version: str
    """OpenGL version and driver, as OpenGL reports it."""
    software: bool
    """Whether the processor renders instead of a graphics card."""


_openers: list[int] = []
"""Number of the process that first made a context here; a forked child inherits it."""


def open_context(backend: str, height: int, width: int) -> Any:
    """Make an OpenGL context and make it current on the calling thread.

    Raises:
        RenderingError: The backend is not known or does not work here.
    """
    if _openers[:1] not in ([], [os.getpid()]):
        # Drivers hang in such a process, while they hold the interpreter.
        raise RenderingError(
            "This process was forked from one that had already rendered, which graphics drivers do "
            "not survive. Start processes with the method 'spawn', such as "
            'AsyncVectorEnv(..., context="spawn").'
        )
    module = BACKENDS.get(backend)
    if module is None:
        raise RenderingError(
            f"{ASKED}={backend} is no backend that DuoBench knows; try one of "
            f"{', '.join(BACKENDS)}, or unset it."
        )
    try:
        with _OPENING:
            # This binds PyOpenGL to a library: nothing of PyOpenGL may be imported before.
            library = import_module(module)
            _openers.append(os.getpid())
            context = library.GLContext(width, height)
            context.make_current()
            # MuJoCo only warns where there is no display, and fails at the first image.
            if backend == "glfw" and not import_module("glfw").get_current_context():
                raise RuntimeError(
                    "it needs a display and found none; egl and osmesa render without one"
                )
    except _failures() as error:  # evaluated only when something was raised
        raise RenderingError(
            f"The OpenGL backend {backend!r} does not work here: {reason_of(error)}\n{HELP}"
        ) from error
    return context


def _failures() -> tuple[type[Exception], ...]:
    """What MuJoCo and PyOpenGL raise where a library does not work."""
    from OpenGL.error import GLError

    return ImportError, AttributeError, OSError, RuntimeError, mujoco.FatalError, GLError


def reason_of(error: BaseException) -> str:
    """An error in words; PyOpenGL has none of its own for a library that is not there."""
    if isinstance(error, AttributeError):
        return f"its library is missing or lacks a function ({error})"
    return str(error)


def info_of(backend: str) -> RenderingInfo:
    """What the context that is current on the calling thread renders with."""
    # The low-level module: importing all of `OpenGL.GL` would take longer than an image.
    from OpenGL.raw.GL.VERSION import GL_1_0

    read = cast(Callable[[int], Any], GL_1_0.glGetString)
    vendor, renderer, version = (
        (ctypes.cast(read(number), ctypes.c_char_p).value or b"unknown").decode()
        for number in (_GL_VENDOR, _GL_RENDERER, _GL_VERSION)
    )
    software = backend == "osmesa" or any(name in renderer.lower() for name in _SOFTWARE)
    return RenderingInfo(
        backend=backend, renderer=renderer, vendor=vendor, version=version, software=software
    )


class RenderThread:
    """A thread that runs jobs one after another; waiting for one has a time limit."""

    def __init__(self) -> None:
        """Start the thread."""
        self._lost = False
        self._jobs: queue.SimpleQueue[_Order | None] = queue.SimpleQueue()
        # A daemon, so that a driver that hangs does not keep the process from ending.
        self._worker = threading.Thread(
            target=_serve, args=(self._jobs,), name="duobench-opengl", daemon=True
        )
        self._worker.start()

    def call(self, job: Callable[[], T]) -> T:
        """Run a job on the thread, and return or raise what it returns or raises.

        Raises:
            RenderingError: The job, or one before it, did not end within `FRAME_TIMEOUT_S`.
        """
        future: Future[T] = Future()
        if not self._lost:
            self._jobs.put((future, job))
            self._lost = not wait((future,), FRAME_TIMEOUT_S).done
        if self._lost:
            raise RenderingError(
                f"No image came within {FRAME_TIMEOUT_S:g} s: the graphics driver hangs. Some "
                "do when several processes render on one card at the same time. Render in fewer "
                f"processes, or without the card: {ASKED}=osmesa."
            )
        return future.result()

    def finish(self, *jobs: Callable[[], object]) -> None:
        """Run last jobs on the thread and wait for its end, unless it is lost.

        Without waiting, a process could end while its driver is still at work, and crash.
        """
        for job in jobs:
            self._jobs.put((Future(), job))
        self._jobs.put(None)
        # The garbage collector may drop a renderer while it runs on this very thread.
        if not self._lost and threading.current_thread() is not self._worker:
            self._worker.join(FRAME_TIMEOUT_S)


def _serve(jobs: queue.SimpleQueue[_Order | None]) -> None:
    while (order := jobs.get()) is not None:
        future, job = order
        try:
            future.set_result(job())
        except BaseException as error:  # noqa: BLE001 - handed to the caller, who waits for it
            future.set_exception(error)
        # Until the next order comes, nothing of this one may be kept alive by this frame.
        del order, future, job
