"""Offscreen OpenGL: the choice of a library, its contexts, and a thread that owns one of them.

A driver can be missing, crash its process or hang it for good, and a process that has loaded one
library cannot turn to another. So child processes try the candidates under a time limit, and all
calls of one context run on one thread, which lets the caller stop waiting.
"""

import ctypes
import json
import logging
import os
import queue
import re
import subprocess
import sys
import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeVar, cast

import mujoco

from duobench.errors import RenderingError
from duobench.machine import OPENGL_PACKAGES, OSMESA_PACKAGES, is_software_renderer

T = TypeVar("T")
_Order = tuple[Future[Any], Callable[[], Any]]

BACKENDS = ("egl", "osmesa")
"""What renders without a display, best first."""
ASKED = "MUJOCO_GL"
"""Environment variable with which people choose a backend, for MuJoCo and for us."""
CHOSEN = "DUOBENCH_GL"
"""Environment variable that carries the choice to child processes, so that they need not probe."""
FRAME_TIMEOUT_S = 60.0
"""An image that has not come by then never comes."""
PROBE_TIMEOUT_S = 30.0
"""A child that has not rendered by then hangs; it needs less than a second on an idle machine."""
PARALLEL_PROBES = 8
"""Most processes that a probe runs at the same time: with eight, a data-centre driver
hung that serves one [mujoco issue 3444]."""
PARALLEL_PROBE_S = 1.0
"""How long they render at the same time."""
HELP = f"""Install one of these, then try again:
  Debian, Ubuntu:  apt-get install {OPENGL_PACKAGES}   (EGL)
              or:  apt-get install {OSMESA_PACKAGES}   (OSMesa)
  conda:           conda install -c conda-forge libegl libopengl mesalib
With an NVIDIA card inside a container, also set NVIDIA_DRIVER_CAPABILITIES=all.
Set MUJOCO_GL to egl or osmesa to choose without a probe."""
"""What to do where no library works."""

_AUTOMATIC = ("", "enable", "enabled", "on", "true", "1")
_OFF = ("disable", "disabled", "off", "false", "0")
_log = logging.getLogger(__name__)
_OPENING = threading.Lock()
"""Held while a context is made: MuJoCo keeps one display for all of a process's."""
_openers: list[int] = []
"""Number of the process that first made a context here; a forked child inherits it."""


@dataclass(frozen=True, kw_only=True, slots=True)
class RenderingInfo:
    """What renders the images; the renderer, its vendor and version as OpenGL reports them."""

    backend: str
    """How the context is made: egl or osmesa."""
    renderer: str
    vendor: str
    version: str
    software: bool
    """Whether the processor renders instead of a graphics card."""


def choose(processes: int = 1) -> str:
    """Find a backend that renders (what `MUJOCO_GL` says, or the best), and tell child processes.

    Call it before starting several processes that render, so that not each of them finds out for
    itself. No OpenGL is loaded into this process.

    `MUJOCO_GL` is used without a probe, and so is the choice of a parent process. Otherwise a
    child process renders an image with each candidate, best first, until one succeeds. Where more
    than one process will render at the same time, a graphics card has to serve several children at
    once before it is chosen. The first process that finds only software rendering logs it.
    """
    name = os.environ.get(ASKED, "").lower().strip()
    if name in _OFF:
        raise RenderingError(
            f"Rendering is switched off by {ASKED}={name}; unset it to get images."
        )
    if name not in _AUTOMATIC:
        return name
    if (inherited := os.environ.get(CHOSEN, "")) in BACKENDS:
        return inherited
    bound = os.environ.get("PYOPENGL_PLATFORM", "").lower()
    if bound not in ("", *BACKENDS):
        raise RenderingError(
            f"PYOPENGL_PLATFORM={bound} binds OpenGL to something that cannot render offscreen; "
            f"unset it, or set it to one of: {', '.join(BACKENDS)}."
        )
    failures = ""
    for backend in (bound,) if bound else BACKENDS:
        outcome = probe(backend)
        if isinstance(outcome, RenderingInfo) and not outcome.software and processes > 1:
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
        failures += f"\n  {backend}: {outcome}"
    raise RenderingError(f"No offscreen OpenGL works on this machine:{failures}\n{HELP}")


def probe(backend: str, *, processes: int = 1, seconds: float = 0.0) -> RenderingInfo | str:
    """Let some child processes render with a backend at the same time.

    Each goes on rendering for some seconds after its first image. Returns what rendered, or, where
    any child failed, the reason.
    """
    call = f"import sys; sys.path[:] = {sys.path!r}; from duobench.sim import offscreen; "
    call += f"offscreen.answer({backend!r}, {seconds!r})"
    # With rendering switched off, MuJoCo itself opens no library; `answer` opens the one to try.
    environment = {**os.environ, ASKED: _OFF[0], "PYOPENGL_PLATFORM": backend}
    with ThreadPoolExecutor(processes) as pool:
        outcomes = list(pool.map(_outcome, [call] * processes, [environment] * processes))
    failures = [outcome for outcome in outcomes if isinstance(outcome, str)]
    return failures[0] if failures else outcomes[0]


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


def open_context(backend: str, height: int, width: int) -> Any:
    """Make an OpenGL context and make it current on the calling thread."""
    if _openers[:1] not in ([], [os.getpid()]):
        # Drivers hang in such a process, while they hold the interpreter.
        raise RenderingError(
            "This process was forked from one that had already rendered, which graphics drivers do "
            "not survive. Start processes with the method 'spawn', such as "
            'AsyncVectorEnv(..., context="spawn").'
        )
    if backend not in BACKENDS:
        raise RenderingError(
            f"{ASKED}={backend} is nothing that renders without a display; try one of "
            f"{', '.join(BACKENDS)}, or unset it."
        )
    try:
        with _OPENING:
            # This binds PyOpenGL to a library: nothing of PyOpenGL may be imported before.
            library = import_module(f"mujoco.{backend}")
            _openers.append(os.getpid())
            context = library.GLContext(width, height)
            context.make_current()
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
        for number in (GL_1_0.GL_VENDOR, GL_1_0.GL_RENDERER, GL_1_0.GL_VERSION)
    )
    software = backend == "osmesa" or is_software_renderer(renderer)
    return RenderingInfo(
        backend=backend, renderer=renderer, vendor=vendor, version=version, software=software
    )


class RenderThread:
    """A thread that runs jobs one after another; waiting for one has a time limit."""

    def __init__(self) -> None:
        self._lost = False
        self._jobs: queue.SimpleQueue[_Order | None] = queue.SimpleQueue()
        # A daemon, so that a driver that hangs does not keep the process from ending.
        self._worker = threading.Thread(
            target=_serve, args=(self._jobs,), name="duobench-opengl", daemon=True
        )
        self._worker.start()

    def call(self, job: Callable[[], T]) -> T:
        """Run a job on the thread, and return or raise what it returns or raises."""
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


_MESA = re.compile(r"/(lib(LLVM|OSMesa|gallium)|\w+_dri\.so)")
_MAPPED = Path("/proc/self/maps")
"""What is loaded into this process, on Linux."""
_OWN_SYMBOLS_FIRST = getattr(os, "RTLD_DEEPBIND", 0)  # a flag of glibc


@cache
def load_triton() -> str:
    """Load Triton's library, where it is installed, once in a process; that takes 0.03 s.

    PyTorch's default wheel brings Triton, and to make an optimizer already imports it. Triton's
    library and Mesa's software renderer each have an LLVM, and Mesa's is visible to whatever is
    loaded after it: Triton's library would call into it, and the process would end in a
    segmentation fault.

    None of its Python code runs, and whoever imports it later gets this library. Where Mesa came
    first, the library looks for symbols in itself first, which breaks it only beside an allocator
    that `LD_PRELOAD` names.

    Returns:
        What was done, in words.
    """
    try:
        spec = find_spec("triton")
    except ValueError:  # something that stands for it was put into `sys.modules`
        spec = None
    folders = (spec and spec.submodule_search_locations) or ()
    libraries = [path for folder in folders for path in Path(folder, "_C").glob("libtriton*.so")]
    if not libraries:
        return "not installed, so PyTorch does not use it"
    is_late = _MAPPED.exists() and _MESA.search(_MAPPED.read_text(encoding="utf-8"))
    try:
        for path in libraries:
            ctypes.CDLL(str(path), mode=os.RTLD_NOW | (_OWN_SYMBOLS_FIRST if is_late else 0))
    except OSError as error:
        return f"cannot be loaded, and PyTorch may crash beside OpenGL: {error}"
    return "loaded apart from OpenGL, so that PyTorch works beside it"
