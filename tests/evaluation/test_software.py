"""A version number does not tell two checkouts apart; a run knows which source plays it."""

import subprocess
import sys
from pathlib import Path
from shutil import copytree, rmtree

import pytest

from duobench.core import versions
from duobench.core.errors import DuoBenchError, OtherRunError
from duobench.core.versions import package_source, part_hash, source_hashes
from tests.evaluation import toy_tasks
from tests.evaluation.conftest import Play

PACKAGE = Path(versions.__file__).parents[1]


def forget_hashes() -> None:
    """Let the source be read again."""
    versions._digest.cache_clear()  # pyright: ignore[reportPrivateUsage]


def change(monkeypatch: pytest.MonkeyPatch, *parts: str) -> None:
    """Let parts of the package have another source."""
    digest = versions._digest  # pyright: ignore[reportPrivateUsage]

    def other(path: Path, *without: frozenset[Path]) -> str:
        name = path.relative_to(PACKAGE).as_posix() if path.is_relative_to(PACKAGE) else path.name
        return "0" * 64 if name in parts else digest(path, *without)

    monkeypatch.setattr(versions, "_digest", other)


@pytest.mark.parametrize(
    ("part", "named"),
    [
        ("world/sim", "world/sim"),
        ("core/types.py", "core/types"),
        ("toy_tasks.py", toy_tasks.__name__),
    ],
)
def test_other_source_does_not_go_on_with_a_run(
    play: Play, monkeypatch: pytest.MonkeyPatch, part: str, named: str
) -> None:
    play("hold", episodes=1)
    change(monkeypatch, part)
    with pytest.raises(
        OtherRunError, match=rf"source of {named} 00000000 instead of [0-9a-f]{{8}}"
    ):
        play("hold", episodes=2)


def test_a_fix_of_what_decides_nothing_goes_on(play: Play, monkeypatch: pytest.MonkeyPatch) -> None:
    before, _ = play("hold", episodes=1)
    first = before.read_run()
    change(monkeypatch, ".")
    folder, _ = play("hold", episodes=2)
    run = folder.read_run()
    assert (run.hash, run.package) == (first.hash, "0" * 64)
    packages = [record.software.package for record in folder.read_records(run)]
    assert sorted(packages) == sorted([first.package, run.package] * 2)
    assert {record.software.decisive for record in folder.read_records(run)} == {
        first.software.decisive
    }


def test_scripts_of_experts_decide_where_an_expert_plays() -> None:
    assert "tasks/experts" in source_hashes(is_scripted=True)
    assert "tasks/experts" not in source_hashes()


def test_a_byte_of_a_part_changes_the_hash_of_that_part_alone(tmp_path: Path) -> None:
    copy = tmp_path / "duobench"
    copytree(PACKAGE, copy)
    parts = [*versions.SOURCES, *versions.SCRIPTED]
    before = {part: part_hash(copy, part) for part in parts}
    assert len(set(before.values())) == len(parts)
    for part in parts:
        path = copy / part
        file = path if path.is_file() else min(path.glob("*.py"))
        with file.open("ab") as opened:
            opened.write(b"#")
        forget_hashes()
        after = {each: part_hash(copy, each) for each in parts}
        assert [each for each in parts if after[each] != before[each]] == [part]
        before = after


def test_a_missing_part_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(DuoBenchError, match=r"core/types\.py is missing"):
        part_hash(tmp_path, "core/types.py")


def test_what_tools_leave_beside_the_source_is_none_of_it() -> None:
    before = package_source()
    rubbish, hidden = PACKAGE / "simulation.py.orig", PACKAGE / ".checkpoints"
    rubbish.write_text("rubbish")
    hidden.mkdir()
    (hidden / "simulation.py").write_text("rubbish")
    try:
        forget_hashes()
        assert package_source() == before
    finally:
        rubbish.unlink()
        rmtree(hidden)


def test_everything_that_an_environment_imports_decides() -> None:
    """What is left out computes nothing of an episode: words, files, loading by name."""
    script = (
        "import sys; sys.path.insert(0, 'SRC'); import duobench.envs.registration as r;"
        "import duobench.evaluation.rollout, duobench.evaluation.recorder;"
        "r.make('bin_sort', cameras=()).reset(seed=0);"
        "print('\\n'.join(name for name in sys.modules if name.startswith('duobench.')))"
    ).replace("SRC", str(PACKAGE.parent))
    found = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    parts = {name.removeprefix("duobench.").replace(".", "/") for name in found.stdout.splitlines()}
    decisive = set(source_hashes())
    left = {p for p in parts if not any(p == d or p.startswith(f"{d}/") for d in decisive)}
    assert {part for part in left if part.partition("/")[0] not in ("results", "policy")} == {
        "core",
        "core/errors",
        "core/files",
        "core/machine",
        "core/references",
        "core/versions",
        "evaluation",
        "world",
    }
