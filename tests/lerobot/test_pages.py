"""The pages on LeRobot and on Parquet: what they print runs, in an environment with LeRobot."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("lerobot", reason="LeRobot is not installed here: make test-lerobot")

ROOT = Path(__file__).parents[2]
SMALL = shlex.split(
    "--policy.dim_model=32 --policy.n_heads=2 --policy.dim_feedforward=32 --policy.device=cpu "
    "--policy.n_encoder_layers=1 --policy.n_vae_encoder_layers=1 --batch_size=2 --num_workers=0 "
    "--policy.pretrained_backbone_weights=null --steps=1"
)
"""What makes a training small enough for a test; the last of two equal options counts."""


def blocks(page: str, language: str) -> list[str]:
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE)


def run(command: list[str], folder: Path) -> str:
    quiet = {"HF_HUB_OFFLINE": "1", "HF_DATASETS_OFFLINE": "1", "OMP_NUM_THREADS": "1"}
    folders = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    result = subprocess.run(
        command,
        cwd=folder,
        env={**os.environ, **quiet, "PATH": folders},
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


def shell(line: str, folder: Path) -> str:
    words = shlex.split(line.replace("\\\n", " "))
    if words[0] == "duobench":
        words = [sys.executable, "-P", "-m", *words]
    elif words[0] == "lerobot-train":
        words += SMALL
    return run(words, folder)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the first commands of the page on LeRobot have run."""
    folder = tmp_path_factory.mktemp("page")
    for line in blocks("lerobot.md", "sh")[0].splitlines():
        shell(line, folder)
    return folder


@pytest.mark.parametrize("line", blocks("lerobot.md", "sh")[1:])
def test_command_of_the_page_runs(line: str, folder: Path) -> None:
    shell(line, folder)


@pytest.mark.parametrize("code", [*blocks("lerobot.md", "python"), *blocks("parquet.md", "python")])
def test_code_of_the_pages_runs(code: str, folder: Path) -> None:
    assert run([sys.executable, "-c", code], folder)
