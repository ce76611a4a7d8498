"""Contexts of OpenGL, and the thread that guards them."""

import threading
from pathlib import Path

import pytest

from duobench.errors import RenderingError
from duobench.sim import opengl
from duobench.sim.opengl import RenderThread
from tests.sim.children import run_python


def test_a_backend_that_does_not_exist_is_refused_with_those_that_do() -> None:
    with pytest.raises(RenderingError, match=r"vulkan.*egl, osmesa, glfw, cgl"):
        opengl.open_context("vulkan", 1, 1)


def test_a_window_without_a_display_is_refused_with_advice() -> None:
    outcome = run_python(
        """
        from duobench.errors import RenderingError
        from duobench.sim.opengl import open_context
        try:
            open_context("glfw", 1, 1)
        except RenderingError as error:
            print(error)
        """,
        MUJOCO_GL="glfw",
        DISPLAY="",
        WAYLAND_DISPLAY="",
    )
    assert outcome.returncode == 0, outcome.stderr
    assert "'glfw' does not work here: it needs a display" in outcome.stdout
    assert "egl and osmesa render without one" in outcome.stdout


def test_a_backend_that_was_asked_for_and_does_not_work_says_so(tmp_path: Path) -> None:
    outcome = run_python(
        """
        from duobench.errors import RenderingError
        from duobench.sim.rendering import describe
        try:
            describe()
        except RenderingError as error:
            print(error)
        """,
        MUJOCO_GL="egl",
        __EGL_VENDOR_LIBRARY_DIRS=str(tmp_path),
    )
    assert outcome.returncode == 0, outcome.stderr
    assert "The OpenGL backend 'egl' does not work here" in outcome.stdout
    assert "libegl1" in outcome.stdout


def test_a_thread_hands_back_what_a_job_returns_or_raises() -> None:
    thread = RenderThread()
    where = thread.call(threading.get_ident)
    assert where != threading.get_ident()
    assert thread.call(threading.get_ident) == where

    def fail() -> None:
        raise KeyError("lost")

    with pytest.raises(KeyError, match="lost"):
        thread.call(fail)

    def late() -> None:
        raise TimeoutError("of the job itself")

    with pytest.raises(TimeoutError, match="of the job itself"):
        thread.call(late)
    assert thread.call(lambda: 7) == 7
    thread.finish()


def test_a_caller_stops_waiting_for_a_job_that_hangs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(opengl, "FRAME_TIMEOUT_S", 0.2)
    thread, never = RenderThread(), threading.Event()
    with pytest.raises(RenderingError, match=r"within 0\.2 s.*MUJOCO_GL=osmesa"):
        thread.call(never.wait)
    ran = []
    with pytest.raises(RenderingError, match="hangs"):
        thread.call(lambda: ran.append(1))
    never.set()
    thread.finish()
    assert not ran


def test_a_hung_thread_does_not_keep_a_process_alive() -> None:
    outcome = run_python(
        """
        import threading
        from duobench.errors import RenderingError
        from duobench.sim import opengl
        opengl.FRAME_TIMEOUT_S = 0.1
        try:
            opengl.RenderThread().call(threading.Event().wait)
        except RenderingError:
            print("given up")
        """
    )
    assert (outcome.returncode, outcome.stdout) == (0, "given up\n"), outcome.stderr
