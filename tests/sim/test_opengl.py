"""The choice of an OpenGL library by real child processes, its contexts, and their thread."""

import os
import subprocess
import sys
import textwrap
import threading
from pathlib import Path

import msgspec
import pytest

from duobench.errors import RenderingError
from duobench.sim import opengl
from duobench.sim.opengl import ASKED, CHOSEN, DEVICE, RenderingInfo, choose, probe
from tests.children import ran

VARIABLES = (ASKED, CHOSEN, "PYOPENGL_PLATFORM")


def run_python(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Python in a process of its own, in which nobody has chosen an OpenGL library."""
    kept = {name: value for name, value in os.environ.items() if name not in VARIABLES}
    return ran("-c", textwrap.dedent(code), env={**kept, **environment}, timeout=120)


def described(**environment: str) -> str:
    """Why nothing renders in an environment."""
    code = """
        from duobench.errors import RenderingError
        from duobench.sim.rendering import describe
        try:
            describe()
        except RenderingError as error:
            print(error)
        """
    outcome = run_python(code, **environment)
    assert outcome.returncode == 0, outcome.stderr
    return outcome.stdout


@pytest.fixture
def undecided(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """An environment in which nobody has chosen; what is chosen is forgotten afterwards."""
    for name in VARIABLES:
        monkeypatch.setenv(name, "")
        monkeypatch.delenv(name)
    return monkeypatch


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


@pytest.mark.parametrize(
    ("script", "told"),
    [
        ("exec sleep 600", "no image within 0.5 s; the driver hangs"),
        ("kill -SEGV $$", "the process ended with status -11"),
        ("echo 'no such card' >&2; exit 1", "no such card"),
    ],
)
def test_children_that_hang_crash_or_fail_are_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, script: str, told: str
) -> None:
    impostor = tmp_path / "python"
    impostor.touch(mode=0o755)
    impostor.write_text(f"#!/bin/sh\n{script}\n")
    monkeypatch.setattr(opengl.sys, "executable", str(impostor))
    monkeypatch.setattr(opengl, "PROBE_TIMEOUT_S", 0.5)
    assert probe("egl", processes=2) == told


def test_where_nothing_works_the_packages_to_install_are_named(tmp_path: Path) -> None:
    # Broken for real: no EGL vendor can be found, and the OSMesa library is an empty file.
    for version in ("", ".6", ".8"):
        (tmp_path / f"libOSMesa.so{version}").touch()
    folder = str(tmp_path)
    message = described(__EGL_VENDOR_LIBRARY_DIRS=folder, LD_LIBRARY_PATH=folder)
    assert message.startswith("No offscreen OpenGL works on this machine:")
    for part in ("  egl: ", "  osmesa: ", "libegl1", "libosmesa6", "conda-forge", "MUJOCO_GL"):
        assert part in message
    egl, osmesa = message.splitlines()[1:3]
    assert egl.startswith("  egl: Cannot initialize a EGL device display")
    assert osmesa.startswith("  osmesa: its library is missing or lacks a function")


def test_a_process_is_bound_to_what_was_chosen_and_software_is_told_once_for_its_family() -> None:
    outcome = run_python(
        """
        import logging, subprocess, sys
        from duobench.sim.rendering import describe
        logging.basicConfig(level=logging.INFO)
        info = describe()
        describe()
        child = "import logging; logging.basicConfig(level=logging.INFO);"
        child += "from duobench.sim.rendering import describe; describe()"
        subprocess.run([sys.executable, "-c", child], check=True)
        from OpenGL.platform import PLATFORM
        print(info.backend, type(PLATFORM).__name__, info.software)
        """
    )
    assert outcome.returncode == 0, outcome.stderr
    backend, platform, software = outcome.stdout.split()
    assert platform.lower() == f"{backend}platform"
    assert outcome.stderr.count("the processor does") == (software == "True")


@pytest.mark.parametrize("asked", ["vulkan", "glfw"])
def test_what_needs_a_display_or_does_not_exist_is_refused_with_what_does_not(asked: str) -> None:
    with pytest.raises(RenderingError, match=f"{asked} is nothing.*display.*egl, osmesa"):
        opengl.open_context(asked, 1, 1)


def test_a_backend_that_was_asked_for_and_does_not_work_says_so(tmp_path: Path) -> None:
    message = described(MUJOCO_GL="egl", __EGL_VENDOR_LIBRARY_DIRS=str(tmp_path))
    assert "The OpenGL backend 'egl' does not work here" in message
    assert "libegl1" in message
