"""The choice of an OpenGL library, made by child processes that render an image.

A driver can be missing, crash its process or hang it for good, and a process that has loaded one
library cannot turn to another. So children try the candidates under a time limit; only then does
this process load the winner.
"""

from __future__ import annotations

import json
import logging
import os
import platform
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict

import mujoco
import numpy as np

from duobench.errors import RenderingError
from duobench.sim.opengl import (
    ASKED,
    BACKENDS,
    HELP,
    RenderingInfo,
    info_of,
    open_context,
    reason_of,
)

CANDIDATES = {"Linux": ("egl", "osmesa"), "Darwin": ("cgl",)}
"""What is tried, best first, on a system; elsewhere only GLFW exists."""
CHOSEN = "DUOBENCH_GL"
"""Environment variable that carries the choice to child processes, so that they need not probe."""
PROBE_TIMEOUT_S = 30.0
"""A child that has not rendered by then hangs; it needs less than a second on an idle machine."""
PARALLEL_PROBES = 8
"""Most processes that a probe runs at the same time: with eight, a data-centre driver was
seen to hang that serves one [mujoco issue 3444]."""
PARALLEL_PROBE_S = 1.0
"""How long they render at the same time."""

_AUTOMATIC = ("", "enable", "enabled", "on", "true", "1")
_OFF = ("disable", "disabled", "off", "false", "0")
_ALIASES = {"glx": "glfw", "wgl": "glfw"}
_PROBE_MODEL = """
<mujoco>
  <worldbody>
    <camera pos="0 0 1"/>
    <light pos="0 0 1"/>
    <geom size="0.3"/>
  </worldbody>
</mujoco>
"""
_log = logging.getLogger(__name__)


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
    raise RenderingError(f"No offscreen OpenGL works on this machine:\n{reasons}\n{HELP}")


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
    call = f"import sys; sys.path[:] = {sys.path!r}; import {__name__} as probe; "
    call += f"probe.answer({backend!r}, {seconds!r})"
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
        sys.exit(reason_of(error.__cause__ or error))  # the parent gives the advice, once
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
