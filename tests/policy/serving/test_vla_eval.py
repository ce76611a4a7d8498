"""The client of vla-eval's protocol against a server that behaves, and against bad ones."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import msgpack
import numpy as np
import pytest

from duobench.core.errors import MachineryError, PolicyError, PolicyTimeoutError, ServingError
from duobench.core.types import POLICY_CAMERAS
from duobench.policy import Policy, PolicyMetadata
from duobench.policy.serving import limits
from duobench.policy.serving.message_format import MessageFormat, read_format
from duobench.policy.serving.vla_eval import VlaEvalPolicy, action_spec, observation_spec
from tests.policy.serving.model_server import Message, ModelServer, acting, frame
from tests.policy.serving.serving import TIMEOUT_S, Serve
from tests.policy.serving.test_message_format import observation
from tests.policy.test_batch import Network

Connect = Callable[..., VlaEvalPolicy]
THEIRS = np.concatenate([np.arange(7), np.arange(8, 15), [7, 15]]).astype(np.float32)
OURS = np.arange(16, dtype=np.float32)
CHUNK = np.stack([THEIRS, THEIRS + 100, THEIRS + 200])
HEAD_ALONE = MessageFormat(images={"images.head": "head"}, prompt="task_description")


@pytest.fixture
def remote(connect: Callable[..., Any]) -> Connect:
    return partial(connect, VlaEvalPolicy)


@contextmanager
def playing(remote: Connect, server: ModelServer, **options: Any) -> Iterator[VlaEvalPolicy]:
    """A client of a server whose episode has begun."""
    with server.running() as port:
        policy = remote(port, **options)
        policy.reset("Do it.", 0)
        yield policy


def test_conversation_is_that_of_the_protocol(remote: Connect) -> None:
    server = ModelServer(acting(CHUNK))
    with server.running() as port:
        policy = remote(port, execute=2)
        assert isinstance(policy, Policy)
        for seed in (5, 6):
            policy.reset("Do it.", seed)
            np.testing.assert_array_equal(policy.act(observation()), [OURS, OURS + 100])
        policy.close()
    kinds = [message["type"] for message in server.received]
    episode = ["episode_start", "observation", "episode_end"]
    assert kinds == ["hello", *episode, *episode]
    assert [message["seq"] for message in server.received] == list(range(1, 8))
    hello, start = server.received[:2]
    assert hello["payload"]["protocol_version"] == 1
    assert start["payload"] == {"task": {"name": "Do it.", "seed": 5}}
    shown = server.of("observation")[0]["payload"]
    assert shown.keys() == {"images", "states", "task_description"}
    assert shown["task_description"] == "Do it."
    np.testing.assert_array_equal(shown["states"], OURS)
    for camera, image in observation()["pixels"].items():
        np.testing.assert_array_equal(shown["images"][camera], image)
    assert server.connections == 1


def test_single_action_is_a_chunk_of_one(remote: Connect) -> None:
    with playing(remote, ModelServer(acting(THEIRS))) as policy:
        np.testing.assert_array_equal(policy.act(observation()), [OURS])


def test_metadata_is_that_of_the_format_and_what_the_server_tells(remote: Connect) -> None:
    hello = {"model_server": "Pi0ModelServer", "observation_params": {"send_state": True}}
    with ModelServer(acting(CHUNK), hello).running() as port:
        metadata = remote(port, execute=30).metadata
        version = metadata.version or ""
        expected = {"cameras": POLICY_CAMERAS, "image_size": (224, 224)}
        assert metadata == PolicyMetadata(name="Pi0ModelServer", version=version, **expected)
        assert version.startswith("vla-eval 0.8.0, Pi0ModelServer, format ")
        assert version.endswith("first 30 actions of a chunk")
        assert str(port) not in version
        assert remote(port, execute=2).metadata.version != version
        assert remote(port, execute=30, message_format=read_format("vla_eval")).metadata == metadata
    with ModelServer(acting(CHUNK)).running() as port:
        assert remote(port, message_format=HEAD_ALONE).metadata.cameras == ("head",)


@pytest.mark.parametrize("version", [0, 2, "1", None, True])
def test_other_version_of_the_protocol_is_refused_by_name(remote: Connect, version: object) -> None:
    told = rf"version {version!r} of vla-eval's protocol"
    server = ModelServer(acting(CHUNK), {"protocol_version": version})
    with server.running() as port, pytest.raises(ServingError, match=told):
        remote(port)


@pytest.mark.parametrize(
    ("hello", "message"),
    [
        ({"observation_params": {"send_wrist_image": True}}, "wrist images"),
        ({"observation_params": {"send_state": True}}, "asks for a state"),
        ({"observation_params": {"binary_gripper": True}}, "rounded"),
        (
            {"observation_params": {"control_mode": "cartesian_tquat", "relative_to": "last_step"}},
            "control_mode 'cartesian_tquat'",
        ),
        ({"action_spec": {"position": {"dims": 3, "format": "delta_xyz"}}}, "as delta_xyz"),
        ({"action_spec": {"left_joints": {"dims": 6, "format": "joint_positions"}}}, "6 numbers"),
        ({"action_spec": {"actions": {"dims": 20, "format": "raw"}}}, "have 20 numbers"),
        ({"observation_spec": {"state": {"dims": 42, "format": "x"}}}, "expects a state"),
        ({"observation_spec": {"left_wrist": {"format": "rgb_hwc_uint8"}}}, "'left_wrist'"),
        ({"action_spec": [1]}, "describes its policy wrongly"),
        ({"action_spec": {"a": {"dims": "many"}}}, "describes its policy wrongly"),
    ],
)
def test_server_that_contradicts_the_format_is_refused_before_the_first_step(
    remote: Connect, hello: Message, message: str
) -> None:
    server = ModelServer(acting(CHUNK), hello)
    with server.running() as port, pytest.raises(ServingError, match=message):
        remote(port, message_format=HEAD_ALONE)


FORMAT = read_format("vla_eval")
SPECS = {"action_spec": action_spec(FORMAT), "observation_spec": observation_spec(FORMAT)}


@pytest.mark.parametrize(
    "hello",
    [
        SPECS,
        {"action_spec": {"actions": {"name": "raw", "dims": 0, "format": "raw"}}},
        {"observation_params": {"send_state": True, "send_wrist_image": True, "seed": 0}},
        {"observation_params": {"control_mode": "JOINTS", "relative_to": "none"}},
        {"observation_spec": {"image": {"format": "rgb_hwc_uint8"}, "state": {"format": "raw"}}},
    ],
)
def test_server_that_agrees_or_says_little_is_taken(remote: Connect, hello: Message) -> None:
    with ModelServer(acting(CHUNK), hello).running() as port:
        assert remote(port).metadata.action_mode == "joint"


@pytest.mark.parametrize(
    ("payload", "message"),
    [
        ({"actions": np.zeros((3, 14), np.float32)}, r"\(H, 16\)"),
        ({"actions": np.full(16, np.nan, np.float32)}, "returned nan"),
        ({"actions": np.zeros((0, 16), np.float32)}, "H at least 1"),
        ({"actions": np.zeros((2, 3, 16), np.float32)}, r"\(H, 16\)"),
        ({"actions": "text"}, "array of numbers"),
        ({"actions": None}, "chunk of actions"),
        ({"actions": 3}, "chunk of actions"),
        ({"action": THEIRS}, "answers without 'actions'; it gives action"),
    ],
)
def test_answer_that_is_no_chunk_is_the_policys_fault(
    remote: Connect, payload: Message, message: str
) -> None:
    server = ModelServer(lambda asked: frame("action", payload, asked["seq"]))
    with playing(remote, server) as policy, pytest.raises(PolicyError, match=message):
        policy.act(observation())


@pytest.mark.parametrize("late_by", [0, 1])
def test_error_of_the_server_fails_its_episode_only(remote: Connect, late_by: int) -> None:
    """The error may be about the observation or about the start of the episode before it."""
    told = {"error": "observation_failed: KeyError: 'x'"}
    server = ModelServer(lambda message: frame("error", told, message["seq"] - late_by))
    with playing(remote, server) as policy:
        with pytest.raises(PolicyError, match=r"(?s)reports:.*KeyError"):
            policy.act(observation())
        server.answer = acting(CHUNK)
        policy.reset("Do it.", 1)
        np.testing.assert_array_equal(policy.act(observation())[0], OURS)


@pytest.mark.parametrize("off", [-2, 1, 1000])
def test_answer_to_another_question_throws_the_connection_away(remote: Connect, off: int) -> None:
    answers = iter([off, 0])
    server = ModelServer(
        lambda message: frame("action", {"actions": CHUNK}, message["seq"] + next(answers))
    )
    with playing(remote, server) as policy:
        for error, reason in ((PolicyError, "the answer is to"), (MachineryError, "is lost")):
            with pytest.raises(error, match=reason):
                policy.act(observation())
        policy.reset("Do it.", 0)
        np.testing.assert_array_equal(policy.act(observation())[0], OURS)
        assert server.connections == 2


@pytest.mark.parametrize(
    "reply",
    [
        "text",
        b"",
        b"\xc1",
        msgpack.packb([1, 2]),
        msgpack.packb({"type": "action", "payload": {}}),
        frame("action", [1], 1),
        frame("hello", {}, 1),
        frame("action", {"actions": {"__ndarray__": True, "data": bytes(8)}}, 1),
    ],
    ids=range(8),  # some hold the time, which no name may
)
def test_reply_that_is_no_message_is_the_policys_fault(remote: Connect, reply: bytes | str) -> None:
    server = ModelServer(lambda _message: reply)
    told = pytest.raises(PolicyError, match="sends what cannot be read")
    with playing(remote, server) as policy, told:
        policy.act(observation())


@pytest.mark.parametrize("lives", [True, False])
def test_late_answer_is_never_taken_for_the_next_one(remote: Connect, *, lives: bool) -> None:
    may = threading.Event()

    def answer(message: Message) -> bytes:
        assert may.wait(TIMEOUT_S)
        return frame("action", {"actions": CHUNK + len(server.received)}, message["seq"])

    server = ModelServer(answer, lives=lives)
    with playing(remote, server, answer_s=0.5) as policy:
        with pytest.raises(PolicyTimeoutError if lives else MachineryError, match=r"0\.5 s"):
            policy.act(observation())
        may.set()
        server.answer = acting(CHUNK)
        policy.reset("Do it.", 1)
        np.testing.assert_array_equal(policy.act(observation())[0], OURS)


def test_server_that_speaks_openpi_is_told_apart(remote: Connect, serve: Serve) -> None:
    with pytest.raises(MachineryError, match="no model server of vla-eval"):
        remote(serve(Network()))


def test_too_large_a_reply_is_refused_unread(
    remote: Connect,
) -> None:
    most = limits.reply_bytes(None)
    server = ModelServer(acting(np.zeros((most // 128 + 1, 16))))
    told = pytest.raises(PolicyError, match=f"more than {most} bytes")
    with playing(remote, server) as policy, told:
        policy.act(observation())
