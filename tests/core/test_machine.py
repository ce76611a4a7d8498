"""What pages and messages tell people to install, they get: this package, and no other."""

import ast
import json
import re
import sys
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from duobench.core.errors import BackendError
from duobench.core.machine import (
    DISTRIBUTION,
    OPENGL_PACKAGES,
    SOURCE,
    install_extra,
    load_extra,
    unsupported,
)
from duobench.core.versions import ENGINE, other_engine
from tests.children import ran
from tests.docs.markdown import page_of
from tests.test_repository import ROOT, tracked

COMMAND = re.compile(r"pip install((?: +(?:'[^'\n]+'|[^\s'\"`]+))+)")
WORD = re.compile(r"'([^'\n]+)'|([^\s']+)")
UNREAD = ("tests", "CHANGELOG.md")
OTHERS = {
    "lerobot",
    "vlagents",
    "rpyc",
    "vla-eval",
    "openpi-client",
    "pandas",
    "polars",
    "duckdb",
    "torch",
    "pyarrow",
    "h5py",
    "stable-baselines3",
    "gymnasium",
    "tensorboard",
    "wandb",
}
"""Packages of others that pages and messages name."""


def commands() -> dict[str, set[str]]:
    """Every `pip install` of a page or a message: its arguments, and the files that have it."""
    found: dict[str, set[str]] = {}
    for path in tracked():
        if path.suffix in {".md", ".py", ".toml"} and path.parts[len(ROOT.parts)] not in UNREAD:
            for match in COMMAND.finditer(path.read_text(encoding="utf-8")):
                for quoted, bare in WORD.findall(match[1]):
                    found.setdefault(quoted or bare, set()).add(path.name)
    return found


def is_ours(word: str) -> bool:
    """Whether a word is this package: a clone of it, or its name."""
    return word.startswith((".", DISTRIBUTION)) and not word.startswith("./")


OURS = sorted(word for word in commands() if is_ours(word))


def test_every_other_word_is_of_a_package_of_others() -> None:
    words = {word for word in commands() if not is_ours(word) and word[0] not in "-./{"}
    words -= {"constraints.txt"}
    assert {Requirement(word).name for word in words} <= OTHERS, words


def test_there_is_one_way_to_install_this_package() -> None:
    assert OURS
    form = re.compile(rf"{re.escape(SOURCE)}(\[[a-z,-]+\])?")
    wrong = {word: places for word, places in commands().items() if is_ours(word)}
    assert {word: files for word, files in wrong.items() if not form.fullmatch(word)} == {}


@pytest.mark.long
@pytest.mark.parametrize("word", OURS)
def test_what_is_named_installs_this_package(word: str, wheel: Path, tmp_path: Path) -> None:
    """In a new folder, without dependencies, from an index that has this package alone."""
    offline = [
        "--no-compile",
        "--no-deps",
        "--no-build-isolation",
        "--no-index",
        "--find-links",
        str(wheel.parent),
    ]
    command = ["-m", "pip", "install", "--pre", word, *offline]
    told = ran(*command, "--target", str(tmp_path / "site"), cwd=ROOT)
    assert told.returncode == 0, told.stderr
    assert "does not provide the extra" not in told.stdout + told.stderr
    assert (tmp_path / "site" / "duobench" / "core" / "machine.py").read_bytes() == (
        ROOT / "src" / "duobench" / "core" / "machine.py"
    ).read_bytes()
    (name,) = {path.name.partition("-")[0] for path in (tmp_path / "site").glob("*.dist-info")}
    assert name.replace("_", "-") == DISTRIBUTION


def test_messages_name_extras_that_exist() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["name"] == DISTRIBUTION
    assert "lerobot" in project["optional-dependencies"]
    assert f"pip install '{SOURCE}[lerobot]'" in install_extra("lerobot")


@pytest.mark.slow
def test_a_missing_package_is_told_with_an_extra_that_exists() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    named = [
        call.args[1].value
        for path in (ROOT / "src").rglob("*.py")
        for call in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(call, ast.Call) and getattr(call.func, "id", "") == "load_extra"
        if isinstance(call.args[1], ast.Constant)
    ]
    assert len(named) >= 7
    assert set(named) <= extras["optional-dependencies"].keys()
    assert load_extra("json", "hardware", "Nothing", BackendError) is json
    told = r"^Arms need it \(No module named 'absent_\w+'\)\. Install it .*\[hardware\]'$"
    with pytest.raises(BackendError, match=told):
        load_extra("absent_package", "hardware", "Arms need it", BackendError)


def test_extra_that_this_python_cannot_have_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    class Version(tuple[int, ...]):
        major, minor = 3, 11

    monkeypatch.setattr(sys, "version_info", Version((3, 11, 7)))
    assert install_extra("lerobot").startswith(
        "This is Python 3.11, and the extra lerobot needs Py"
    )
    monkeypatch.setattr(sys, "version_info", Version((3, 12, 0)))
    assert install_extra("lerobot").startswith(
        "Install it in a clone of the repository: pip install"
    )


def test_libraries_of_opengl_are_the_same_everywhere() -> None:
    """Those of pages and of what prepares a bare machine are the constant's."""
    for path in (page_of("install"), ROOT / "dev" / "system.sh", ROOT / "Dockerfile"):
        assert OPENGL_PACKAGES in path.read_text(encoding="utf-8"), path


@pytest.mark.parametrize(
    ("system", "architecture", "word"),
    [
        ("win32", "AMD64", "WSL 2"),
        ("darwin", "x86_64", "no wheel"),
        ("darwin", "arm64", ""),
        ("linux", "x86_64", ""),
        ("linux", "aarch64", ""),
    ],
)
def test_a_platform_that_cannot_have_it_is_told_what_to_do_in_one_sentence(
    system: str, architecture: str, word: str
) -> None:
    said = unsupported(system, architecture)
    assert bool(said) is bool(word)
    assert word in said
    assert said.count(".") == bool(word)


def test_the_command_says_it_before_anything_that_asks_for_posix_is_imported() -> None:
    """As on Windows, where `fcntl` and `termios` are not."""
    code = """
import sys
import gymnasium  # which finds out for itself where it is
sys.platform = "win32"
sys.modules.update(dict.fromkeys(("fcntl", "termios", "resource")))
import duobench_command
duobench_command.main()
"""
    done = ran("-c", code)
    assert done.returncode == 1
    assert "WSL 2" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("version", "said"),
    [
        (None, ""),
        (ENGINE, ""),
        (f"{ENGINE}.3", ""),
        (f"{ENGINE}1.0", f"MuJoCo {ENGINE}1.0 instead of {ENGINE}"),
        ("3.17.0", f"MuJoCo 3.17.0 instead of {ENGINE}"),
    ],
)
def test_another_minor_version_of_the_engine_is_named(version: str | None, said: str) -> None:
    assert other_engine({"mujoco": version}) == said


def test_the_engine_of_the_benchmark_is_the_one_that_is_installed() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    (pin,) = [one for one in map(Requirement, project["dependencies"]) if one.name == "mujoco"]
    assert pin.specifier.contains(f"{ENGINE}.99")
    major, minor = map(int, ENGINE.split("."))
    for other in (f"{major}.{minor + 1}", f"{major - 1}.99"):
        assert not pin.specifier.contains(other)
