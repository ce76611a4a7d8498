"""The page on many machines: its commands run, and its script does what Slurm would have it do."""

import os
import shlex
import subprocess
import sys
from pathlib import Path

from duobench.results.source import read_source
from tests.docs.markdown import DOCS, blocks, table

PAGE = DOCS / "scale.md"


def run(words: list[str], folder: Path, **variables: str) -> str:
    environment = {**os.environ, **variables}
    result = subprocess.run(
        words, cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


def test_commands_run(tmp_path: Path) -> None:
    (commands,) = blocks(PAGE, "sh")
    said = [
        run([sys.executable, "-P", "-m", *shlex.split(line)], tmp_path)
        for line in commands.splitlines()
    ]
    assert "Report: runs/hold/index.html" in said[2]
    assert "3 episodes: exact 3" in said[3]
    assert "3 records" in said[4]


def test_script_plays_all_parts_of_an_array(tmp_path: Path) -> None:
    (script,) = blocks(PAGE, "bash")
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


def test_suites_are_those_of_the_code() -> None:
    from duobench.results.suites.catalog import SUITES

    rows = table(DOCS / "evaluation.md", "suite")
    assert [tuple(row.values()) for row in rows] == [
        (one.name, str(one.revision), str(one.episodes), str(one.execution.execute), one.purpose)
        for one in SUITES.values()
    ]
