"""Commands of docs/lerobot_policies.md; those that need LeRobot run in tests/lerobot."""

import shlex
from pathlib import Path

import pytest

from duobench.cli import main
from duobench.policy.lerobot_checkpoint import LAST, Address, parse
from tests.docs.markdown import ROOT, blocks
from tests.training.test_training import export

PAGE = ROOT / "docs" / "lerobot_policies.md"


def commands(verb: str) -> list[list[str]]:
    text = "\n".join(blocks(PAGE, "sh")).replace("\\\n", " ")
    lines = [shlex.split(line) for line in text.splitlines()]
    return [words[1:] for words in lines if words[:2] == ["duobench", verb]]


def test_trainings_of_the_page_can_be_planned(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for number, (verb, *words) in enumerate(commands("train")):
        named = words[words.index("--tasks") + 1] if "--tasks" in words else "bin_sort"
        task = "bin_sort" if named == "all" else named
        folder = tmp_path / str(number)
        export(folder / words[words.index("--data") + 1], (task,))
        monkeypatch.chdir(folder)
        main([verb, "--print", *words])
        assert "lerobot-train" in capsys.readouterr().out


def test_checkpoints_of_the_page_are_where_trainings_put_them() -> None:
    trainings = [words for words in commands("train") if "all" not in words]
    outputs = {words[words.index("--out") + 1] for words in trainings}
    policies = [words[words.index("--policy") + 1] for words in commands("eval")]
    assert [parse(name.removeprefix("lerobot:")) for name in policies] == [
        Address(checkpoint=f"{out}/{LAST}") for out in sorted(outputs)
    ]
