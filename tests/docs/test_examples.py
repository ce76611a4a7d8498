"""What pages show works as it stands there."""

from __future__ import annotations

import ast
import json
import os
import shlex
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tables import printed

import duobench
from dev.benchmarks import bounds
from duobench.cli import main
from duobench.core.randomness import EVAL, SUITE_VERSION, episode_seed
from duobench.evaluation import Step, rollout
from duobench.evaluation.replay.sources import LAYOUTS
from duobench.policy import Batching, BatchPolicy, SessionPolicy, make
from duobench.policy.lerobot_checkpoint import LAST, Address, parse
from duobench.policy.serving.message_format import read_format
from duobench.results.bundle import read_source
from duobench.results.folder import RunFolder
from duobench.tasks import catalog
from tests.docs.markdown import ROOT, attend, blocks, modules, page_of, run, run_python, table
from tests.policy.training.test_training import export
from tests.results.outcomes import play
from tests.web.pages import Page

COMPARISON, LEROBOT, POLICIES, PRINTING, ROBUSTNESS, SCALE, SERVING, VIEWING = (
    page_of(name)
    for name in (
        "comparison",
        "lerobot_policies",
        "policies",
        "printing",
        "robustness",
        "scale",
        "serving",
        "viewing",
    )
)


# --- comparison ----------------------------------------------------------------------------------


def test_the_command_writes_what_the_page_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, stage in (("small", 1), ("large", 2)):
        play(tmp_path / "runs" / name, {"carry_pot": [stage] * 3})
    (line,) = blocks(COMPARISON, "sh")
    main(shlex.split(line)[1:])
    written = {path.name for path in (tmp_path / "runs" / "compared").iterdir()}
    assert written == {
        "index.html",
        "comparison.json",
        "table.md",
        "table.csv",
        "table.tex",
        "figures",
    }


# --- policies; those that need LeRobot run in tests/lerobot --------------------------------------


def commands(verb: str) -> list[list[str]]:
    text = "\n".join(blocks(LEROBOT, "sh")).replace("\\\n", " ")
    lines = [shlex.split(line) for line in text.splitlines()]
    return [words[1:] for words in lines if words[:2] == ["duobench", verb]]


def test_trainings_of_the_page_can_be_planned(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for number, (verb, *words) in enumerate(commands("train")):
        named = words[words.index("--tasks") + 1] if "--tasks" in words else "bin_sort"
        folder = tmp_path / str(number)
        folder.mkdir()
        monkeypatch.chdir(folder)
        export(
            folder / words[words.index("--data") + 1], ("bin_sort" if named == "all" else named,)
        )
        main([verb, "--print", *words])
        assert "lerobot-train" in capsys.readouterr().out


def test_checkpoints_of_the_page_are_where_trainings_put_them() -> None:
    trainings = [words for words in commands("train") if "all" not in words]
    outputs = {words[words.index("--out") + 1] for words in trainings}
    policies = [words[words.index("--policy") + 1] for words in commands("eval")]
    assert [parse(name.removeprefix("lerobot:")) for name in policies] == [
        Address(checkpoint=f"{out}/{LAST}") for out in sorted(outputs)
    ]


@pytest.mark.long
def test_the_example_plays_an_episode_as_printed(tmp_path: Path) -> None:
    for name, code in modules(POLICIES).items():
        (tmp_path / name).write_text(code, encoding="utf-8")
    run(*blocks(POLICIES, "sh"), tmp_path)
    folder = RunFolder(tmp_path / "runs" / "vision")
    played = folder.read_run().candidate
    assert played.metadata.cameras == ("head", "left_wrist", "right_wrist")
    assert played.config.image_size == (64, 64)
    assert played.metadata.version is not None
    assert "source" not in played.metadata.version  # its own, not that of the module
    summary = json.loads(folder.summary.read_text(encoding="utf-8"))
    assert (summary["overall"]["episodes"], summary["overall"]["errors"]) == (1, 0)


class Steps(list[Step]):
    """Keeps all steps."""

    def on_episode_start(self, env: Any, observation: Any, info: Any) -> None:
        del env, observation, info

    def on_step(self, step: Step) -> None:
        self.append(step)

    def on_episode_end(self, error: BaseException | None) -> None:
        assert error is None


def test_the_loop_plays_what_a_rollout_plays() -> None:
    (loop,) = (block for block in blocks(POLICIES, "python") if "policy_seed" in block)
    played: dict[str, Any] = {}
    exec(loop, played)
    env, steps = duobench.make("bin_sort", cameras=False), Steps()
    rollout(env, make("random"), seed=0, watchers=[steps])
    env.close()
    np.testing.assert_array_equal(np.float32(played["action"]), steps[-1].action)


# --- printing ------------------------------------------------------------------------------------


def test_all_variants_of_an_object_print_as_the_table_says() -> None:
    for task in filter(lambda task: task.printable, map(catalog.get, catalog.names())):
        for prop in task.props:
            found = [printed(task.id, prop, value) for value in prop.variants]
            assert all(one == found[0] for one in found)


def test_the_example_of_prints_runs(capsys: pytest.CaptureFixture[str]) -> None:
    exec(*blocks(PRINTING, "python"), {})
    assert len(capsys.readouterr().out.splitlines()) == 3


@pytest.mark.slow
def test_the_commands_write_what_the_table_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (lines,) = blocks(PRINTING, "sh")
    for line in lines.splitlines():
        main(shlex.split(line)[1:])
    listed = [row["file"] for row in table(PRINTING, "file")]
    for file in listed:
        named = file.replace("TASK", "transfer_gate").replace("PART", "gate-ring")
        assert (tmp_path / "prints" / "gate" / named).exists(), file
    written = {path.suffix for path in (tmp_path / "prints" / "gate").rglob("*") if path.is_file()}
    assert written == {Path(file).suffix for file in listed if "." in file}
    boards = {path.name for path in (tmp_path / "prints" / "mazes" / "ball_maze").glob("board*")}
    task = catalog.get("ball_maze")
    layouts = [next(task.layouts(episode_seed(task.id, trial), EVAL)) for trial in range(15)]
    mazes = {f"board_{layout.variants['board']}" for layout in layouts}
    assert {name.partition("-")[0] for name in boards} == {"board", *mazes}


# --- robustness ----------------------------------------------------------------------------------


def test_the_command_of_bounds_is_that_of_the_program() -> None:
    assert blocks(ROBUSTNESS, "sh")[1].startswith("nice python -m dev.benchmarks.bounds --out ")


def test_bounds_are_measured_and_go_on_where_they_were(tmp_path: Path) -> None:
    job = bounds.Job(task="bin_sort", axis="latency", level=1, episodes=(0, 1))
    (first, second) = bounds.play(job)
    assert first.success
    assert first.steps > 100
    out = tmp_path / "bounds.jsonl"
    bounds.run([], out, 1)
    line = f'{{"suite": "{SUITE_VERSION}", "task": "bin_sort", "axis": "latency", "level": 1, '
    line += '"episode": 0, '
    out.write_text(line + '"stage": 4, "success": true, "steps": 150}\n' + line)
    done = bounds.read(out)
    assert len(done) == 1
    rest = bounds.Job(task="bin_sort", axis="latency", level=1, episodes=(1,))
    assert bounds.missing([job], done) == [rest]
    assert bounds.missing([job], [first, second]) == []
    fields = {name: getattr(first, name) for name in bounds.Outcome.__slots__}
    failed = bounds.Outcome(**{**fields, "success": False})
    assert "| `bin_sort` | **1/2** |" in bounds.table([first, failed], "latency")


# --- many machines: the script does what Slurm would have it do ----------------------------------


@pytest.mark.long
def test_script_plays_all_parts_of_an_array(tmp_path: Path) -> None:
    (script,) = blocks(SCALE, "bash")
    assert "--array=1-16" in script
    path = tmp_path / "eval.sh"
    path.write_text(script.replace("SHARDS=16", "SHARDS=2"))
    program = tmp_path / "bin" / "duobench"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -P -m duobench "$@"\n')
    program.chmod(0o755)
    words = ["--policy", "hold", "--tasks", "bin_sort", "--episodes", "2", "--videos", "0"]
    for number in ("1", "2"):
        run(
            ["bash", str(path), *words, "--out", "runs/mine"],
            tmp_path,
            PATH=f"{program.parent}:{os.environ['PATH']}",
            SLURM_ARRAY_TASK_ID=number,
            SLURM_CPUS_PER_TASK="1",
        )
    assert len(read_source(tmp_path / "runs" / "mine")[1]) == 2


# --- serving -------------------------------------------------------------------------------------


def observation(value: int) -> dict[str, Any]:
    image = np.full((224, 224, 3), value, np.uint8)
    pixels = dict.fromkeys(("head", "left_wrist", "right_wrist"), image)
    return {"agent_pos": np.zeros(16, np.float32), "tcp_pose": np.zeros(14), "pixels": pixels}


def test_shown_policy_sees_and_draws(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (source,) = (code for code in blocks(SERVING, "python") if code.startswith("import numpy"))
    (tmp_path / "my_vision.py").write_text(source)
    monkeypatch.syspath_prepend(tmp_path)
    policy = make("my_vision:MyVision")
    assert isinstance(policy, SessionPolicy)
    assert isinstance(policy._policy, BatchPolicy)
    chunks = []
    for value, seed in ((0, 1), (200, 1), (0, 2), (0, 1)):
        policy.reset("Do it.", seed)
        chunks.append(np.asarray(policy.act(observation(value))))
    assert chunks[0].shape == (30, 16)
    assert not np.array_equal(chunks[0], chunks[1])
    assert not np.array_equal(chunks[0], chunks[2])
    np.testing.assert_array_equal(chunks[0], chunks[3])
    dynamic = SessionPolicy(policy._policy, Batching(mode="dynamic"))
    dynamic.reset("Do it.", 1)
    np.testing.assert_allclose(dynamic.act(observation(0)), chunks[0], atol=1e-6)


def test_shown_format_is_one(tmp_path: Path) -> None:
    path = tmp_path / "shown.toml"
    path.write_text(*blocks(SERVING, "toml"))
    message_format = read_format(str(path))
    assert message_format.metadata("", "").cameras == ("head", "left_wrist")


def test_table_of_parameters_names_those_of_the_benchmark() -> None:
    source = ROOT / "examples/vla_eval/duobench_benchmark.py"
    (made,) = (
        node
        for node in ast.walk(ast.parse(source.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef) and node.name == "__init__"
    )
    rows = table(SERVING, "parameter")
    assert [row["parameter"] for row in rows] == [word.arg for word in made.args.kwonlyargs]


# --- viewing -------------------------------------------------------------------------------------


def look(line: str, folder: Path) -> dict[str, Any]:
    """Run a command, and look at its page until an episode or report is shown; the last status."""
    seen: dict[str, dict[str, Any]] = {"status": {}, "items": {}}
    followed = "--follow" in line

    def until_shown(page: Page) -> None:
        while not seen["status"].get("report" if followed else "instruction"):
            message = page.hear()
            seen[message["kind"]] = message
        if not followed:
            page.frame()

    attend(line, folder, until_shown, end=True)
    return seen["items"] | seen["status"]


@pytest.mark.long
@pytest.mark.slow
def test_commands_of_viewing_run(tmp_path: Path) -> None:
    shown = {}
    for line in "".join(blocks(VIEWING, "sh")).splitlines():
        if " view " in line:
            shown[line.split()[-1]] = look(line, tmp_path)
        else:
            run(line, tmp_path)
    assert len(shown["carry_pot"]["items"]) == LAYOUTS
    assert len(shown["data/expert"]["items"]) == 2
    assert shown["data/expert"]["steps"] > 0
    assert shown["--follow"]["run"]["finished"] == 2
    assert [item["state"] for item in shown["runs/expert"]["items"]] == ["success"] * 2
    (script,) = blocks(VIEWING, "python")
    run_python(script, tmp_path)
    log = (tmp_path / "data" / "expert" / "reviews.jsonl").read_text().splitlines()
    assert [json.loads(line).get("undo", False) for line in log] == [False, True]
