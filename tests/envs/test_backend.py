"""What is above a backend needs no simulation: it works on arms that are plain numbers."""

import math
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from duobench.core.types import DuoCommand
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
from duobench.evaluation.rollouts import Step, rollout
from duobench.policy.baselines import HoldPolicy
from duobench.tasks import catalog
from duobench.world.robot.mounts import HOME_JOINTS
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


OLD = "left_wrist 0.15 s, right_wrist nan s; at most 0.1 s is right."
REFLEX, SPACE_BAR = "The left arm reports a reflex.", "The operator pressed the space bar."
SPOILED: dict[str, dict[str, Any]] = {
    f"Images are too old: {OLD}": {
        "ages": {"head": 0.03, "left_wrist": 0.15, "right_wrist": math.nan}
    },
    REFLEX: {"fault": REFLEX},
    SPACE_BAR: {"held": SPACE_BAR},
}


@pytest.mark.parametrize("reason", SPOILED)
def test_arms_that_cannot_go_on_hold_and_truncate_the_episode(
    env: DuoEnv, arms: NumberArms, reason: str
) -> None:
    arms.ages = {"head": 0.1}
    *_, truncated, info = env.step(wave(0))
    assert (truncated, TRUNCATION_REASON in info) == (False, False)
    before = arms.last_command
    for name, value in SPOILED[reason].items():
        setattr(arms, name, value)
    *_, truncated, info = env.step(wave(5))
    assert (truncated, info[TRUNCATION_REASON], arms.held) == (True, reason, reason)
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
        arms.fault = REFLEX
        return NumberArms.command(arms, command)

    monkeypatch.setattr(arms, "command", command)
    *_, truncated, info = env.step(wave(1))
    assert (truncated, info[TRUNCATION_REASON]) == (True, REFLEX)
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
                arms.hold(SPACE_BAR)

        def on_episode_end(self, error: BaseException | None) -> None:
            assert error is None

    env = TimeLimit(TaskStages(DuoEnv(arms, TASK_DATA), Person()), horizon=50)
    env.unwrapped.config = EnvConfig(cameras=())  # type: ignore[attr-defined]
    operator = Operator()
    rollout(env, HoldPolicy(), seed=0, watchers=[operator])
    assert [step.truncated for step in operator.steps] == [False, False, True]
    assert operator.steps[-1].info[TRUNCATION_REASON] == SPACE_BAR
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
    """Joint 2 does not go down; openings are absolute."""
    relative = RelativeJointActions(env)
    assert relative.action_space.high[0] == pytest.approx(0.1)  # type: ignore[attr-defined]
    step, expected = np.zeros(16), np.zeros(16)
    step[[1, 2, 9]], expected[[2, 9]] = (-0.02, -0.02, 0.01), (-0.06, 0.03)
    step[[7, 15]] = 0.25, 0.75
    expected += DuoCommand(joints=HOME_JOINTS, openings=np.array([0.25, 0.75])).flat
    for _ in range(3):
        *_, info = relative.step(step)
    assert info["sent"] == pytest.approx(expected)


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
