"""The choice of an OpenGL library, made by real child processes."""

import os
from pathlib import Path

import pytest

from duobench.errors import RenderingError
from duobench.sim import probe as probing
from duobench.sim.opengl import ASKED, RenderingInfo
from duobench.sim.probe import CHOSEN, choose, probe
from tests.sim.children import VARIABLES, run_python


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
    monkeypatch.setattr(probing.sys, "executable", str(path))
    return path


def test_what_people_ask_for_is_taken_without_a_probe(undecided: pytest.MonkeyPatch) -> None:
    undecided.setattr(probing.sys, "executable", "/nowhere/python")
    for asked, expected in (("egl", "egl"), ("OSMesa ", "osmesa"), ("glx", "glfw")):
        undecided.setenv(ASKED, asked)
        assert choose() == expected
    undecided.setenv(CHOSEN, "egl")
    undecided.setenv(ASKED, "osmesa")
    assert choose() == "osmesa", "people stand above the parent process"


@pytest.mark.parametrize("value", ["off", "Disabled", "0"])
def test_rendering_can_be_switched_off(undecided: pytest.MonkeyPatch, value: str) -> None:
    undecided.setenv(ASKED, value)
    with pytest.raises(RenderingError, match="switched off by MUJOCO_GL"):
        choose()


@pytest.mark.usefixtures("undecided")
def test_the_choice_is_made_once_and_inherited() -> None:
    chosen = choose()
    assert os.environ[CHOSEN] == chosen
    child = """
        import sys
        from duobench.sim.probe import choose
        sys.executable = "/nowhere/python"
        print(choose())
        """
    assert run_python(child, **{CHOSEN: chosen}).stdout == f"{chosen}\n"
    assert "/nowhere/python" in run_python(child).stderr, "without it, a probe is tried"


def test_a_foreign_binding_of_pyopengl_is_explained(undecided: pytest.MonkeyPatch) -> None:
    undecided.setenv("PYOPENGL_PLATFORM", "x11")
    with pytest.raises(RenderingError, match=r"PYOPENGL_PLATFORM=x11.*unset it"):
        choose()


@pytest.mark.usefixtures("undecided")
def test_a_probe_says_what_drew() -> None:
    backend = choose()
    outcome = probe(backend)
    assert isinstance(outcome, RenderingInfo)
    assert outcome.backend == backend
    assert outcome.renderer


@pytest.mark.usefixtures("undecided")
def test_several_children_draw_at_the_same_time() -> None:
    assert isinstance(probe(choose(), processes=2, seconds=0.1), RenderingInfo)


def test_a_child_that_hangs_is_given_up(impostor: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    impostor.write_text("#!/bin/sh\nexec sleep 600\n")
    monkeypatch.setattr(probing, "PROBE_TIMEOUT_S", 0.5)
    outcome = probe("egl", processes=2)
    assert outcome == "no image within 0.5 s; the driver hangs"


def test_a_child_that_crashes_is_reported(impostor: Path) -> None:
    impostor.write_text("#!/bin/sh\nkill -SEGV $$\n")
    assert probe("egl") == "the process ended with status -11"
    impostor.write_text("#!/bin/sh\necho 'no such card' >&2\nexit 1\n")
    assert probe("egl") == "no such card"


def test_where_nothing_works_the_packages_to_install_are_named(tmp_path: Path) -> None:
    # Broken for real: no EGL vendor can be found, and the OSMesa library is an empty file.
    for version in ("", ".6", ".8"):
        (tmp_path / f"libOSMesa.so{version}").touch()
    outcome = run_python(
        """
        from duobench.errors import RenderingError
        from duobench.sim.rendering import describe
        try:
            describe()
        except RenderingError as error:
            print(error)
        """,
        __EGL_VENDOR_LIBRARY_DIRS=str(tmp_path),
        LD_LIBRARY_PATH=str(tmp_path),
    )
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
