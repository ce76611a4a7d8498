"""The choice of an OpenGL library by real child processes, its contexts, and their thread."""

import os
import subprocess
import textwrap
import threading
from pathlib import Path

import pytest

from duobench.errors import RenderingError
from duobench.sim import opengl
from duobench.sim.opengl import ASKED, CHOSEN, RenderingInfo, RenderThread, choose, probe
from tests.children import ran

VARIABLES = (ASKED, CHOSEN, "PYOPENGL_PLATFORM")
DESCRIBE = """
    from duobench.errors import RenderingError
    from duobench.sim.rendering import describe
    try:
        describe()
    except RenderingError as error:
        print(error)
    """


def run_python(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Python in a process of its own, in which nobody has chosen an OpenGL library."""
    kept = {name: value for name, value in os.environ.items() if name not in VARIABLES}
    return ran("-c", textwrap.dedent(code), env={**kept, **environment}, timeout=120)


@pytest.fixture
def undecided(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """An environment in which nobody has chosen; what is chosen is forgotten afterwards."""
    for name in VARIABLES:
        monkeypatch.setenv(name, "")
        monkeypatch.delenv(name)
    return monkeypatch


@pytest.fixture
def impostor(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Something that probes run instead of the interpreter; a test writes what it does."""
    path = tmp_path / "python"
    path.touch(mode=0o755)
    monkeypatch.setattr(opengl.sys, "executable", str(path))
    return path


def test_what_people_ask_for_is_taken_without_a_probe(undecided: pytest.MonkeyPatch) -> None:
    undecided.setattr(opengl.sys, "executable", "/nowhere/python")
    for asked, expected in (("egl", "egl"), ("OSMesa ", "osmesa")):
        undecided.setenv(ASKED, asked)
        assert choose() == expected
    undecided.setenv(CHOSEN, "egl")
    undecided.setenv(ASKED, "osmesa")
    assert choose() == "osmesa", "people stand above the parent process"


@pytest.mark.parametrize(
    ("variable", "value", "words"),
    [
        (ASKED, "off", "switched off by MUJOCO_GL"),
        (ASKED, "Disabled", "switched off by MUJOCO_GL"),
        (ASKED, "0", "switched off by MUJOCO_GL"),
        ("PYOPENGL_PLATFORM", "x11", r"PYOPENGL_PLATFORM=x11.*unset it"),
    ],
)
def test_rendering_that_is_switched_off_or_bound_elsewhere_says_so(
    undecided: pytest.MonkeyPatch, variable: str, value: str, words: str
) -> None:
    undecided.setenv(variable, value)
    with pytest.raises(RenderingError, match=words):
        choose()


@pytest.mark.usefixtures("undecided")
def test_the_choice_is_made_once_and_inherited() -> None:
    chosen = choose()
    assert os.environ[CHOSEN] == chosen
    child = """
        import sys
        from duobench.sim.opengl import choose
        sys.executable = "/nowhere/python"
        print(choose())
        """
    assert run_python(child, **{CHOSEN: chosen}).stdout == f"{chosen}\n"
    assert "/nowhere/python" in run_python(child).stderr, "without it, a probe is tried"


@pytest.mark.usefixtures("undecided")
def test_a_probe_says_what_drew_in_one_child_and_in_several() -> None:
    backend = choose()
    for outcome in (probe(backend), probe(backend, processes=2, seconds=0.1)):
        assert isinstance(outcome, RenderingInfo)
        assert outcome.backend == backend
        assert outcome.renderer


def test_a_child_that_hangs_is_given_up(impostor: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    impostor.write_text("#!/bin/sh\nexec sleep 600\n")
    monkeypatch.setattr(opengl, "PROBE_TIMEOUT_S", 0.5)
    assert probe("egl", processes=2) == "no image within 0.5 s; the driver hangs"


def test_a_child_that_crashes_is_reported(impostor: Path) -> None:
    impostor.write_text("#!/bin/sh\nkill -SEGV $$\n")
    assert probe("egl") == "the process ended with status -11"
    impostor.write_text("#!/bin/sh\necho 'no such card' >&2\nexit 1\n")
    assert probe("egl") == "no such card"


def test_where_nothing_works_the_packages_to_install_are_named(tmp_path: Path) -> None:
    # Broken for real: no EGL vendor can be found, and the OSMesa library is an empty file.
    for version in ("", ".6", ".8"):
        (tmp_path / f"libOSMesa.so{version}").touch()
    folder = str(tmp_path)
    outcome = run_python(DESCRIBE, __EGL_VENDOR_LIBRARY_DIRS=folder, LD_LIBRARY_PATH=folder)
    assert outcome.returncode == 0, outcome.stderr
    message = outcome.stdout
    assert message.startswith("No offscreen OpenGL works on this machine:")
    for part in ("  egl: ", "  osmesa: ", "libegl1", "libosmesa6", "conda-forge", "MUJOCO_GL"):
        assert part in message
    egl, osmesa = message.splitlines()[1:3]
    assert egl.startswith("  egl: Cannot initialize a EGL device display")
    assert osmesa.startswith("  osmesa: its library is missing or lacks a function")


def test_a_process_is_bound_to_the_library_that_was_chosen() -> None:
    outcome = run_python(
        """
        from duobench.sim.rendering import describe
        backend = describe().backend
        from OpenGL.platform import PLATFORM
        print(backend, type(PLATFORM).__name__)
        """
    )
    backend, platform = outcome.stdout.split()
    assert platform.lower() == f"{backend}platform"


def test_software_rendering_is_told_once_for_a_whole_family_of_processes() -> None:
    outcome = run_python(
        """
        import subprocess, sys
        from duobench.sim.rendering import describe
        info = describe()
        describe()
        child = "from duobench.sim.rendering import describe; describe()"
        subprocess.run([sys.executable, "-c", child], check=True)
        print(info.software)
        """
    )
    assert outcome.returncode == 0, outcome.stderr
    told = outcome.stderr.count("the processor does")
    assert told == {"True\n": 1, "False\n": 0}[outcome.stdout]


@pytest.mark.parametrize("asked", ["vulkan", "glfw"])
def test_what_needs_a_display_or_does_not_exist_is_refused_with_what_does_not(asked: str) -> None:
    with pytest.raises(RenderingError, match=f"{asked} is nothing.*display.*egl, osmesa"):
        opengl.open_context(asked, 1, 1)


def test_a_backend_that_was_asked_for_and_does_not_work_says_so(tmp_path: Path) -> None:
    outcome = run_python(DESCRIBE, MUJOCO_GL="egl", __EGL_VENDOR_LIBRARY_DIRS=str(tmp_path))
    assert outcome.returncode == 0, outcome.stderr
    assert "The OpenGL backend 'egl' does not work here" in outcome.stdout
    assert "libegl1" in outcome.stdout


def test_a_thread_hands_back_what_a_job_returns_or_raises() -> None:
    thread = RenderThread()
    where = thread.call(threading.get_ident)
    assert where != threading.get_ident()
    assert thread.call(threading.get_ident) == where
    # A time-out of the job itself is none of the thread.
    for error in (KeyError("lost"), TimeoutError("of the job itself")):
        with pytest.raises(type(error), match=str(error.args[0])):
            thread.call(lambda error=error: raised(error))
    assert thread.call(lambda: 7) == 7
    thread.finish()


def raised(error: Exception) -> None:
    raise error


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
