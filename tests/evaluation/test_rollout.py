"""One episode: which actions are executed when, what is rendered, and who is told of it."""

import asyncio

import gymnasium as gym
import numpy as np
import pytest

import duobench
from duobench.core.errors import OptionError, OtherRunError, PolicyError
from duobench.core.randomness import SPLITS, episode_seed, policy_seed
from duobench.envs import action_modes
from duobench.envs.execution import MAX_LATENCY, ChunkExecution, Step
from duobench.evaluation.replay.verify import Verdict, verify
from duobench.evaluation.rollout import rollout
from duobench.policy import HoldPolicy, make
from tests.evaluation import toy_tasks
from tests.evaluation.forging import redescribed, rewritten
from tests.evaluation.toy_tasks import HORIZON

WHOLE = ["start", *["step"] * HORIZON, "end"]


class Listener:
    """Writes down what it is told."""

    def __init__(self):
        self.heard: list[str] = []
        self.steps: list[Step] = []

    def on_episode_start(self, env, observation, info):
        self.heard.append("start")
        assert env.unwrapped
        assert "agent_pos" in observation
        assert info["stage"] == 0

    def on_step(self, step):
        self.heard.append("step")
        self.steps.append(step)

    def on_episode_end(self, error):
        self.heard.append("end" if error is None else f"end: {type(error).__name__}")

    @property
    def seen(self):
        """Control steps whose observation has images."""
        return [step.number for step in self.steps if "pixels" in step.observation]


class Numbered(HoldPolicy):
    """Holds, in chunks whose actions say, in the right opening, which call they answer, and which
    they are: 0.0201 is action 1 of call 2."""

    def __init__(self, length):
        super().__init__()
        self.length, self.calls = length, 0

    def act(self, observation):
        self.calls += 1
        chunk = np.repeat(super().act(observation), self.length, axis=0)
        chunk[:, -1] = [self.calls / 100 + number / 10_000 for number in range(self.length)]
        return chunk


def told(steps):
    """Pairs (call, action) that are executed."""
    return [divmod(round(10_000 * float(step.action[-1])), 100) for step in steps]


def in_order(length):
    """Such pairs of chunks of a length, one after the other."""
    return [(1 + number // length, number % length) for number in range(HORIZON + 12)]


@pytest.fixture(scope="module")
def env():
    env = duobench.make(toy_tasks.WAVE, cameras=False)
    yield env
    env.close()


@pytest.fixture(scope="module")
def seeing():
    env = duobench.make(toy_tasks.WAVE, cameras=("head",), image_size=(24, 32))
    yield env
    env.close()


def played(env, policy, *watchers, **options):
    listener = Listener()
    following = rollout(env, policy, seed=3, watchers=[listener, *watchers], **options)
    assert listener.heard == WHOLE
    assert [step.number for step in listener.steps] == list(range(1, HORIZON + 1))
    assert [step.truncated for step in listener.steps] == [False] * (HORIZON - 1) + [True]
    return listener, following


# --- chunks --------------------------------------------------------------------------------------


@pytest.mark.parametrize("length", [1, 5, 24, 100])
def test_actions_of_a_chunk_are_executed_in_order_until_the_end(env, length):
    policy = Numbered(length)
    listener, _ = played(env, policy)
    assert told(listener.steps) == in_order(length)[:HORIZON]
    assert policy.calls == -(-HORIZON // length)


@pytest.mark.parametrize("length", [1, 5])
def test_what_follows_an_episode_goes_on_where_the_chunk_was_cut_off(seeing, length):
    listener, following = played(seeing, Numbered(length))
    seeing.get_wrapper_attr("play_on")(36)
    steps = [next(following) for _ in range(12)]
    seeing.get_wrapper_attr("set_rendering")(True)  # as whoever plays on does afterwards
    assert [step.number for step in steps] == list(range(25, 37))
    assert told(steps) == in_order(length)[HORIZON:]
    assert [step.truncated for step in steps] == [False] * 11 + [True]
    seen = [step.number for step in steps if "pixels" in step.observation]
    assert seen == [number for number in range(25, 37) if number % length == 0]
    assert listener.heard == WHOLE


@pytest.mark.parametrize(
    ("length", "numbers"),
    [
        (5, [(1, 0), (1, 1), (1, 2), (2, 0), (2, 1), (2, 2), (3, 0)]),
        (2, [(1, 0), (1, 1), (2, 0), (2, 1), (3, 0)]),
    ],
)
def test_a_chunk_is_cut(env, length, numbers):
    listener, _ = played(env, Numbered(length), execution=ChunkExecution(execute=3))
    assert told(listener.steps)[: len(numbers)] == numbers


@pytest.mark.parametrize("latency", [1, 2, 3, 7])
@pytest.mark.parametrize("length", [1, 3])
def test_latency_delays_what_is_executed_and_nothing_else(env, length, latency):
    held = [(100, 0)] * latency  # the grippers are open at home
    listener, _ = played(env, Numbered(length), execution=ChunkExecution(latency=latency))
    assert told(listener.steps) == [*held, *in_order(length)][:HORIZON]


def test_the_policy_is_asked_at_the_same_steps_and_sees_the_images(seeing):
    execution = ChunkExecution(execute=4, latency=6)
    listener, _ = played(seeing, toy_tasks.Sees(), execution=execution)
    assert listener.seen == [4, 8, 12, 16, 20, 24]


@pytest.mark.parametrize("mode", action_modes.ACTION_MODES)
def test_arms_hold_their_command_in_every_action_mode(mode):
    env = duobench.make(toy_tasks.WAVE, cameras=False, action_mode=mode)
    _, info = env.reset(seed=1)
    for _ in range(5):
        sent = env.step(env.get_wrapper_attr("hold_action")())[4]["sent"]
        np.testing.assert_allclose(sent, info["sent"], atol=1e-5)
    env.close()


@pytest.mark.parametrize("fields", [{"execute": 0}, {"latency": -1}, {"latency": MAX_LATENCY + 1}])
def test_impossible_execution_is_refused(fields):
    with pytest.raises(OptionError, match=f"got {next(iter(fields.values()))}"):
        ChunkExecution(**fields)


def test_scripted_policy_is_told_of_the_latency(env):
    class Told(HoldPolicy):
        def expect_latency(self, steps):
            self.latency = steps

    policy = Told()
    rollout(env, policy, seed=0, execution=ChunkExecution(latency=4))
    assert policy.latency == 4


def test_latency_and_cut_are_in_what_decides_a_result_and_are_verified(play):
    execution = ChunkExecution(execute=3, latency=2)
    folder, results = play("random", episodes=1, execution=execution)
    (record, _) = (record for one in results.tasks for record in one.records)
    assert record.execution == folder.read_run().suite.execution == execution
    assert "latency of 2 control steps (67 ms)" in folder.page.read_text()
    for other, difference in (
        (ChunkExecution(execute=3), "latency 0 instead of 2"),
        (ChunkExecution(latency=2), "actions executed of a chunk all instead of 3"),
    ):
        with pytest.raises(OtherRunError, match=difference):
            play("random", episodes=1, execution=other)
    assert verify(folder, import_tasks=True).of(Verdict.EXACT)
    redescribed(folder, lambda run: run["suite"]["execution"].update(latency=9))
    for path in folder.path.glob("records/*/*/*.json"):
        rewritten(path, lambda record: record["execution"].update(latency=9))
    found = verify(folder, import_tasks=True).of(Verdict.CONTRADICTED)
    assert len(found) == 2
    assert "does not hold its command for a latency of 9 steps" in found[0].reason


# --- wrappers and images -------------------------------------------------------------------------


class Passes(gym.Wrapper):
    """A foreign wrapper that changes nothing."""


class Inverted(gym.ObservationWrapper):
    """A foreign wrapper that reads the images of every observation."""

    def observation(self, observation):
        return {**observation, "pixels": {"head": 255 - observation["pixels"]["head"]}}


class Floats(gym.Wrapper):
    """Another one, which says so by its observation space alone."""

    def __init__(self, env):
        super().__init__(env)
        images = gym.spaces.Dict(head=gym.spaces.Box(0, 1, (24, 32, 3)))
        self.observation_space = gym.spaces.Dict({**env.observation_space, "pixels": images})

    def step(self, action):
        observation, *rest = self.env.step(action)
        return {**observation, "pixels": {"head": observation["pixels"]["head"] / 255}}, *rest


class NeedsFrames(Listener):
    needs_frames = True


@pytest.mark.parametrize(
    ("wrappers", "watcher", "seen"),
    [
        ([], Listener, [5, 10, 15, 20]),
        ([Passes, Passes], Listener, [5, 10, 15, 20]),
        ([], NeedsFrames, list(range(1, HORIZON + 1))),
        ([Passes, Inverted, Passes], Listener, list(range(1, HORIZON + 1))),
        ([Passes, Floats, Passes], Listener, list(range(1, HORIZON + 1))),
    ],
)
def test_images_are_rendered_when_somebody_asks_for_them_through_any_wrappers(
    seeing, wrappers, watcher, seen
):
    env = seeing
    for wrapper in wrappers:
        env = wrapper(env)
    assert played(env, toy_tasks.Sees(), watcher())[0].seen == seen
    # Who steps the environment afterwards sees images again.
    assert "pixels" in env.reset(seed=0)[0]


@pytest.mark.parametrize("split", SPLITS)
def test_policy_gets_a_hash_of_the_seed(split):
    class Keeps(HoldPolicy):
        def reset(self, instruction, seed):
            super().reset(instruction, seed)
            self.seed = seed

    env, policy = duobench.make(toy_tasks.WAVE, cameras=False, split=split), Keeps()
    for seed in (0, 1, 2**32 - 1):
        rollout(Passes(env), policy, seed=seed)
        assert policy.seed == policy_seed("wave", seed, split) != seed
    env.close()


def test_step_has_the_reward_of_the_stage(env):
    listener = Listener()
    for index in range(4):
        rollout(env, make("random"), seed=episode_seed("wave", index), watchers=[listener])
    rewards = [step.reward for step in listener.steps]
    assert rewards == [step.info["stage"] / step.info["max_stage"] for step in listener.steps]
    assert max(rewards) > 0


# --- watchers ------------------------------------------------------------------------------------


def test_every_watcher_is_told_the_end_whatever_broke(env):
    class Breaks(Listener):
        def on_step(self, step):
            super().on_step(step)
            if step.number == 2:
                raise ZeroDivisionError

        def on_episode_end(self, error):
            super().on_episode_end(error)
            raise OSError

    before, breaks, after = Listener(), Breaks(), Listener()
    with pytest.raises(OSError):  # noqa: PT011 - it has no text
        rollout(env, HoldPolicy(), seed=0, watchers=[before, breaks, after])
    assert before.heard == breaks.heard == ["start", "step", "step", "end: ZeroDivisionError"]
    assert after.heard == ["start", "step", "end: OSError"]


class Refuses(HoldPolicy):
    def reset(self, instruction, seed):  # noqa: ARG002 - told to nobody
        raise asyncio.CancelledError


class Nan(HoldPolicy):
    def act(self, observation):
        return super().act(observation) * np.nan


@pytest.mark.parametrize(
    ("policy", "error", "message", "heard"),
    [
        (Refuses, asyncio.CancelledError, None, ["end: CancelledError"]),
        (toy_tasks.IsSlow, PolicyError, "acts 10 times a second", []),
        (Nan, PolicyError, "nan in action 0", ["start", "end: PolicyError"]),
    ],
)
def test_watcher_is_told_the_end_of_an_episode_without_a_step(env, policy, error, message, heard):
    listener = Listener()
    with pytest.raises(error, match=message):
        rollout(env, policy(), seed=0, watchers=[listener])
    assert listener.heard == heard
