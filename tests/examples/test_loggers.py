"""The example that logs an evaluation, with stand-ins for what it logs to."""

import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from duobench.cli import main
from tests.docs.markdown import ROOT
from tests.evaluation import toy_tasks

EXAMPLE = ROOT / "examples" / "loggers"
WORDS = ("eval", "--policy", "hold", "--out", "run", "--tasks", toy_tasks.WAVE_NAME)
SMALL = ("--episodes", "2", "--videos", "0", "--workers", "0")


@pytest.fixture
def log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What the stand-ins of both libraries were told."""
    told: list[Any] = []

    class SummaryWriter:
        def __init__(self, folder: str) -> None:
            told.append(folder)

        def add_text(self, name: str, text: str) -> None:
            told.append((name, text))

        def add_scalar(self, name: str, value: float, step: int) -> None:
            told.append((name, value, step))

        def flush(self) -> None:
            told.append("flush")

    wandb, tensorboard = ModuleType("wandb"), ModuleType("torch.utils.tensorboard")
    wandb.init = lambda **options: told.append(options)  # type: ignore[attr-defined]
    wandb.log = told.append  # type: ignore[attr-defined]
    tensorboard.SummaryWriter = SummaryWriter  # type: ignore[attr-defined]
    torch = ModuleType("torch")
    torch.device = type("device", (), {})  # type: ignore[attr-defined] - tyro looks for it
    for module in (wandb, torch, ModuleType("torch.utils"), tensorboard):
        monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.syspath_prepend(EXAMPLE)
    monkeypatch.chdir(tmp_path)
    return told


def test_weights_and_biases_hear_of_every_episode(log: list[Any]) -> None:
    main([*WORDS, *SMALL, "--observer", "loggers:WandB"])
    begun, *episodes = log
    assert (begun["project"], begun["name"]) == ("duobench", "hold")
    assert [each["episode"] for each in episodes] == [1, 2]
    assert {"wave/success", "wave/progress", "wave/steps", "success_rate"} < episodes[0].keys()


def test_tensorboard_goes_on_counting(log: list[Any]) -> None:
    main([*WORDS, *SMALL, "--observer", "loggers:TensorBoard"])
    assert log[:2] == ["logs", ("policy", "hold")]
    assert ("success_rate", 0.0, 2) in log
    log.clear()
    main([*WORDS, *SMALL, "--episodes", "3", "--observer", "loggers:TensorBoard"])
    assert {step for _, _, step in (each for each in log if len(each) == 3)} == {3}


def test_library_that_is_missing_is_named(
    log: list[Any], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    del log, capsys
    monkeypatch.setitem(sys.modules, "wandb", None)
    with pytest.raises(SystemExit, match=r"(?s)Observer 'loggers:WandB' has failed.*wandb"):
        main([*WORDS, *SMALL, "--observer", "loggers:WandB"])
