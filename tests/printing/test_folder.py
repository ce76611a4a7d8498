"""`duobench print`: the same bytes from the same command, and nobody's files lost."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from duobench.cli import main
from duobench.core.errors import FabricationError, LockedError
from duobench.core.files import locked
from duobench.core.randomness import episode_seed
from duobench.envs import RandomizedReset
from duobench.envs.sim_env import SimEnv
from duobench.printing import layout_sheet, write_prints
from duobench.tasks import catalog
from duobench.tasks.task import Task
from duobench.world.sim.placement import first_valid
from duobench.world.sim.simulation import Simulation
from tests.evaluation.processes import wait_until

THEIRS = """
from dataclasses import replace
from duobench.world.objects import RED, Prop, block
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
BIN_SORT = catalog.get("bin_sort")


def contents(folder: Path) -> dict[str, bytes]:
    files = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def printed(out: Path, *arguments: str) -> dict[str, bytes]:
    """What the command writes."""
    main(["print", *arguments, "--out", str(out)])
    return contents(out)


def process(out: Path, *arguments: str, **variables: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "duobench", "print", *arguments, "--out", str(out)]
    environment = {**os.environ, **variables}
    return subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL)


def failure(out: Path, *arguments: str) -> str:
    """Why the command writes nothing."""
    before = contents(out) if out.is_dir() else out.exists()
    with pytest.raises(SystemExit) as caught:
        main(["print", *arguments, "--out", str(out)])
    assert (contents(out) if out.is_dir() else out.exists()) == before
    return str(caught.value)


@pytest.mark.long
def test_every_task_is_written_and_the_same_in_another_process(tmp_path: Path) -> None:
    one, two = tmp_path / "one", tmp_path / "two"
    written = printed(one, "all")
    assert process(two, "all", PYTHONHASHSEED="7", TZ="Asia/Tokyo").wait() == 0
    assert contents(two) == written
    for name in catalog.names():
        files = {path.name for path in (one / name).iterdir()}
        assert {"layout.pdf", *FILES} <= files
        assert (f"{name}.3mf" in files) is (name != "carry_pot")


def test_the_same_command_writes_the_same_again(tmp_path: Path) -> None:
    before = printed(tmp_path, "bin_sort")
    (tmp_path / "bin_sort" / "recipe.md").unlink()
    (tmp_path / "bin_sort" / "notes.txt").write_text("mine")
    after = printed(tmp_path, "bin_sort")
    assert after.pop("bin_sort/notes.txt") == b"mine"
    assert after == before


def test_a_folder_with_other_files_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.md").write_text("years")
    assert "is not empty and holds no print" in failure(tmp_path, "bin_sort")
    assert "it is a file" in failure(tmp_path / "thesis.md", "bin_sort")
    assert contents(tmp_path) == {"thesis.md": b"years"}


def test_a_folder_of_another_choice_is_left_alone(tmp_path: Path) -> None:
    printed(tmp_path, "bin_sort")
    message = failure(tmp_path, "block_balance", "--paper", "a3")
    assert "tasks block_balance instead of bin_sort; paper a3 instead of a4" in message
    assert message.endswith("Give --out another folder.")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("ball_mase", "Did you mean 'ball_maze'?"),
        ("bin_sort --variants 11", "Unknown variant"),
        ("ball_maze --variants 11", "Unknown variant"),
    ],
)
def test_a_task_and_a_variant_that_there_is_not_are_errors(
    tmp_path: Path, words: str, message: str
) -> None:
    assert message in failure(tmp_path / "new", *words.split())


def test_an_evaluation_says_which_mazes_it_asks_for_and_what_to_buy(tmp_path: Path) -> None:
    trials = 4
    task = catalog.get("ball_maze")
    simulation = Simulation(task.props, task.overview)
    asked = {
        first_valid(simulation, task.layouts(episode_seed(task.id, index)), task.id).variants[
            "board"
        ]
        for index in range(trials)
    }
    written = printed(tmp_path, "ball_maze", "--trials", str(trials))
    floors = {name for name in written if "floor" in name and name.endswith(".stl")}
    assert len(floors) == len(asked) > 1
    page = written["README.md"].decode()
    assert f"the first {trials} episodes" in page
    for maze in asked:
        assert f"| ball_maze: board | {maze} |" in page
    assert "square of red film" in page
    assert "square of green film" in page
    (recipe,) = (json.loads(text) for name, text in written.items() if name.endswith("recipe.json"))
    for part in recipe["parts"]:
        grams = sum(part["filament_g"].values())
        if part["mass_g"] is not None:
            assert grams == pytest.approx(part["mass_g"][1], abs=0.3)
        for colour in part["filament_g"]:
            assert f"| {colour} | " in page
    assert "without --variants" in failure(
        tmp_path / "new", "ball_maze", "--trials", "2", "--variants", "1"
    )


def test_two_writers_do_not_mix(tmp_path: Path) -> None:
    with locked(tmp_path), pytest.raises(LockedError):
        write_prints(tmp_path, [BIN_SORT])


@pytest.mark.parametrize(
    ("tasks", "message"),
    [([BIN_SORT, BIN_SORT], "bin_sort"), ([replace(BIN_SORT, id="../evil")], "evil")],
)
def test_a_task_twice_or_outside_the_folder_is_refused_before_anything_is_written(
    tmp_path: Path, tasks: list[Task], message: str
) -> None:
    with pytest.raises(FabricationError, match=message):
        write_prints(tmp_path / "new", tasks)
    assert list(tmp_path.iterdir()) == []


def test_a_task_of_somebody_else_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "their_tasks.py").write_text(THEIRS)
    monkeypatch.syspath_prepend(str(tmp_path))
    printed(tmp_path / "new", "their_tasks:STACK")
    files = {path.name for path in (tmp_path / "new" / "stack").iterdir()}
    assert files == {*FILES, "layout.pdf", "stack.3mf", "brick.stl"}
    message = failure(tmp_path / "pole", "their_tasks:POLE")
    assert "pole cannot be printed: it is 300 × 20 × 20 mm" in message


def test_a_killed_command_is_continued(tmp_path: Path) -> None:
    whole, out = printed(tmp_path / "whole", "ball_maze"), tmp_path / "killed"
    killed = process(out, "ball_maze")
    wait_until((out / "ball_maze").exists, "the first folder")
    killed.send_signal(signal.SIGKILL)
    killed.wait()
    (out / "ball_maze" / f".x.stl.{killed.pid}.tmp").write_bytes(b"half")
    assert printed(out, "ball_maze") == whole


def test_a_seed_gives_the_layout_of_its_episode_and_its_maze(tmp_path: Path) -> None:
    files, task = printed(tmp_path, "ball_maze", "--seed", "3"), catalog.get("ball_maze")
    env = SimEnv(task)
    RandomizedReset(env).reset(seed=3)
    expected = layout_sheet(task, env.layout, "layout of seed 3")
    assert files["ball_maze/layout.pdf"] == expected
    board = env.layout.variants["board"]
    assert f"ball_maze/board_{board}-floor.stl" in files
    assert f"Maze {board}, seen" in files["ball_maze/recipe.md"].decode()
