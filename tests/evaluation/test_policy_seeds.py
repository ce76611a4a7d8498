"""No way to a policy carries the seed of the layout: real servers, and what they received."""

import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from duobench.core.randomness import TRAIN, policy_seed
from duobench.data import DataSet, Recording
from duobench.evaluation.policies import PolicyChoice
from duobench.evaluation.runners.evaluations import evaluate, record as record_demonstrations
from duobench.policy import HoldPolicy, Session
from duobench.policy.serving.address import RemoteServer
from duobench.policy.serving.client import VLLM_PATH
from duobench.policy.serving.codec import pack, unpack
from duobench.policy.serving.message_format import MessageFormat
from duobench.results.folder import RunFolder
from duobench.results.records import Record
from duobench.results.suite import find_tasks
from tests.evaluation import toy_batches
from tests.evaluation.conftest import small_suite
from tests.evaluation.toy_tasks import WAVE_NAME, seed_of
from tests.policy.serving.model_server import ModelServer, acting
from tests.policy.serving.serving import Serve, foreign_server, server_at

TASKS = ("wave", "nod")
EPISODES = 2
STILL = np.zeros((24, 16), np.float32)
BLIND = MessageFormat(state={"state": ("left_arm", "left_gripper", "right_arm", "right_gripper")})


def played(folder: Path, policy: str, server: RemoteServer | None = None) -> list[Record]:
    """Records of episodes of both tasks, whose seeds are those that the suite says."""
    choice = PolicyChoice(name=policy, server=server)
    results = evaluate(choice, small_suite(episodes=EPISODES), RunFolder(folder), workers=0)
    records = [record for task in results.tasks for record in task.records]
    assert [record.error for record in records] == [None] * len(TASKS) * EPISODES
    for record in records:
        assert record.policy_seed == policy_seed(record.task, record.seed) != record.seed
    return records


def leaves(message: Any) -> Iterator[Any]:
    """Everything in a message, keys included, but the numbers of arrays."""
    match message:
        case dict():
            for key, value in message.items():
                yield key
                yield from leaves(value)
        case list() | tuple():
            for value in message:
                yield from leaves(value)
        case np.ndarray():
            pass
        case _:
            yield message


def assert_secret(records: list[Record], messages: list[Any]) -> None:
    """The seeds of the layouts are in no message."""
    text = "\n".join(map(str, leaves(messages)))
    assert text
    for record in records:
        assert str(record.seed) not in text


def seeds(records: list[Record]) -> list[int | None]:
    """What a policy is told: the first observation is also shown in advance, twice."""
    return [record.policy_seed for record in (records[0], records[0], *records)]


class Notes(toy_batches.Wanders):
    """Notes the seeds of the episodes that it begins."""

    def __init__(self) -> None:
        super().__init__()
        self.seeds: list[int] = []

    def begin(self, instruction: str, seed: int) -> Session:
        if seed:  # that of sessions that fill a batch up is 0
            self.seeds.append(seed)
        return super().begin(instruction, seed)


def test_served_policy_gets_the_policy_seed(tmp_path: Path, serve: Serve) -> None:
    policy = Notes()
    records = played(tmp_path, "openpi", server_at(serve(policy)))
    assert policy.seeds == seeds(records)


@pytest.mark.parametrize("path", ["", VLLM_PATH])
def test_vllm_gets_the_policy_seed_in_all_messages_and_plain_openpi_no_seed(tmp_path, path):
    messages: list[Any] = []

    def answer(message: bytes) -> bytes:
        messages.append(unpack(message))
        is_reset = messages[-1].get("endpoint") == "reset"
        return pack({"status": "reset successful"} if is_reset else {"actions": STILL})

    with foreign_server({}, answer) as port:
        records = played(tmp_path, "openpi", server_at(port, path, message_format=BLIND))
    told = [leaf for leaf in leaves(messages) if leaf in seeds(records)]
    begun = [message["seed"] for message in messages if message.get("endpoint") == "reset"]
    assert begun == (seeds(records) if path else [])
    assert told == [message["seed"] for message in messages if path]
    assert_secret(records, messages)


@pytest.mark.slow
def test_model_server_of_vla_eval_gets_the_policy_seed(tmp_path):
    server = ModelServer(acting(STILL))
    with server.running() as port:
        records = played(tmp_path, "vla-eval", server_at(port))
    begun = [message["payload"]["task"]["seed"] for message in server.of("episode_start")]
    assert begun == seeds(records)
    assert_secret(records, server.received)


class Looks(HoldPolicy):
    """Fails unless its seed, and those of the global generators, are those of the policy.

    The first reset of an object is tried before, with generators that no episode has.
    """

    is_new = True

    def reset(self, instruction: str, seed: int) -> None:
        super().reset(instruction, seed)
        if self.is_new:
            self.is_new = False
            return
        task = "wave" if "wave" in instruction else "nod"
        assert seed in [seed_of(task, index) for index in range(EPISODES)]
        assert random.getstate() == random.Random(seed).getstate()
        first = np.random.RandomState(seed).random_sample()
        assert np.random.random_sample() == first  # noqa: NPY002 - the generator that policies share


@pytest.mark.slow
@pytest.mark.parametrize("workers", [0, 2])
def test_global_generators_have_the_policy_seed(tmp_path, workers):
    suite, policy = small_suite(episodes=EPISODES), f"{__name__}:Looks"
    results = evaluate(policy, suite, RunFolder(tmp_path), workers=workers)
    assert [record.error for task in results.tasks for record in task.records] == [None] * 4


class Demonstrates(HoldPolicy):
    """Fails unless it gets the policy's seed of an episode of the split of demonstrations."""

    def reset(self, instruction: str, seed: int) -> None:
        super().reset(instruction, seed)
        assert seed in [seed_of("wave", index, TRAIN) for index in range(EPISODES)]


def test_demonstrations_are_seeded_in_their_own_split(tmp_path):
    data = DataSet.open(tmp_path)
    options = {"episodes": EPISODES, "keep_failures": True, "workers": 0}
    policy = f"{__name__}:Demonstrates"
    attempts = record_demonstrations(policy, find_tasks([WAVE_NAME]), data, **options)
    assert [attempt.error for attempt in attempts] == [None] * EPISODES
    for index, path in enumerate(data.episodes()):
        info = Recording.read_info(path)
        assert info.seed is not None
        assert policy_seed("wave", info.seed, TRAIN) == seed_of("wave", index, TRAIN)
