"""The choice of an OpenGL library by real child processes, its contexts, and their thread."""

import os
import subprocess
import textwrap
from pathlib import Path

import pytest

from duobench.core.errors import RenderingError
from duobench.world.sim import opengl
from duobench.world.sim.opengl import ASKED, CHOSEN, DEVICE, RenderingInfo, choose, probe
from tests.children import ran

VARIABLES = (ASKED, CHOSEN, "PYOPENGL_PLATFORM")


def run_python(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Python in a process of its own, in which nobody has chosen an OpenGL library."""
    kept = {name: value for name, value in os.environ.items() if name not in VARIABLES}
    return ran("-c", textwrap.dedent(code), env={**kept, **environment}, timeout=120)


def described(**environment: str) -> str:
    """Why nothing renders in an environment."""
    code = """
        from duobench.core.errors import RenderingError
        from duobench.world.sim.rendering import describe
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
        (ASKED, "vulkan", "MUJOCO_GL=vulkan is nothing.*display.*egl, osmesa"),
        (ASKED, "glfw", "MUJOCO_GL=glfw is nothing.*display.*egl, osmesa"),
    ],
)
def test_rendering_that_is_switched_off_or_asked_of_what_we_do_not_take_says_so(
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
        from duobench.world.sim.opengl import choose
        sys.executable = "/nowhere/python"
        print(choose())
        """
    assert run_python(child, **{CHOSEN: chosen}).stdout == f"{chosen}\n"
    assert "/nowhere/python" in run_python(child).stderr, "without it, a probe is tried"


@pytest.mark.slow
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


@pytest.mark.slow
def test_software_is_told_once_for_a_family_of_processes_and_none_is_bound_to_a_library() -> None:
    outcome = run_python(
        """
        import logging, subprocess, sys
        from duobench.world.sim.rendering import describe
        logging.basicConfig(level=logging.INFO)
        info = describe()
        describe()
        child = "import logging; logging.basicConfig(level=logging.INFO);"
        child += "from duobench.world.sim.rendering import describe; describe()"
        subprocess.run([sys.executable, "-c", child], check=True)
        print("OpenGL" in sys.modules, info.software)
        """
    )
    assert outcome.returncode == 0, outcome.stderr
    is_bound, software = outcome.stdout.split()
    assert is_bound == "False"
    assert outcome.stderr.count("the processor does") == (software == "True")


def test_a_backend_that_was_asked_for_and_does_not_work_says_so(tmp_path: Path) -> None:
    message = described(MUJOCO_GL="egl", __EGL_VENDOR_LIBRARY_DIRS=str(tmp_path))
    assert "The OpenGL backend 'egl' does not work here" in message
    assert "libegl1" in message


@pytest.mark.long
@pytest.mark.parametrize("asked", ["egl", ""])
@pytest.mark.parametrize("device", ["", "0,1", "GPU-8f3a", "MIG-8f3a", "-1", "7000", "0x0", "one"])
def test_a_device_that_is_none_is_the_one_cause_that_is_named(device: str, asked: str) -> None:
    message = described(**{ASKED: asked, DEVICE: device})
    assert message.startswith(f"{DEVICE}={device!r} is no graphics device that renders: there ")
    assert "number 0. Set it to another number, or unset it" in message
    assert "install" not in message


def test_the_number_of_a_device_may_have_spaces_around_it() -> None:
    assert described(**{ASKED: "egl", DEVICE: " 0 "}) == ""


@pytest.mark.long
@pytest.mark.parametrize(
    "variables",
    [
        {"PYOPENGL_PLATFORM": "glx"},
        {"PYOPENGL_PLATFORM": "nonsense"},
        {"PYOPENGL_PLATFORM": "osmesa", ASKED: "egl"},
        {"EGL_PLATFORM": "nonsense"},
        {"DISPLAY": ":77", "EGL_PLATFORM": "x11"},
        {"LIBGL_ALWAYS_SOFTWARE": "1"},
    ],
    ids=str,
)
def test_variables_that_change_nothing_are_no_hindrance(variables: dict[str, str]) -> None:
    assert described(**variables) == ""


@pytest.mark.long
@pytest.mark.parametrize(
    "variable", ["__EGL_VENDOR_LIBRARY_FILENAMES", "LIBGL_DRIVERS_PATH", "GALLIUM_DRIVER"]
)
@pytest.mark.parametrize("asked", ["egl", ""])
def test_a_variable_that_breaks_opengl_is_named(variable: str, asked: str) -> None:
    message = described(**{ASKED: asked, variable: "/nowhere"})
    assert f"Perhaps because of {variable}='/nowhere': unset it first." in message


@pytest.mark.parametrize(
    "how", ['duobench.make("bin_sort")', 'duobench.make_vec("bin_sort", 2, threads=1)']
)
def test_what_mujoco_cannot_load_is_said_in_words_from_python_too(how: str) -> None:
    code = f"""
        import duobench
        try:
            {how}
        except duobench.DuoBenchError as error:
            print(type(error).__name__, error)
        """
    told = run_python(code, **{ASKED: "none"}).stdout
    assert told.startswith("RenderingError MuJoCo cannot load what MUJOCO_GL=none stands for")
    assert "Set MUJOCO_GL to egl or osmesa" in told
    assert "glfw" not in told
