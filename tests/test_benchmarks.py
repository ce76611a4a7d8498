import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.measure import Measurement, Work, seconds

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize(
    ("bars", "met", "text"),
    [
        ({}, True, ""),
        ({"at_most": 2.0}, True, "<= 2"),
        ({"at_most": 1.9}, False, "<= 1.9"),
        ({"at_least": 2.0}, True, ">= 2"),
        ({"at_least": 2.1}, False, ">= 2.1"),
    ],
)
def test_a_bar_is_met_or_missed(bars: dict[str, float], *, met: bool, text: str) -> None:
    measurement = Measurement(what="speed", value=2.0, **bars)
    assert measurement.met is met
    assert measurement.bar == text


def test_works_take_turns_after_their_preparation() -> None:
    order: list[str] = []

    def work(name: str) -> Work:
        return Work(
            prepare=lambda: order.append(f"prepare {name}"),
            pieces=[lambda: order.append(f"{name} 0"), lambda: order.append(f"{name} 1")],
        )

    times = seconds(work("a"), work("b"), repeats=2)
    once = ["prepare a", "prepare b", "a 0", "b 0", "a 1", "b 1"]
    assert order == once * 2
    assert all(time > 0 for time in times)


def test_the_command_prints_what_it_measured() -> None:
    command = [sys.executable, "-m", "benchmarks"]
    result = subprocess.run(
        [*command, "resets", "--tasks", "transfer_cube"],
        cwd=ROOT,
        check=False,
        capture_output=True,
        text=True,
    )
    assert "transfer_cube: reset" in result.stdout, result.stderr


def test_an_unknown_kind_is_refused() -> None:
    command = [sys.executable, "-m", "benchmarks", "colour"]
    result = subprocess.run(command, cwd=ROOT, check=False, capture_output=True, text=True)
    assert result.returncode == 2
    assert "known: imports" in result.stderr
