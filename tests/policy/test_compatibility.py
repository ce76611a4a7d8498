from typing import Any

import gymnasium as gym
import pytest

import duobench
from duobench.envs.sim_env import SimEnv
from duobench.errors import PolicyError
from duobench.policy import PolicyMetadata
from duobench.policy.policy import check_fits
from duobench.tasks import catalog

TASK = "bin_sort"


def metadata(**fields: Any) -> PolicyMetadata:
    return PolicyMetadata(**{"name": "mine", "cameras": ()} | fields)


@pytest.mark.parametrize("mode", ["joint", "joint_relative", "cartesian", "cartesian_relative"])
def test_action_modes_are_told_apart(mode: str) -> None:
    env = duobench.make(TASK, cameras=False, action_mode=mode, binary_gripper=True)
    for other in ("joint", "joint_relative", "cartesian", "cartesian_relative"):
        if other == mode:
            check_fits(metadata(action_mode=other), env)
        else:
            with pytest.raises(PolicyError, match=f"'{other}', the environment's '{mode}'"):
                check_fits(metadata(action_mode=other), env)


def test_images_must_be_there_and_of_the_size() -> None:
    env = duobench.make(TASK, cameras=("head", "left_wrist"), image_size=(48, 64))
    check_fits(metadata(cameras=("head",)), env)
    check_fits(metadata(cameras=("left_wrist", "head"), image_size=(48, 64)), env)
    with pytest.raises(PolicyError, match="'right_wrist', the environment shows head, left_wrist"):
        check_fits(metadata(cameras=("right_wrist",)), env)
    with pytest.raises(PolicyError, match=r"of \(64, 48\), the environment's are \(48, 64\)"):
        check_fits(metadata(cameras=("head",), image_size=(64, 48)), env)


def test_every_problem_is_listed_with_an_environment_that_fits() -> None:
    env = duobench.make(TASK, cameras=False, chunk=4)
    wanted = metadata(
        cameras=("head",),
        image_size=(48, 64),
        object_state=True,
        action_mode="cartesian",
        control_rate_hz=10.0,
    )
    with pytest.raises(PolicyError) as refused:
        check_fits(wanted, env)
    message = str(refused.value)
    for part in (
        "shows none",
        "reads the state of the objects, which the environment does not show",
        "chunks of one length",
        "'cartesian'",
        "10 times a second, the environment 30",
        "duobench.make(task, cameras=('head',), image_size=(48, 64), object_state=True, "
        "action_mode='cartesian')",
    ):
        assert part in message


def test_environment_from_the_advice_fits() -> None:
    options = {"cameras": ("head",), "image_size": (48, 64), "action_mode": "cartesian"}
    options["object_state"] = True
    env = duobench.make(TASK, **options)
    check_fits(metadata(**options), env)
    check_fits(metadata(**options | {"object_state": False}), env)


def test_foreign_wrappers_change_nothing() -> None:
    env = gym.Wrapper(duobench.make(TASK, cameras=False, action_mode="cartesian"))
    check_fits(metadata(action_mode="cartesian"), env)
    with pytest.raises(PolicyError, match="'joint', the environment's 'cartesian'"):
        check_fits(metadata(), env)


@pytest.mark.parametrize("env", [SimEnv(catalog.get(TASK)), gym.make("CartPole-v1")])
def test_environment_without_a_configuration_is_refused(env: gym.Env) -> None:
    with pytest.raises(PolicyError, match=r"no configuration.*duobench\.make"):
        check_fits(metadata(), env)
