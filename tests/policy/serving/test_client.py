"""The client against our server, against servers as others write them, and against bad ones."""

import hashlib
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import numpy as np
import pytest
from websockets.sync.server import ServerConnection

from duobench.core.errors import (
    ConnectionLostError,
    MachineryError,
    PolicyError,
    PolicyTimeoutError,
    ServingError,
)
from duobench.policy import Policy, PolicyMetadata, SessionPolicy, as_chunk
from duobench.policy.serving.address import RemoteServer
from duobench.policy.serving.client import VLLM_PATH, OpenpiPolicy
from duobench.policy.serving.codec import pack, unpack
from duobench.policy.serving.limits import MAX_REPLY, reply_bytes
from duobench.policy.serving.message_format import MessageFormat, read_format
from duobench.results.run import TimeLimits
from duobench.world.robot.cameras import Camera
from tests.evaluation.processes import wait_until
from tests.policy.serving.serving import (
    BATCHING,
    TIMEOUT_S,
    Serve,
    foreign_server,
    free_port,
    listening,
)
from tests.policy.serving.test_message_format import observation
from tests.policy.serving.test_server import Gated
from tests.policy.test_batch import Network, Refuses, observations

Connect = Callable[..., OpenpiPolicy]
CHUNK = np.arange(80, dtype=np.float32).reshape(5, 16)


@pytest.fixture
def remote(connect: Callable[..., Any]) -> Connect:
    return partial(connect, OpenpiPolicy)


def played(policy: Policy, seed: int) -> bytes:
    policy.reset("Do it.", seed)
    return b"".join(as_chunk(policy.act(seen)).tobytes() for seen in observations(seed))


def test_served_policy_answers_like_the_policy_itself(serve: Serve, remote: Connect) -> None:
    local = SessionPolicy(Network(), BATCHING)
    policy = remote(serve(Network(), key="s3cret"), key="s3cret")
    assert isinstance(policy, Policy)
    assert policy.metadata == Network.metadata
    assert remote(serve(Network()), execute=2).metadata == Network.metadata
    assert policy.batching == BATCHING
    for seed in (1, 2, 1):
        assert played(policy, seed) == played(local, seed)


class Sums(Network):
    """Gives a sum over all bits that each camera shows, with its weight by place."""

    metadata = PolicyMetadata(
        name="sums",
        version="1",
        robot="franka_hand wide",
        cameras=("head", {"name": "side", "position": (0, 1, 1), "look_at": (0, 0, 0)}),  # type: ignore[arg-type]
        depth=True,  # type: ignore[arg-type]
        segmentation=True,  # type: ignore[arg-type]
        image_sizes={"side": (24, 32)},
    )

    def act_batch(self, sessions: Any, observations: Any) -> Any:  # noqa: ARG002 - all the same
        return [self.sums(each) for each in observations]

    @staticmethod
    def sums(seen: Any) -> np.ndarray:
        chunk = np.zeros((1, 16), np.float32)
        for kind, dtype in (("pixels", "u1"), ("depth", "<f4"), ("segmentation", "<i4")):
            for image in seen[kind].values():
                assert image.dtype == dtype
                digest = hashlib.sha256(np.ascontiguousarray(image)).digest()
                chunk += np.frombuffer(digest, np.uint16).astype(np.float32)
        return chunk


def test_depth_and_parts_reach_a_served_policy_to_the_bit(serve: Serve, remote: Connect) -> None:
    policy, rng = remote(serve(Sums())), np.random.default_rng(0)
    assert policy.metadata == Sums.metadata
    assert isinstance(policy.metadata.cameras[1], Camera)
    policy.reset("Look.", 0)
    for height, width in ((24, 32), (720, 1280)):  # 20 MB, more than three images of colour
        shape = height, width
        seen = {
            "agent_pos": np.zeros(16, np.float32),
            "pixels": {"head": rng.integers(0, 256, (*shape, 3), np.uint8)},
            "depth": {name: rng.random(shape, np.float32) for name in ("head", "side")},
            "segmentation": {
                name: rng.integers(-1, 2**31 - 1, shape, np.int32) for name in ("head", "side")
            },
        }
        np.testing.assert_array_equal(policy.act(seen), Sums.sums(seen))
    with pytest.raises(ServingError, match="depth or segmentation, for which a message format"):
        remote(serve(Sums()), message_format=read_format("aloha"))


class Bereft(Network):
    """Asks somebody who is not there any more."""

    def __init__(self, asked: Policy) -> None:
        super().__init__()
        self._asked = asked

    def act_batch(self, sessions: Any, observations: Any) -> Any:  # noqa: ARG002 - all the same
        return [self._asked.act(each) for each in observations]


def test_policy_that_cannot_be_asked_is_no_fault_of_the_policy(
    serve: Serve, remote: Connect
) -> None:
    asked = remote(serve(Network()))
    serve.close()
    policy = remote(serve(Bereft(asked)))
    for _ in range(2):
        with pytest.raises(MachineryError, match=r"try again later\) The connection .* is lost"):
            played(policy, 1)


def test_part_of_a_chunk_may_be_executed_which_is_another_version(
    serve: Serve, remote: Connect
) -> None:
    policy = remote(serve(Network()), execute=1)
    policy.reset("Do it.", 0)
    assert np.shape(policy.act(observations(0)[0])) == (1, 16)
    assert policy.metadata.version == "None, first 1 actions of a chunk"


@pytest.fixture
def lost(serve: Serve, remote: Connect) -> tuple[int, OpenpiPolicy, bytes]:
    """A port that nothing serves any more, its client, and what the policy answered to seed 3."""
    port = serve(Network())
    policy = remote(port)
    expected = played(policy, 3)
    policy.reset("Do it.", 3)
    serve.close()
    return port, policy, expected


def test_connection_that_was_lost_between_episodes_is_made_again(serve: Serve, lost: Any) -> None:
    port, policy, expected = lost
    with pytest.raises(MachineryError, match="cannot be reached"):
        policy.reset("Do it.", 3)
    serve(Network(), port=port)
    assert played(policy, 3) == expected


def test_connection_that_is_lost_within_an_episode_is_no_fault_of_the_policy(
    serve: Serve, lost: Any
) -> None:
    port, policy, expected = lost
    serve(Network(), port=port)
    with pytest.raises(ConnectionLostError, match="is lost"):
        policy.act(observations(3)[0])
    with pytest.raises(MachineryError, match="is lost"):  # of an episode that the server forgot
        policy.act(observations(3)[0])
    assert played(policy, 3) == expected


def test_server_that_is_not_back_is_told_from_one_that_is(lost: Any) -> None:
    _, policy, _ = lost
    with pytest.raises(MachineryError, match=r"is lost: .* cannot be reached") as told:
        policy.act(observations(3)[0])
    assert not isinstance(told.value, ConnectionLostError)


def test_other_policy_at_the_same_address_does_not_go_on(serve: Serve, lost: Any) -> None:
    port, policy, _ = lost
    other = Network()
    other.metadata = PolicyMetadata(name="other")
    serve(other, port=port)
    with pytest.raises(MachineryError, match="another policy now"):
        policy.reset("Do it.", 0)


def test_server_that_comes_late_is_waited_for(serve: Serve, remote: Connect) -> None:
    port = free_port()
    later = threading.Timer(0.5, lambda: serve(Network(), port=port))
    later.start()
    assert remote(port, wait_s=TIMEOUT_S).metadata.name == "network"
    later.join()


def test_words_of_a_failing_policy_fail_the_episode_only(serve: Serve, remote: Connect) -> None:
    policy = remote(serve(Refuses()))
    policy.reset("Do it.", 0)
    with pytest.raises(PolicyError, match=r"(?s)reports:.*Traceback.*ZeroDivisionError: ones"):
        policy.act({"agent_pos": np.ones(16, np.float32)})
    assert played(policy, 1) == played(SessionPolicy(Network(), BATCHING), 1)


def test_late_answer_is_never_taken_for_the_next_one(serve: Serve, remote: Connect) -> None:
    gated = Gated()
    policy = remote(serve(gated), answer_s=0.5)
    policy.reset("Do it.", 1)
    with pytest.raises(PolicyTimeoutError, match=r"lives, but did not answer within 0\.5 s"):
        policy.act(observations(1)[0])
    gated.may.set()
    assert played(policy, 2) == played(SessionPolicy(Network(), BATCHING), 2)


def test_server_that_is_stuck_is_no_fault_of_the_policy(remote: Connect) -> None:
    held = threading.Event()  # openpi's own does nothing else meanwhile
    with foreign_server({}, lambda _message: held.wait(TIMEOUT_S) and None) as port:
        policy = remote(port, answer_s=0.5)
        policy.reset("Do it.", 0)
        with pytest.raises(ConnectionLostError, match="nor does it say"):  # it takes another one
            policy.act(observations(0)[0])
        held.set()
    with socket.create_server(("127.0.0.1", 0)) as silent:
        start = time.monotonic()
        with pytest.raises(MachineryError, match="cannot be reached"):
            remote(silent.getsockname()[1], answer_s=0.5)
        assert time.monotonic() - start < TIMEOUT_S


@pytest.mark.parametrize("key", [None, "wrong"])
def test_wrong_key_is_told_without_it(serve: Serve, remote: Connect, key: str | None) -> None:
    port = serve(Network(), key="s3cret")
    with pytest.raises(ServingError, match="refuses the key") as told:
        remote(port, key=key)
    assert "wrong" not in str(told.value)
    assert "s3cret" not in repr(RemoteServer(url="ws://x:1", key="s3cret"))


URLS = ("http://x:80", "127.0.0.1:80", "ws://", "ws://a:b@x:80", "ws://x:80/?key=1", "ws://x:port")


@pytest.mark.parametrize(
    "fields",
    [
        *({"url": url} for url in (*URLS, f"ws://{'x' * 64}:1", "ws://a b:1")),
        {"execute": 0},
        {"wait_s": float("inf")},
        *({"answer_s": seconds} for seconds in (float("inf"), float("nan"), 0.0)),
    ],
    ids=str,
)
def test_server_that_nobody_could_ask_is_refused_without_its_address(
    fields: dict[str, Any],
) -> None:
    given: dict[str, Any] = {"url": "ws://x:1"} | fields
    with pytest.raises(ServingError) as told:
        RemoteServer(**given)
    assert given["url"] not in str(told.value).replace("ws://HOST", "")


def test_endless_limit_of_an_evaluation_leaves_a_server_a_day() -> None:
    limits = TimeLimits(act_timeout=float("inf"))
    assert RemoteServer(url="ws://x:1", answer_s=limits.served_s).answer_s == 86_400
    assert TimeLimits(act_timeout=3.0).served_s == 3.0


@pytest.mark.parametrize(
    "told", [3, [], np.zeros(3), {"protocol": np.ones(2)}, {"protocol": 1}], ids=str
)
def test_server_that_describes_itself_wrongly_is_refused_and_left(
    remote: Connect, monkeypatch: pytest.MonkeyPatch, told: object
) -> None:
    left: list[object] = []
    drop = OpenpiPolicy._drop
    monkeypatch.setattr(OpenpiPolicy, "_drop", lambda self: (left.append(self), drop(self)))
    refused = pytest.raises(ServingError, match=r"version|wrongly")
    with foreign_server({"duobench": told}, lambda _message: None) as port, refused:
        remote(port)
    assert len(left) == 1


def of_ours(horizon: int | None = None) -> dict[str, Any]:
    """The first message of a server of ours."""
    facts = {"protocol": 1, "name": "toy", "cameras": [], "batch": "fixed", "max_batch": 1}
    return {"duobench": {**facts, "horizon": horizon}}


def test_second_answer_to_a_request_is_never_taken_for_the_next_one(remote: Connect) -> None:
    def serve_client(connection: ServerConnection) -> None:
        connection.send(pack(of_ours()))
        for number, _ in enumerate(connection):
            for _ in range(2 if number % 2 else 1):
                connection.send(pack({"actions": CHUNK + number}))

    def is_there() -> bool:
        connection = policy._connection
        return connection is not None and connection.recv_messages.frames.qsize() == 1

    with listening(serve_client) as port:
        policy = remote(port)
        for _ in range(2):  # the next episode is not the one to pay for it
            policy.reset("Do it.", 0)
            np.testing.assert_array_equal(policy.act({}), CHUNK + 1)
            wait_until(is_there, "a second answer")
        with pytest.raises(PolicyError, match="more than one answer to a request"):
            policy.act({})


@pytest.mark.parametrize("horizon", [None, 3])
def test_answer_beyond_the_largest_chunk_is_refused_before_it_is_decoded(
    remote: Connect, horizon: int | None
) -> None:
    most = reply_bytes(horizon)
    answers = iter([pack({}), pack({"actions": CHUNK, "x": bytes(most - 1000)}), bytes(most + 1)])
    with foreign_server(of_ours(horizon), lambda _message: next(answers)) as port:
        policy = remote(port)
        policy.reset("Do it.", 0)
        np.testing.assert_array_equal(policy.act({}), CHUNK)
        with pytest.raises(PolicyError, match=f"more than {most} bytes"):
            policy.act({})
    assert reply_bytes(3) < reply_bytes(None) < reply_bytes(10**9) == MAX_REPLY


Answering = Callable[[dict[str, Any]], Any]


@contextmanager
def foreign(
    remote: Connect, handshake: dict[str, Any], answer: Answering, path: str = "", **options: Any
) -> Iterator[tuple[OpenpiPolicy, list[dict[str, Any]]]]:
    """A client of a server that answers requests, and the requests."""
    seen: list[dict[str, Any]] = []

    def reply(message: bytes) -> bytes | str:
        seen.append(unpack(message))
        given = answer(seen[-1])
        return pack(given) if isinstance(given, dict) else given

    with foreign_server(handshake, reply) as port:
        yield remote(port, path, **options), seen


def test_plain_openpi_gets_a_connection_for_each_episode_and_its_own_keys(
    remote: Connect,
) -> None:
    chunk = {"actions": CHUNK, "state": np.zeros(16)}
    options = {"message_format": read_format("aloha"), "execute": 3}
    with foreign(remote, {}, lambda _request: chunk, **options) as (policy, seen):
        assert policy.metadata.cameras == ("head", "left_wrist", "right_wrist")
        policy.reset("Do it.", 5)
        first = policy._connection
        np.testing.assert_array_equal(policy.act(observation()), CHUNK[:3])
        policy.reset("Do that.", 6)
        assert policy._connection is not first
        policy.act(observation())
    assert [request["prompt"] for request in seen] == ["Do it.", "Do that."]
    assert seen[0].keys() == {"prompt", "images", "state"}
    assert seen[0]["images"]["cam_high"].shape == (3, 224, 224)


def test_roboarena_is_told_what_each_message_is(remote: Connect) -> None:
    def answer(request: dict[str, Any]) -> Any:
        return "reset successful" if request["endpoint"] == "reset" else {"actions": CHUNK}

    handshake = {"needs_session_id": True, "n_external_cameras": 1, "needs_wrist_camera": True}
    droid = read_format("droid")
    with foreign(remote, handshake, answer, message_format=droid) as (policy, seen):
        for seed in (1, 2):
            policy.reset("Do it.", seed)
            assert np.shape(policy.act(observation())) == (5, 16)
    assert [request["endpoint"] for request in seen] == ["reset", "infer"] * 2
    sessions = [request["session_id"] for request in seen]
    assert sessions[0] == sessions[1] != sessions[2] == sessions[3]


def test_vllm_gives_bare_arrays_and_takes_seeds(remote: Connect) -> None:
    array = pack({"a": CHUNK[None]})
    bare = array[array.index(b"\x84") :]
    error = {"type": "error", "message": "no such camera"}
    answers = iter([{"status": "reset successful"}, bare, bare, error])
    options = {"path": VLLM_PATH, "message_format": MessageFormat()}
    with foreign(remote, {}, lambda _request: next(answers), **options) as (policy, seen):
        policy.reset("Do it.", 9)
        for _ in range(2):
            np.testing.assert_array_equal(policy.act(observation()), CHUNK)
        with pytest.raises(PolicyError, match="no such camera"):
            policy.act(observation())
    assert [request.get("endpoint") for request in seen] == ["reset", None, None, None]
    assert {request["seed"] for request in seen} == {9}
    assert len({request["session_id"] for request in seen}) == 1
