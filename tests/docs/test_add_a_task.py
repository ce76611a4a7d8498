"""The page on adding a task: its code runs as printed, and its task can be solved."""

from __future__ import annotations

import importlib
import json
import shlex
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from duobench.tasks import catalog
from duobench.world.objects import mass_properties
from duobench.world.sim.simulation import Simulation
from tests.docs.markdown import ROOT, blocks, page_of, run
from tests.task_harness import TaskHarness

PAGE = page_of("add_a_task")
MAX_LINES = 80


def _block(part: str) -> str:
    """The one piece of Python on the page that holds a part."""
    (block,) = (block for block in blocks(PAGE, "python") if part in block)
    return block


TASK, EXPERT = _block("TASK = Task("), _block("def script(")


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The task of the page, saved as a module that can be imported."""
    (tmp_path / "stack_cube.py").write_text(TASK, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    return "stack_cube:TASK"


def test_the_task_is_short() -> None:
    assert len(TASK.splitlines()) < MAX_LINES


def test_its_use_in_python_runs(module: str, capsys: pytest.CaptureFixture[str]) -> None:
    names: dict[str, Any] = {}
    exec(_block('info["stage_to_subinstructions"]'), names)
    assert "red cube" in capsys.readouterr().out
    assert names["env"].get_wrapper_attr("definition") is catalog.get(module)
    assert names["env"].get_wrapper_attr("task") == "stack_cube"
    names["env"].close()


def test_its_objects_come_from_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The mug is that of the example, with its parts; the case opens as the page says."""
    monkeypatch.setitem(sys.modules, "trimesh", None)
    for file in (ROOT / "examples" / "mug").glob("mug.stl*"):
        shutil.copy(file, tmp_path)
    (source,) = blocks(PAGE, "xml")
    (tmp_path / "case.xml").write_text(source, encoding="utf-8")
    (tmp_path / "from_files.py").write_text(_block("mjcf_object("), encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    made = importlib.import_module("from_files")
    sim = Simulation((made.MUG, made.CASE))
    assert sim.angle("case/lid") == 0.0
    assert mass_properties(made.MUG.solid).mass == pytest.approx(0.15)


@pytest.mark.long
def test_its_commands_run_where_it_is_saved(tmp_path: Path) -> None:
    (tmp_path / "stack_cube.py").write_text(TASK + EXPERT, encoding="utf-8")
    lines = [line for block in blocks(PAGE, "sh") for line in block.splitlines()]
    assert [shlex.split(line)[1] for line in lines] == [
        "render",
        "eval",
        "eval",
        "record",
        "data",
        "export",
    ]
    for line in lines:
        run(line, tmp_path)
    overall = json.loads((tmp_path / "runs" / "expert" / "summary.json").read_text())["overall"]
    assert (overall["successes"], overall["episodes"]) == (1, 1)


def test_its_adversary_gets_nothing(module: str, capsys: pytest.CaptureFixture[str]) -> None:
    names: dict[str, Any] = {}
    exec(TASK + EXPERT + _block("def push("), names)
    assert capsys.readouterr().out == "push reaches stage 0\n"
    assert catalog.get(module).max_stage == names["TASK"].max_stage
    names["env"].close()


def test_its_expert_solves_it(module: str) -> None:
    names: dict[str, Any] = {}
    exec(TASK + EXPERT, names)
    play = TaskHarness(catalog.get(module))
    script: Callable[..., Any] = names["script"]
    for seed in (0, 1):
        play.start(seed)
        assert play.run_for(script, play.task.horizon) == play.task.max_stage, play.history
