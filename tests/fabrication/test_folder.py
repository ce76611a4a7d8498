"""`duobench print`: the same bytes from the same command, and nobody's files lost."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from duobench.cli import main
from duobench.envs import RandomizedReset
from duobench.envs.sim_env import SimEnv
from duobench.errors import FabricationError, LockedError
from duobench.fabrication import layout_sheet, write_prints
from duobench.files import locked
from duobench.tasks import catalog

THEIRS = """
from dataclasses import replace
from duobench.objects import RED, Prop, block
from duobench.tasks import Placement, around, catalog

brick = Prop(name="brick", solid=lambda: block(0.06, 0.03, 0.02, RED))
pole = Prop(name="pole", solid=lambda: block(0.3, 0.02, 0.02, RED))
here = Placement(x=around(0.5, 0.1), y=around(0.0, 0.1), z=0.01)
STACK = replace(
    catalog.get("bin_sort"), id="stack", title="Stack", props=(brick,), placements={"brick": here}
)
POLE = replace(STACK, id="pole", props=(pole,), placements={"pole": here})
"""
FILES = {"recipe.json", "recipe.md"}


def command(out: Path, *arguments: str) -> list[str]:
    return [sys.executable, "-m", "duobench", "print", *arguments, "--out", str(out)]


def contents(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def failure(*arguments: str) -> str:
    with pytest.raises(SystemExit) as caught:
        main(["print", *arguments])
    return str(caught.value)


def test_every_task_is_written_and_the_same_in_another_process(tmp_path: Path) -> None:
    main(["print", "all", "--out", str(tmp_path / "one")])
    environment = {**os.environ, "PYTHONHASHSEED": "7", "TZ": "Asia/Tokyo"}
    subprocess.run(
        command(tmp_path / "two", "all"), check=True, env=environment, stdout=subprocess.DEVNULL
    )
    one, two = contents(tmp_path / "one"), contents(tmp_path / "two")
    assert one == two
    for name in catalog.names():
        files = {path.name for path in (tmp_path / "one" / name).iterdir()}
        assert {"layout.pdf", *FILES} <= files
        assert (f"{name}.3mf" in files) is (name != "carry_pot")
    assert {"coupon.3mf", *FILES} <= {p.name for p in (tmp_path / "one" / "coupon").iterdir()}
    shopping = (tmp_path / "one" / "shopping.md").read_text()
    for what in ("microwave", "cooking pot", "glass marble", "M3 × 20 mm screw"):
        assert what in shopping


def test_the_same_command_writes_the_same_again(tmp_path: Path) -> None:
    main(["print", "bin_sort", "--out", str(tmp_path)])
    before = contents(tmp_path)
    (tmp_path / "bin_sort" / "recipe.md").unlink()
    (tmp_path / "bin_sort" / "notes.txt").write_text("mine")
    main(["print", "bin_sort", "--out", str(tmp_path)])
    after = contents(tmp_path)
    assert after.pop("bin_sort/notes.txt") == b"mine"
    assert after == before


def test_a_folder_with_other_files_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.md").write_text("years")
    assert "is not empty and holds no print" in failure("bin_sort", "--out", str(tmp_path))
    assert contents(tmp_path) == {"thesis.md": b"years"}


def test_a_folder_of_another_choice_is_left_alone(tmp_path: Path) -> None:
    main(["print", "bin_sort", "--out", str(tmp_path)])
    before = contents(tmp_path)
    message = failure("block_balance", "--paper", "a3", "--out", str(tmp_path))
    assert "tasks block_balance instead of bin_sort; paper a3 instead of a4" in message
    assert message.endswith("Give --out another folder.")
    assert contents(tmp_path) == before


def test_a_misspelt_task_is_an_error_that_knows_better(tmp_path: Path) -> None:
    assert "Did you mean 'ball_maze'?" in failure("ball_mase", "--out", str(tmp_path / "new"))
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("task", ["bin_sort", "ball_maze"])
def test_a_variant_that_there_is_not_is_an_error(tmp_path: Path, task: str) -> None:
    message = failure(task, "--variants", "11", "--out", str(tmp_path / "new"))
    assert "Unknown variant" in message
    assert not (tmp_path / "new").exists()


def test_two_writers_do_not_mix(tmp_path: Path) -> None:
    with locked(tmp_path), pytest.raises(LockedError):
        write_prints(tmp_path, [catalog.get("bin_sort")])


def test_a_task_twice_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    task = catalog.get("bin_sort")
    with pytest.raises(FabricationError, match="bin_sort"):
        write_prints(tmp_path / "new", [task, task])
    assert not (tmp_path / "new").exists()


def test_a_task_cannot_write_outside_the_folder(tmp_path: Path) -> None:
    task = replace(catalog.get("bin_sort"), id="../evil")
    with pytest.raises(FabricationError, match="evil"):
        write_prints(tmp_path / "new", [task])
    assert list(tmp_path.iterdir()) == []


def test_a_file_in_the_place_of_the_folder_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "prints").write_text("mine")
    assert "it is a file" in failure("bin_sort", "--out", str(tmp_path / "prints"))
    assert (tmp_path / "prints").read_text() == "mine"


def test_a_task_of_somebody_else_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "their_tasks.py").write_text(THEIRS)
    monkeypatch.syspath_prepend(str(tmp_path))
    main(["print", "their_tasks:STACK", "--out", str(tmp_path / "new")])
    assert {path.name for path in (tmp_path / "new" / "stack").iterdir()} == {
        *FILES,
        *("layout.pdf", "stack.3mf", "brick.stl"),
    }
    message = failure("their_tasks:POLE", "--out", str(tmp_path / "pole"))
    assert "pole cannot be printed: it is 300 × 20 × 20 mm" in message
    assert not (tmp_path / "pole").exists()


def test_a_killed_command_is_continued(tmp_path: Path) -> None:
    main(["print", "ball_maze", "--out", str(tmp_path / "whole")])
    out = tmp_path / "killed"
    process = subprocess.Popen(command(out, "ball_maze"), stdout=subprocess.DEVNULL)
    deadline = time.monotonic() + 60
    while not (out / "ball_maze").exists() and time.monotonic() < deadline:
        time.sleep(0.001)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert (out / "ball_maze").exists()
    (out / "ball_maze" / f".x.stl.{process.pid}.tmp").write_bytes(b"half")
    main(["print", "ball_maze", "--out", str(out)])
    assert contents(out) == contents(tmp_path / "whole")


def test_a_seed_gives_the_layout_of_its_episode_and_its_maze(tmp_path: Path) -> None:
    main(["print", "ball_maze", "--seed", "3", "--out", str(tmp_path)])
    env = SimEnv(catalog.get("ball_maze"))
    RandomizedReset(env).reset(seed=3)
    expected = layout_sheet(catalog.get("ball_maze"), env.layout, "layout of seed 3")
    assert (tmp_path / "ball_maze" / "layout.pdf").read_bytes() == expected
    board = env.layout.variants["board"]
    assert (tmp_path / "ball_maze" / f"board_{board}-floor.stl").exists()
    assert f"Maze {board}, seen" in (tmp_path / "ball_maze" / "recipe.md").read_text()
