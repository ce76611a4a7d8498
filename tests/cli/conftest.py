"""The command in this process: what it prints, and how it refuses."""

from collections.abc import Callable

import pytest

from duobench.cli import main

Told = Callable[..., str]


@pytest.fixture
def told(capsys: pytest.CaptureFixture[str]) -> Told:
    """Runs a command; what it printed."""

    def run(*words: object) -> str:
        capsys.readouterr()
        main([str(word) for word in words])
        return capsys.readouterr().out

    return run


def refusal(*words: object) -> str:
    """Why a command ended: its message, or its exit status."""
    with pytest.raises(SystemExit) as left:
        main([str(word) for word in words])
    return str(left.value.code)
