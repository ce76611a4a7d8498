"""What `duobench serve` and `duobench eval --server` say where something does not fit."""

from pathlib import Path

import pytest

from duobench.policy.serving.access import KEY_VARIABLE
from duobench.policy.serving.address import SERVED
from tests.cli.conftest import refusal


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("serve --policy hold --host 0.0.0.0", "could be used by anybody"),
        ("serve --policy hodl --port 0", "Did you mean 'hold'"),
        ("serve --policy hold --max-batch 0", "at least one observation"),
        ("serve --policy hold --key-file absent", "absent cannot be read"),
        ("eval --policy openpi", "--policy openpi and --server URL go together"),
        ("eval --policy hold --server ws://x:1", "openpi or vla-eval and --server"),
        ("eval --policy vla-eval", "--policy vla-eval and --server URL go together"),
        ("eval --policy vla-eval --server http://x:1", "ws://HOST:PORT"),
        ("eval --policy vla-eval --server ws://x:1 --batch fixed", "up to the server"),
        ("eval --policy vla_eval", "Did you mean 'vla-eval'"),
        ("eval --policy openpi --server x:1", "ws://HOST:PORT"),
        ("eval --policy hold --format aloha", "--format is for"),
        ("eval --policy openpi --server ws://x:1 --format alhoa", "Did you mean 'aloha'"),
    ],
)
def test_mistake_is_told_in_words_before_anything_begins(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: str, message: str
) -> None:
    monkeypatch.delenv(KEY_VARIABLE, raising=False)
    monkeypatch.chdir(tmp_path)
    out = ["--out", "run"] if words.startswith("eval") else []
    assert message in refusal(*words.split(), *out)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("policy", SERVED)
def test_server_that_is_not_there_is_told_without_its_address(tmp_path: Path, policy: str) -> None:
    words = ["eval", "--policy", policy, "--server", "ws://127.0.0.1:1", "--wait", "0"]
    refused = refusal(*words, "--workers", "0", "--out", tmp_path / "run")
    assert "The policy's server cannot be reached" in refused
    assert "127.0.0.1" not in refused
