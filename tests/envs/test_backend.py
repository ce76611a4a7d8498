"""What is above a backend needs no simulation: it works on arms that are plain numbers."""

import math
import re
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from duobench.envs import (
    ActionChunks,
    BinaryGripper,
    Cameras,
    CartesianActions,
    RelativeCartesianActions,
    RelativeJointActions,
    TaskStages,
    TimeLimit,
)
from duobench.envs.config import EnvConfig
from duobench.envs.duo_env import TRUNCATION_REASON, DuoEnv, ResetNeededError
from duobench.evaluation.rollout import Step, rollout
from duobench.policy.baselines import HoldPolicy
from duobench.robot.joints import HOME_JOINTS
from duobench.tasks import catalog
from duobench.types import DuoCommand
from tests.envs.number_arms import NumberArms
from tests.envs.tools import TASK, wave
from tests.real_episode import Person

TASK_DATA = catalog.get(TASK)


@pytest.fixture
def arms() -> NumberArms:
    return NumberArms()


@pytest.fixture
def env(arms: NumberArms) -> DuoEnv:
    env = DuoEnv(arms, TASK_DATA)
    env.reset()
    return env


def spoil_images(arms: NumberArms) -> None:
    arms.ages = {"head": 0.03, "left_wrist": 0.15, "right_wrist": math.nan}


def break_down(arms: NumberArms) -> None:
    arms.fault = "The left arm reports a reflex."


def press_the_space_bar(arms: NumberArms) -> None:
    arms.hold("The operator pressed the space bar.")


SPOILERS = {
    r"too old: left_wrist 0\.15 s, right_wrist nan s; at most 0\.1 s": spoil_images,
    "The left arm reports a reflex": break_down,
    "The operator pressed the space bar": press_the_space_bar,
}


@pytest.mark.parametrize(("reason", "spoil"), SPOILERS.items(), ids=lambda part: str(part)[:12])
def test_arms_that_cannot_go_on_hold_and_truncate_the_episode(
    env: DuoEnv, arms: NumberArms, reason: str, spoil: Callable[[NumberArms], None]
) -> None:
    arms.ages = {"head": 0.1}
    *_, truncated, info = env.step(wave(0))
    assert not truncated
    assert TRUNCATION_REASON not in info
    before = arms.last_command
    spoil(arms)
    *_, truncated, info = env.step(wave(5))
    assert truncated
    assert re.search(reason, info[TRUNCATION_REASON])
    assert arms.held == info[TRUNCATION_REASON]
    assert arms.last_command is before, "nothing moves any more"
    assert info["sent"].tolist() == before.flat.tolist()
    with pytest.raises(ResetNeededError):
        env.step(wave(6))
    arms.ages, arms.fault = {}, None
    env.reset()
    assert arms.held is None
    *_, truncated, _ = env.step(wave(0))
    assert not truncated


def test_what_happens_during_a_step_ends_the_episode_with_it(
    env: DuoEnv, arms: NumberArms, monkeypatch: pytest.MonkeyPatch
) -> None:
    def command(command: DuoCommand) -> DuoCommand:
        break_down(arms)
        return NumberArms.command(arms, command)

    monkeypatch.setattr(arms, "command", command)
    *_, truncated, info = env.step(wave(1))
    assert truncated
    assert "reflex" in info[TRUNCATION_REASON]
    assert info["sent"] == pytest.approx(arms.last_command.flat)


def test_a_rollout_ends_where_the_arms_do_and_sees_why(arms: NumberArms) -> None:
    class Operator:
        """Holds the arms in the third step."""

        def __init__(self) -> None:
            self.steps: list[Step] = []

        def on_episode_start(self, *_arguments: object) -> None: ...

        def on_step(self, step: Step) -> None:
            self.steps.append(step)
            if step.number == 2:
                press_the_space_bar(arms)

        def on_episode_end(self, error: BaseException | None) -> None:
            assert error is None

    env = TimeLimit(TaskStages(DuoEnv(arms, TASK_DATA), Person()), horizon=50)
    env.unwrapped.config = EnvConfig(cameras=())  # type: ignore[attr-defined]
    operator = Operator()
    rollout(env, HoldPolicy(), seed=0, watchers=[operator])
    assert [step.truncated for step in operator.steps] == [False, False, True]
    assert operator.steps[-1].info[TRUNCATION_REASON] == "The operator pressed the space bar."
    assert not operator.steps[-1].info["success"]


def test_what_was_really_sent_is_reported(env: DuoEnv) -> None:
    action = env.backend.last_command.flat
    action[[1, 3, 7]] += [-0.05, 0.5, -0.4]
    *_, info = env.step(action)
    assert info["sent"] == pytest.approx(env.backend.last_command.flat)
    assert np.flatnonzero(info["clipped"]).tolist() == [1, 3]
    assert info["sent"][3] == pytest.approx(HOME_JOINTS[0, 3] + 0.1)
    assert info["sent"][7] == pytest.approx(0.6)


def test_relative_joint_actions_start_at_what_was_really_sent(env: DuoEnv) -> None:
    relative = RelativeJointActions(env)
    assert relative.action_space.high[0] == pytest.approx(0.1)  # type: ignore[attr-defined]
    down = np.zeros(16)
    down[[1, 2]] = -0.02
    for _ in range(3):
        *_, info = relative.step(down)
    assert info["sent"][1] == pytest.approx(HOME_JOINTS[0, 1])
    assert info["sent"][2] == pytest.approx(HOME_JOINTS[0, 2] - 0.06)


def test_cartesian_actions_move_the_tools(env: DuoEnv) -> None:
    relative = RelativeCartesianActions(CartesianActions(env))
    start = env.backend.read().tcp_poses
    shift = np.zeros(14)
    shift[9] = 0.01
    for _ in range(5):
        observation, *_ = relative.step(shift)
    moved = observation["tcp_pose"].reshape(2, 7)[1, :3] - start[1, :3]
    assert moved == pytest.approx([0.0, 0.0, 0.05], abs=0.002)


def test_cameras_chunks_and_grippers(arms: NumberArms) -> None:
    env: gym.Env = BinaryGripper(DuoEnv(arms, TASK_DATA))
    env = Cameras(ActionChunks(env, 3), ("head",), (4, 6))
    observation, _ = env.reset()
    action: Any = np.tile(arms.last_command.flat, (3, 1))
    action[:, 7] = 0.3
    observation, *_, info = env.step(action)
    assert info["executed"] == 3
    assert arms.last_command.openings.tolist() == [0.0, 1.0]
    assert observation["pixels"]["head"].shape == (4, 6, 3)
    assert arms.images_taken == [(("head",), (4, 6))] * 2
    assert arms.calls == ["start"]
    env.close()
    assert arms.calls == ["start", "stop", "close"]
