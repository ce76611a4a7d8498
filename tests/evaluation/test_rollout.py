import asyncio
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import duobench
from duobench.envs.execution import Step
from duobench.errors import PolicyError
from duobench.evaluation.rollout import Watcher, rollout
from duobench.policy import HoldPolicy, make
from duobench.randomness import SPLITS, episode_seed, policy_seed
from tests.evaluation import toy_tasks


class Listener:
    """Writes down what it is told."""

    def __init__(self) -> None:
        self.heard: list[str] = []
        self.steps: list[Step] = []

    def on_episode_start(self, env: gym.Env, observation: Any, info: Any) -> None:
        self.heard.append("start")
        assert env.unwrapped
        assert "agent_pos" in observation
        assert info["stage"] == 0

    def on_step(self, step: Step) -> None:
        self.heard.append("step")
        self.steps.append(step)

    def on_episode_end(self, error: BaseException | None) -> None:
        self.heard.append("end" if error is None else f"end: {type(error).__name__}")


class Counts(HoldPolicy):
    """Holds, in chunks whose actions can be told apart by the right gripper's opening."""

    def __init__(self, length: int) -> None:
        super().__init__()
        self.length = length
        self.sent = 0

    def act(self, observation: Any) -> Any:
        chunk = np.repeat(super().act(observation), self.length, axis=0)
        for row in chunk:
            self.sent += 1
            row[-1] = self.sent / 1000
        return chunk


@pytest.fixture(scope="module")
def env() -> Any:
    env = duobench.make(toy_tasks.WAVE, cameras=False)
    yield env
    env.close()


@pytest.mark.parametrize("length", [1, 5, 24, 100])
def test_actions_of_a_chunk_are_executed_in_order_until_the_end(env: gym.Env, length: int) -> None:
    listener, policy = Listener(), Counts(length)
    rollout(env, policy, seed=3, watchers=[listener])
    assert listener.heard == ["start", *["step"] * toy_tasks.HORIZON, "end"]
    numbers = list(range(1, toy_tasks.HORIZON + 1))
    assert [step.number for step in listener.steps] == numbers
    assert [round(1000 * step.action[-1]) for step in listener.steps] == numbers
    assert [step.truncated for step in listener.steps] == [False] * 23 + [True]
    assert policy.sent == -(-toy_tasks.HORIZON // length) * length


@pytest.mark.parametrize("length", [1, 5])
def test_what_follows_an_episode_goes_on_where_the_chunk_was_cut_off(length: int) -> None:
    env = duobench.make(toy_tasks.WAVE, cameras=("head",), image_size=(24, 32))
    listener = Listener()
    following = rollout(env, Counts(length), seed=3, watchers=[listener])
    env.get_wrapper_attr("play_on")(36)
    steps = [next(following) for _ in range(12)]
    env.close()
    numbers = list(range(25, 37))
    assert [step.number for step in steps] == numbers
    assert [round(1000 * step.action[-1]) for step in steps] == numbers
    assert [step.truncated for step in steps] == [False] * 11 + [True]
    seen = [step.number for step in steps if "pixels" in step.observation]
    assert seen == [number for number in numbers if number % length == 0]
    assert listener.heard == ["start", *["step"] * toy_tasks.HORIZON, "end"]


@pytest.mark.parametrize("split", SPLITS)
def test_policy_gets_a_hash_of_the_seed(split: str) -> None:
    class Keeps(HoldPolicy):
        def reset(self, instruction: str, seed: int) -> None:
            super().reset(instruction, seed)
            self.seed = seed

    env, policy = duobench.make(toy_tasks.WAVE, cameras=False, split=split), Keeps()
    for seed in (0, 1, 2**32 - 1):
        rollout(Passes(env), policy, seed=seed)
        assert policy.seed == policy_seed("wave", seed, split) != seed
    env.close()


class Passes(gym.Wrapper):
    """A foreign wrapper that changes nothing."""


def rendered(env: gym.Env, watcher: Watcher) -> list[int]:
    """Control steps whose observation has images."""
    listener = Listener()
    rollout(env, toy_tasks.Sees(), seed=3, watchers=[listener, watcher])
    return [step.number for step in listener.steps if "pixels" in step.observation]


def test_images_are_rendered_when_somebody_asks_for_them_through_any_wrappers() -> None:
    class NeedsFrames(Listener):
        needs_frames = True

    env = duobench.make(toy_tasks.WAVE, cameras=("head",), image_size=(24, 32))
    for wrapped in (env, Passes(Passes(env))):
        assert rendered(wrapped, Listener()) == [5, 10, 15, 20]
    assert rendered(env, NeedsFrames()) == list(range(1, toy_tasks.HORIZON + 1))
    # Who steps the environment afterwards sees images again.
    rendered(env, Listener())
    assert "pixels" in env.reset(seed=0)[0]
    env.close()


class Inverted(gym.ObservationWrapper):
    """A foreign wrapper that reads the images of every observation."""

    def observation(self, observation: Any) -> Any:
        return {**observation, "pixels": {"head": 255 - observation["pixels"]["head"]}}


class Floats(gym.Wrapper):
    """Another one, which says so by its observation space alone."""

    def __init__(self, env: gym.Env) -> None:
        super().__init__(env)
        images = gym.spaces.Dict(head=gym.spaces.Box(0, 1, (24, 32, 3)))
        inner: Any = env.observation_space
        self.observation_space = gym.spaces.Dict({**inner, "pixels": images})

    def step(self, action: Any) -> Any:
        observation, *rest = self.env.step(action)
        return {**observation, "pixels": {"head": observation["pixels"]["head"] / 255}}, *rest


@pytest.mark.parametrize("wrapper", [Inverted, Floats])
def test_wrappers_that_change_observations_get_images_at_every_step(wrapper: Any) -> None:
    env = duobench.make(toy_tasks.WAVE, cameras=("head",), image_size=(24, 32))
    assert len(rendered(Passes(wrapper(Passes(env))), Listener())) == toy_tasks.HORIZON
    env.close()


def test_step_has_the_reward_of_the_stage(env: gym.Env) -> None:
    listener = Listener()
    for index in range(4):
        rollout(env, make("random"), seed=episode_seed("wave", index), watchers=[listener])
    rewards = [step.reward for step in listener.steps]
    assert rewards == [step.info["stage"] / step.info["max_stage"] for step in listener.steps]
    assert max(rewards) > 0


def test_every_watcher_is_told_the_end_whatever_broke(env: gym.Env) -> None:
    class Breaks(Listener):
        def on_step(self, step: Step) -> None:
            super().on_step(step)
            if step.number == 2:
                raise ZeroDivisionError

        def on_episode_end(self, error: BaseException | None) -> None:
            super().on_episode_end(error)
            raise OSError

    before, breaks, after = Listener(), Breaks(), Listener()
    with pytest.raises(OSError):  # noqa: PT011 - it has no text
        rollout(env, HoldPolicy(), seed=0, watchers=[before, breaks, after])
    assert before.heard == ["start", "step", "step", "end: ZeroDivisionError"]
    assert breaks.heard == ["start", "step", "step", "end: ZeroDivisionError"]
    assert after.heard == ["start", "step", "end: OSError"]


def test_watcher_is_told_the_end_of_an_episode_that_never_began(env: gym.Env) -> None:
    class Refuses(HoldPolicy):
        def reset(self, instruction: str, seed: int) -> None:  # noqa: ARG002 - told to nobody
            raise asyncio.CancelledError

    listener = Listener()
    with pytest.raises(asyncio.CancelledError):
        rollout(env, Refuses(), seed=0, watchers=[listener])
    assert listener.heard == ["end: CancelledError"]


def test_policy_that_does_not_fit_is_refused_before_the_first_step(env: gym.Env) -> None:
    listener = Listener()
    with pytest.raises(PolicyError, match="acts 10 times a second"):
        rollout(env, toy_tasks.IsSlow(), seed=0, watchers=[listener])
    assert listener.heard == []


def test_chunk_of_nan_is_refused(env: gym.Env) -> None:
    class Nan(HoldPolicy):
        def act(self, observation: Any) -> Any:
            return super().act(observation) * np.nan

    listener = Listener()
    with pytest.raises(PolicyError, match="nan in action 0"):
        rollout(env, Nan(), seed=0, watchers=[listener])
    assert listener.heard == ["start", "end: PolicyError"]
