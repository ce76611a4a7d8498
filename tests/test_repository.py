"""What holds for the tracked files as a whole; a fresh clone is enough to tell."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest
from pathspec import GitIgnoreSpec

ROOT = Path(__file__).parents[1]
MEGABYTE = 1_000_000
TASK_LINES = 175

# Where packages are fetched from is for the machine to say. Put together here, so that this file
# does not name what it looks for.
REGISTRIES = re.compile(
    "|".join(
        re.escape(".".join(parts))
        for parts in [
            ("pypi", "org"),
            ("pythonhosted", "org"),
            ("npmjs", "org"),
            ("npmjs", "com"),
            ("conda", "anaconda", "org"),
            ("ghcr", "io"),
            ("docker", "io"),
            ("crates", "io"),
            ("proxy", "golang", "org"),
        ]
    )
)
MACHINE_PATH = re.compile(r"(?<![\w.~}$-])/(?:root|home|work|tmp|Users|opt|mnt)/[\w.$-]")


def tracked(folder: str = ".", suffix: str = "") -> list[Path]:
    """List the tracked files under a folder; where there is no git, all that it would not ignore.

    A file that was just deleted is left out.
    """
    git = shutil.which("git")
    if git and (ROOT / ".git").exists():
        # The checkout may belong to somebody else than the one who tests it.
        command = [git, "-c", "safe.directory=*", "ls-files", "-z"]
        listing = subprocess.run(command, cwd=ROOT, check=True, capture_output=True).stdout
        names = listing.decode().split("\0")
    else:
        ignored = GitIgnoreSpec.from_lines(
            [*(ROOT / ".gitignore").read_text().splitlines(), "/.git/"]
        )
        names = ignored.match_tree_files(ROOT, negate=True)
    paths = [ROOT / name for name in names if name.endswith(suffix)]
    return [path for path in paths if path.is_file() and path.is_relative_to(ROOT / folder)]


def text_of(path: Path) -> str:
    """Return the text of a file, or nothing where it is no text."""
    data = path.read_bytes()
    return "" if b"\0" in data else data.decode("utf-8")


def lines_of(path: Path) -> int:
    return len(path.read_text(encoding="utf-8").splitlines())


def findings(pattern: re.Pattern[str], paths: list[Path]) -> list[str]:
    return [
        f"{path.relative_to(ROOT)}:{number}: {match.group()}"
        for path in paths
        for number, line in enumerate(text_of(path).splitlines(), start=1)
        if (match := pattern.search(line))
    ]


def test_no_large_file_is_tracked() -> None:
    paths = tracked()
    assert ROOT / "pyproject.toml" in paths
    large = {str(path.relative_to(ROOT)): path.stat().st_size for path in paths}
    assert {name: size for name, size in large.items() if size > MEGABYTE} == {}


def test_no_package_registry_is_named() -> None:
    assert findings(REGISTRIES, tracked()) == []


def test_no_path_of_a_machine_is_named() -> None:
    assert findings(MACHINE_PATH, tracked()) == []


@pytest.mark.parametrize(
    ("line", "is_one"),
    [
        ("cd /" + "home/ada/duobench", True),
        ('open("/' + 'tmp/x")', True),
        ("https://host.example/" + "home/ada", False),
        ("src/data/x", False),
        ("runs/" + "work/x", False),
    ],
)
def test_a_path_of_a_machine_is_recognized(line: str, *, is_one: bool) -> None:
    assert bool(MACHINE_PATH.search(line)) is is_one


def test_task_files_stay_short() -> None:
    shared = {"__init__.py", "task.py", "catalog.py", "object_state.py"}
    files = [path for path in tracked("src/duobench/tasks", ".py") if path.parent.name == "tasks"]
    files = [path for path in files if path.name not in shared]
    lengths = {path.name: lines_of(path) for path in files}
    assert lengths
    assert {name: length for name, length in lengths.items() if length > TASK_LINES} == {}


def test_constraints_hold_names_and_versions_only() -> None:
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pins = [line for line in lines if not line.startswith("#")]
    assert pins
    assert [pin for pin in pins if not re.fullmatch(r"[A-Za-z0-9_.-]+==[0-9][\w.]*", pin)] == []
