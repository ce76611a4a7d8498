"""Offscreen OpenGL: which library to use, and a thread that owns what was made with it.

A driver can be missing, crash its process or hang it for good, and a process that has loaded one
library cannot turn to another. So the choice is made by child processes that render an image under
a time limit; only then does this process load the winner. All calls of one context run on one
thread, which lets the caller stop waiting for a driver that does not come back.
"""

from __future__ import annotations

import ctypes
import json
import logging
import os
import platform
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, wait
from dataclasses import asdict, dataclass
from importlib import import_module
from typing import Any, TypeVar, cast

import mujoco
import numpy as np

from duobench.errors import RenderingError
from duobench.installing import OPENGL_PACKAGES, OSMESA_PACKAGES

T = TypeVar("T")
_Order = tuple[Future[Any], Callable[[], Any]]

BACKENDS = {
    "egl": "mujoco.egl",
    "osmesa": "mujoco.osmesa",
    "glfw": "mujoco.glfw",
    "cgl": "mujoco.cgl",
}
"""Module of the context class of every backend."""
CANDIDATES = {"Linux": ("egl", "osmesa"), "Darwin": ("cgl",)}
"""What is tried, best first, on a system; elsewhere only GLFW exists."""
ASKED = "MUJOCO_GL"
"""Environment variable with which people choose a backend, for MuJoCo and for us."""
CHOSEN = "DUOBENCH_GL"
"""Environment variable that carries the choice to child processes, so that they need not probe."""
PROBE_TIMEOUT_S = 30.0
"""A child that has not rendered by then hangs; it needs less than a second on an idle machine."""
FRAME_TIMEOUT_S = 60.0
"""An image that has not come by then never comes."""
PARALLEL_PROBES = 8
"""Most processes that a probe runs at the same time: with eight, a data-centre driver was
seen to hang that serves one [mujoco issue 3444]."""
PARALLEL_PROBE_S = 1.0
"""How long they render at the same time."""

_AUTOMATIC = ("", "enable", "enabled", "on", "true", "1")
_OFF = ("disable", "disabled", "off", "false", "0")
_ALIASES = {"glx": "glfw", "wgl": "glfw"}
_SOFTWARE = ("llvmpipe", "softpipe", "swrast", "software rasterizer", "osmesa")
_GL_VENDOR, _GL_RENDERER, _GL_VERSION = 0x1F00, 0x1F01, 0x1F02
_HELP = f"""Install one of these, then try again:
  Debian, Ubuntu:  apt-get install {OPENGL_PACKAGES}   (EGL)
              or:  apt-get install {OSMESA_PACKAGES}   (OSMesa)
  conda:           conda install -c conda-forge libegl libopengl mesalib
With an NVIDIA card inside a container, also set NVIDIA_DRIVER_CAPABILITIES=all.
Set MUJOCO_GL to egl, osmesa or glfw to choose without a probe."""

_OPENING = threading.Lock()
"""Held while a context is made: MuJoCo keeps one display for all of a process's."""
_log = logging.getLogger(__name__)


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


def choose(processes: int = 1) -> str:
    """Find a backend that renders, and tell child processes about it.

    Call it before starting several processes that render, so that not each of them finds out for
    itself. No OpenGL is loaded into this process.

    `MUJOCO_GL` is used without a probe, and so is the choice of a parent process. Otherwise a
    child process renders an image with each candidate, best first, until one succeeds. The first
    process that finds only software rendering says so in the log.

    Args:
        processes: How many processes will render at the same time. With more than one, a graphics
            card has to serve several children at once before it is chosen.

    Returns:
        A key of `BACKENDS`.

    Raises:
        RenderingError: Rendering is switched off, or no backend works.
    """
    name = os.environ.get(ASKED, "").lower().strip()
    if name in _OFF:
        raise RenderingError(
            f"Rendering is switched off by {ASKED}={name}; unset it to get images."
        )
    if name not in _AUTOMATIC:
        return _ALIASES.get(name, name)
    inherited = os.environ.get(CHOSEN, "")
    if inherited in BACKENDS:
        return inherited
    failures: dict[str, str] = {}
    for backend in _candidates():
        outcome = probe(backend)
        if isinstance(outcome, RenderingInfo) and not outcome.software and processes > 1:
            parallel = min(processes, PARALLEL_PROBES)
            outcome = probe(backend, processes=parallel, seconds=PARALLEL_PROBE_S)
            if isinstance(outcome, str):
                outcome = f"works for one process, but with {parallel} at the same time: {outcome}"
        if isinstance(outcome, RenderingInfo):
            os.environ[CHOSEN] = backend
            if outcome.software:
                _log.warning(
                    "No graphics card renders here, so the processor does: %s through %s. "
                    "Images are the same and take longer.",
                    outcome.renderer,
                    backend,
                )
            return backend
        failures[backend] = outcome
    reasons = "\n".join(f"  {backend}: {reason}" for backend, reason in failures.items())
    raise RenderingError(f"No offscreen OpenGL works on this machine:\n{reasons}\n{_HELP}")


def _candidates() -> Sequence[str]:
    """Backends to try; PyOpenGL can be bound to one of them by its own variable."""
    known = CANDIDATES.get(platform.system(), ("glfw",))
    bound = os.environ.get("PYOPENGL_PLATFORM", "").lower()
    candidates = [backend for backend in known if bound in ("", backend)]
    if not candidates:
        raise RenderingError(
            f"PYOPENGL_PLATFORM={bound} binds OpenGL to something that cannot render offscreen; "
            f"unset it, or set it to one of: {', '.join(known)}."
        )
    return candidates


def probe(backend: str, *, processes: int = 1, seconds: float = 0.0) -> RenderingInfo | str:
    """Let child processes render with a backend.

    Args:
        backend: A key of `BACKENDS`.
        processes: How many children render at the same time.
        seconds: How long each goes on rendering after its first image.

    Returns:
        What rendered, or, where any child failed, the reason.
    """
    call = f"import sys; sys.path[:] = {sys.path!r}; import {__name__} as gl; "
    call += f"gl.answer({backend!r}, {seconds!r})"
    # With rendering switched off, MuJoCo itself opens no library; `answer` opens the one to try.
    environment = {**os.environ, ASKED: _OFF[0]}
    if platform.system() == "Linux":
        environment["PYOPENGL_PLATFORM"] = backend
    children: list[subprocess.Popen[str]] = []
    try:
        for _ in range(processes):
            child = subprocess.Popen(
                [sys.executable, "-c", call],
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
            )
            children.append(child)
    except OSError as error:
        for child in children:
            child.kill()
            child.communicate()
        return f"no child process could be started to try it: {error}"
    deadline = time.monotonic() + PROBE_TIMEOUT_S
    outcomes = [_outcome(child, deadline) for child in children]
    failures = [outcome for outcome in outcomes if isinstance(outcome, str)]
    return failures[0] if failures else outcomes[0]


def _outcome(child: subprocess.Popen[str], deadline: float) -> RenderingInfo | str:
    with child:
        try:
            answer, errors = child.communicate(timeout=max(0.0, deadline - time.monotonic()))
        except subprocess.TimeoutExpired:
            child.kill()
            return f"no image within {PROBE_TIMEOUT_S:g} s; the driver hangs"
    lines = answer.splitlines()
    if child.returncode == 0 and lines:
        return RenderingInfo(**json.loads(lines[-1]))
    words = [line.strip() for line in errors.splitlines() if line.strip()]
    return words[-1] if words else f"the process ended with status {child.returncode}"


def answer(backend: str, seconds: float) -> None:
    """Render, say with what on the standard output, and end the process: the child of a probe."""
    try:
        context = open_context(backend, 64, 64)
    except RenderingError as error:
        sys.exit(_reason(error.__cause__ or error))  # the parent gives the advice, once
    model = mujoco.MjModel.from_xml_string(_PROBE_MODEL)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    mujoco_context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_50.value)
    mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, mujoco_context)
    scene = mujoco.MjvScene(model, maxgeom=1)
    view = mujoco.MjvCamera()
    view.type, view.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED.value, 0
    everything = mujoco.mjtCatBit.mjCAT_ALL.value
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, view, everything, scene)
    rectangle = mujoco.MjrRect(0, 0, 64, 64)
    pixels = np.zeros((64, 64, 3), dtype=np.uint8)
    deadline = time.monotonic() + seconds
    while True:
        mujoco.mjr_render(rectangle, scene, mujoco_context)
        mujoco.mjr_readPixels(pixels, None, rectangle, mujoco_context)
        if time.monotonic() >= deadline:
            break
    if not pixels.any():
        sys.stderr.write("the image stayed black\n")
        os._exit(1)
    sys.stdout.write(json.dumps(asdict(info_of(backend))) + "\n")
    sys.stdout.flush()
    # Drivers have crashed while a process that had already rendered was taken down.
    os._exit(0 if context else 1)


_PROBE_MODEL = """
<mujoco>
  <worldbody>
    <camera pos="0 0 1"/>
    <light pos="0 0 1"/>
    <geom size="0.3"/>
  </worldbody>
</mujoco>
"""


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
            f"The OpenGL backend {backend!r} does not work here: {_reason(error)}\n{_HELP}"
        ) from error
    return context


def _failures() -> tuple[type[Exception], ...]:
    """What MuJoCo and PyOpenGL raise where a library does not work."""
    from OpenGL.error import GLError

    return ImportError, AttributeError, OSError, RuntimeError, mujoco.FatalError, GLError


def _reason(error: BaseException) -> str:
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


class Thread:
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
