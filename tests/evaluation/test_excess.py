"""Policies whose numbers have another unit, and honest ones."""

import numpy as np
import pytest

from duobench.envs.execution import ChunkExecution
from duobench.policy import HoldPolicy, PolicyMetadata
from duobench.results.report import read_parts
from duobench.results.scores import FAR_OFF
from duobench.results.suite import find_tasks
from duobench.world.robot.joints import JOINT_RANGES

GRIPPERS = [7, 15]
JOINTS = np.delete(np.arange(16), GRIPPERS)
HIGH = np.tile([*JOINT_RANGES[:, 1], 1.0], 2)


class InDegrees(HoldPolicy):
    metadata = PolicyMetadata(name="degrees", cameras=())

    def act(self, observation):
        action = super().act(observation).copy()
        action[:, JOINTS] = np.degrees(action[:, JOINTS])
        return action


class Bytes(HoldPolicy):
    """Opens for few steps, and is not clipped while it keeps the grippers closed."""

    metadata = PolicyMetadata(name="bytes", cameras=())
    full, open_for = 255.0, 3

    def __init__(self):
        super().__init__()
        self._step = 0

    def act(self, observation):
        action = super().act(observation).copy()
        self._step += 1
        action[:, GRIPPERS] = self.full * (self._step <= self.open_for)
        return action


class PerCent(Bytes):
    full, open_for = 90.0, 1000


class Exchanged(HoldPolicy):
    """Knows the left arm as the right one; after a second it is where it wants to be."""

    metadata = PolicyMetadata(name="exchanged", cameras=())

    def act(self, observation):
        return np.roll(super().act(observation), 8, axis=1)


class Diverges(HoldPolicy):
    metadata = PolicyMetadata(name="diverges", cameras=())

    def act(self, observation):
        return super().act(observation) * 1e6


class Hurries(HoldPolicy):
    """Wants to be far away at once, within the ranges."""

    metadata = PolicyMetadata(name="hurries", cameras=())

    def act(self, observation):
        action = super().act(observation).copy()
        action[:, [0, 8]] += 1.5
        return action


class Overshoots(HoldPolicy):
    """As learned policies do at an end of a range."""

    metadata = PolicyMetadata(name="overshoots", cameras=())

    def act(self, observation):
        action = super().act(observation).copy()
        action[:, GRIPPERS] = 1.03
        return action


class AtItsLimit(HoldPolicy):
    """Goes to the end of the ranges of two joints, and pushes on a little."""

    metadata = PolicyMetadata(name="limit", cameras=())

    def act(self, observation):
        now = np.array(observation["agent_pos"], dtype=np.float64)
        action = super().act(observation).copy()
        action[:, [6, 14]] = np.minimum(now[[6, 14]] + 0.08, HIGH[[6, 14]] + 0.04)
        return action


class Delta(HoldPolicy):
    """Displaces joints towards their ends, by more than they have left and can do in a step."""

    metadata = PolicyMetadata(name="delta", cameras=(), action_mode="joint_relative")

    def act(self, observation):  # noqa: ARG002 - always the same
        return np.tile([0.3] * 7 + [1.0], 2)[None]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("policy", "is_far_off"),
    [
        ("InDegrees", True),
        ("Bytes", False),  # for a few steps alone
        ("PerCent", True),
        ("Exchanged", True),
        ("Diverges", True),
        ("Hurries", True),
        ("Delta", True),
        ("Overshoots", False),
        ("AtItsLimit", False),
        ("HoldPolicy", False),
    ],
)
def test_a_run_says_that_targets_are_far_off_which_costs_nothing(
    play, policy: str, is_far_off: bool
) -> None:
    folder, results = play(f"{__name__}:{policy}", episodes=1)
    (part,) = read_parts(folder)
    assert part.is_far_off == is_far_off
    assert (FAR_OFF in folder.page.read_text()) == is_far_off
    assert results.overall.errors == 0
    assert all((one.excess is None) == (not one.clipped) for one in part.records)


@pytest.mark.parametrize(
    ("policy", "cells"),
    [
        ("InDegrees", ["-147.8 (-3.042)"]),
        ("Bytes", ["255 (1)"]),
        ("Exchanged", ["1.6"]),
    ],
)
def test_the_report_has_what_went_furthest(play, policy: str, cells: list[str]) -> None:
    folder, _ = play(f"{__name__}:{policy}", episodes=1)
    page = folder.page.read_text()
    table = page[page.index("Targets beyond limits</h2>") :]
    for cell in cells:
        assert f'<td class="right">{cell}</td>' in table


def test_the_peak_of_joint_speeds_is_kept_where_something_was_clipped(play) -> None:
    folder, _ = play(f"{__name__}:Hurries", episodes=1)
    (part,) = read_parts(folder)
    assert all(0.9 < one.excess.speed < 1.1 for one in part.records)


def test_a_latency_holds_the_arms_before_the_first_target(play) -> None:
    slow = ChunkExecution(latency=5)
    folder, _ = play(f"{__name__}:Exchanged", episodes=1, execution=slow)
    (part,) = read_parts(folder)
    here, exchanged = part.records[0].excess.first
    assert exchanged < 0.5 < here


def test_experts_are_told_nothing(play) -> None:
    folder, _ = play("expert", tasks=find_tasks(["carry_pot"]), episodes=1)
    (part,) = read_parts(folder)
    assert part.results.overall.successes == 1
    assert not part.is_far_off
