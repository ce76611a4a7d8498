import numpy as np
import pytest

from duobench.core.types import DuoCommand
from duobench.policy import BASELINES, Policy, PolicyMetadata, as_chunk, make
from duobench.world.robot.joints import JOINT_RANGES

OBSERVATION = {"agent_pos": np.linspace(-0.3, 0.3, 16), "tcp_pose": np.zeros(14)}


@pytest.mark.parametrize("name", BASELINES)
def test_baseline_speaks_the_protocol(name: str) -> None:
    policy = make(name)
    assert isinstance(policy, Policy)
    assert isinstance(policy.metadata, PolicyMetadata)
    assert policy.metadata.name == name
    assert policy.metadata.cameras == ()
    policy.reset("Do it.", seed=3)
    assert as_chunk(policy.act(OBSERVATION)).shape == (1, 16)


def test_zero_sends_zeros() -> None:
    assert not np.any(make("zero").act(OBSERVATION))


def test_random_follows_from_the_seed_alone() -> None:
    first, second = make("random"), make("random")
    second.act(OBSERVATION)
    for policy in (first, second):
        policy.reset("Do it.", seed=11)
    drawn = [np.vstack([policy.act(OBSERVATION) for _ in range(5)]) for policy in (first, second)]
    np.testing.assert_array_equal(*drawn)
    first.reset("Do it.", seed=12)
    assert not np.array_equal(first.act(OBSERVATION)[0], drawn[0][0])


def test_random_covers_the_action_space_and_nothing_else() -> None:
    policy = make("random")
    policy.reset("Do it.", seed=0)
    actions = np.vstack([policy.act(OBSERVATION) for _ in range(2000)])
    commands = [DuoCommand.from_flat(action) for action in actions]
    joints = np.array([command.joints for command in commands])
    openings = np.array([command.openings for command in commands])
    low, high = JOINT_RANGES.T
    assert np.all((joints >= low) & (joints <= high))
    assert np.all((openings >= 0) & (openings <= 1))
    margin = 0.02
    assert np.all(joints.min(axis=0) < low + margin * (high - low))
    assert np.all(joints.max(axis=0) > high - margin * (high - low))
    assert openings.min() < margin
    assert openings.max() > 1 - margin


def test_hold_keeps_the_first_posture_with_open_grippers() -> None:
    policy = make("hold")
    policy.reset("Do it.", seed=0)
    first = policy.act(OBSERVATION)[0]
    command = DuoCommand.from_flat(first)
    np.testing.assert_array_equal(
        command.joints, DuoCommand.from_flat(OBSERVATION["agent_pos"]).joints
    )
    np.testing.assert_array_equal(command.openings, 1.0)
    elsewhere = {"agent_pos": OBSERVATION["agent_pos"] + 1.0}
    np.testing.assert_array_equal(policy.act(elsewhere)[0], first)
    policy.reset("Do it.", seed=0)
    assert not np.array_equal(policy.act(elsewhere)[0], first)
