"""The Pythons that are here, and what an index has for those that are not."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

from dev.release.stage import ROOT

SUPPORTED = ("3.11", "3.12", "3.13")
ELSEWHERE = (
    *((python, "manylinux_2_28_x86_64") for python in (*SUPPORTED, "3.14")),
    *((python, "manylinux_2_28_aarch64") for python in SUPPORTED),
    *((python, "macosx_14_0_arm64") for python in SUPPORTED),
    ("3.12", "macosx_14_0_x86_64"),
    ("3.12", "win_amd64"),
)
"""Pythons and platforms for which wheels are looked up, and nothing is run."""
OLDER = {
    "manylinux_2_28": ("manylinux_2_17", "manylinux2014", "manylinux_2_27"),
    "macosx_14_0": ("macosx_11_0", "macosx_12_0", "macosx_13_0", "macosx_10_15"),
}
"""Older C libraries and systems, whose wheels go too."""


def find(version: str) -> str | None:
    """A Python of a minor version, on PATH or among those of pyenv; None where there is none."""
    candidates = [shutil.which(f"python{version}")]
    if pyenv := shutil.which("pyenv"):
        root = subprocess.run(
            [pyenv, "root"], check=False, capture_output=True, text=True
        ).stdout
        found = Path(root.strip()).glob(f"versions/{version}.*/bin/python")
        candidates += [str(path) for path in sorted(found)]
    code = "import sys, venv, ensurepip; print('%d.%d' % sys.version_info[:2])"
    for python in filter(
        None, candidates
    ):  # a shim of pyenv may stand for a Python that is not
        done = subprocess.run(
            [python, "-c", code], check=False, capture_output=True, text=True
        )
        if done.returncode == 0 and done.stdout.strip() == version:
            return python
    return None


def fill(python: str, wheel: Path, house: Path) -> None:
    """Download what a wheel needs in a Python, in the versions that a user gets today."""
    house.mkdir(parents=True, exist_ok=True)
    pip = [python, "-m", "pip", "--disable-pip-version-check", "-q", "download"]
    subprocess.run(
        [*pip, "--only-binary=:all:", "-d", str(house), str(wheel)], check=True
    )


def install(python: str, wheels: list[Path], house: Path, environment: Path) -> Path:
    """Make an empty environment, and install wheels into it from a folder alone; its programs."""
    shutil.rmtree(environment, ignore_errors=True)
    subprocess.run([python, "-m", "venv", str(environment)], check=True)
    programs = environment / "bin"
    pip = [
        str(programs / "python"),
        "-m",
        "pip",
        "--isolated",
        "--disable-pip-version-check",
    ]
    offline = ["-q", "install", "--no-index", "--find-links", str(house)]
    plain = {
        name: value for name, value in os.environ.items() if not name.startswith("PIP_")
    }
    for number, wheel in enumerate(wheels):
        alone = ["--no-deps"] * bool(number)  # plugins: LeRobot has gigabytes
        subprocess.run([*pip, *offline, *alone, str(wheel)], check=True, env=plain)
        if not number:
            subprocess.run([*pip, "check"], check=True, env=plain)
    return programs


def first_commands() -> tuple[dict[str, str], list[str]]:
    """Modules and commands of the first page up to its first table, without the installation."""
    page = (ROOT / "README.md").read_text(encoding="utf-8")
    named = r"`(\w+\.py)`[^`]*```python\n(.*?)^```"
    modules = dict(re.findall(named, page, re.DOTALL | re.MULTILINE))
    blocks = re.findall(r"^```sh\n(.*?)^```", page, re.DOTALL | re.MULTILINE)
    lines = [line for block in blocks for line in block.splitlines()]
    evaluation = next(place for place, line in enumerate(lines) if " eval " in line)
    return modules, [
        line for line in lines[: evaluation + 1] if line.startswith("duobench ")
    ]


def play(programs: Path, folder: Path) -> str:
    """Run the doctor and the first commands of the first page in an empty folder; the last table.

    Raises:
        SystemExit: One of them fails.
    """
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    modules, commands = first_commands()
    for name, code in modules.items():
        (folder / name).write_text(code, encoding="utf-8")
    kept = ("PATH", "HOME", "LANG", "OMP_NUM_THREADS", "MUJOCO_GL")
    plain = {name: os.environ[name] for name in kept if name in os.environ}
    said = ""
    for command in ("duobench doctor", *commands):
        words = [str(programs / "duobench"), *shlex.split(command)[1:]]
        done = subprocess.run(
            words, cwd=folder, env=plain, check=False, capture_output=True, text=True
        )
        said = done.stdout + done.stderr
        if done.returncode:
            sys.exit(f"{command} failed in {folder}:\n{said}")
    return said


def resolve(wheel: Path, version: str, system: str) -> str:
    """What an index has for a Python on a platform: how many wheels, or what is missing."""
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "-q", "install"]
    tags = ["--only-binary=:all:", "--python-version", version, "--platform", system]
    for name, others in OLDER.items():
        if system.startswith(name):
            tail = system.removeprefix(name)
            tags += [word for other in others for word in ("--platform", other + tail)]
    report = ["--dry-run", "--ignore-installed", "--target", "nowhere", "--report", "-"]
    done = subprocess.run(
        [*pip, *report, *tags, str(wheel)], check=False, capture_output=True, text=True
    )
    if done.returncode:
        last = [line for line in done.stderr.splitlines() if line.startswith("ERROR")]
        return f"does not resolve: {last[-1].removeprefix('ERROR: ') if last else 'no reason'}"
    return f"{len(json.loads(done.stdout)['install'])} wheels"
