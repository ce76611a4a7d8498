"""The page on many machines: its commands run, and its script does what Slurm would have it do."""

import os
import sys
from pathlib import Path

from duobench.results.bundle import read_source
from tests.docs.markdown import DOCS, blocks, run

PAGE = DOCS / "scale.md"


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
