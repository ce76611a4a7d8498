"""What moves arms or fingers from the command line waits for a word of its own."""

from __future__ import annotations

import io
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from duobench.real.drivers.simulated import SimulatedArm
from tests.cli.conftest import Told, refusal
from tests.real.sessions.operator import Stand

Types = Callable[[str], None]
REHEARSAL = ("--rig", "rehearsal", "--fast")


@pytest.fixture
def types(monkeypatch: pytest.MonkeyPatch) -> Types:
    """Have somebody type lines."""
    return lambda text: monkeypatch.setattr(sys, "stdin", io.StringIO(text))


def test_grippers_that_were_off_are_activated_at_a_word(types: Types, told: Told) -> None:
    said = told("real", "grippers", *REHEARSAL)
    assert said.count("not active") == 2
    types("activate\n")
    said = told("real", "grippers", *REHEARSAL, "--activate")
    assert "not active, " not in said
    assert said.count("gripper: active") == 2
    types("open\n")
    assert "opening 1.00" in told("real", "grippers", "--rig", "simulated", "--open", "left")


def test_home_asks_for_the_activation_first(types: Types, told: Told) -> None:
    types("activate\nhome\n")
    assert told("real", "home", *REHEARSAL).rstrip().endswith("Both arms are home.")


def test_home_asks_to_recover_what_was_left_wrong(
    types: Types, told: Told, monkeypatch: pytest.MonkeyPatch
) -> None:
    connect = SimulatedArm.connect

    def left_in_reflex(arm: SimulatedArm) -> None:
        connect(arm)
        arm.fail("cartesian_reflex")

    monkeypatch.setattr(SimulatedArm, "connect", left_in_reflex)
    types("recover\nhome\n")
    said = told("real", "home", "--rig", "simulated", "--fast")
    assert "everything answers" not in said
    assert "cartesian_reflex Is it set right" in said
    assert said.rstrip().endswith("Both arms are home.")


@pytest.mark.parametrize("typed", ["home\n", "", "activate\nyes\n"])
def test_without_the_word_nothing_moves(typed: str, types: Types) -> None:
    types(typed)
    assert "Nothing was moved." in refusal("real", "home", *REHEARSAL)


def test_order_of_an_evaluation_stays(tmp_path: Path) -> None:
    Stand(tmp_path, [("hold", "")], episodes=1, order_seed=1).ending.close()
    words = ("real", "eval", "--rig", "simulated", "--policy", "hold", "--task", "bin_sort")
    refused = refusal(*words, "--out", tmp_path, "--episodes", 1, "--order-seed", 2)
    assert "leave out --order-seed" in refused
