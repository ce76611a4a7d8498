"""A real server, real sockets, and peers that behave and misbehave."""

import asyncio
import http.client
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from duobench.core.errors import DuoBenchError, MachineryError, ServingError
from duobench.policy import Batching, Session, SessionPolicy
from duobench.policy.batch import PolicyPool
from duobench.policy.inference import InferenceLoop
from duobench.policy.serving import limits
from duobench.policy.serving.client import OpenpiPolicy
from duobench.policy.serving.codec import pack, unpack
from duobench.policy.serving.host import ClientSession, PolicyHost
from tests.evaluation.processes import wait_until
from tests.policy.serving.hostile import messages
from tests.policy.serving.serving import TIMEOUT_S, Serve, free_port
from tests.policy.test_batch import OBSERVATION, Counts, Network, Refuses, observations


class Gated(Network):
    """Answers once it may, and says when it was asked."""

    def __init__(self) -> None:
        super().__init__()
        self.asked, self.may = threading.Event(), threading.Event()

    def act_batch(self, sessions: Sequence[Session], observations: Sequence[dict]) -> np.ndarray:
        self.asked.set()
        assert self.may.wait(TIMEOUT_S)
        return super().act_batch(sessions, observations)


def dial(port: int, **options: Any) -> ClientConnection:
    return connect(f"ws://127.0.0.1:{port}", proxy=None, compression=None, **options)


@contextmanager
def joined(port: int, count: int = 1) -> Iterator[list[ClientConnection]]:
    """Clients that have heard the handshake."""
    with ExitStack() as leaving:
        clients = [leaving.enter_context(dial(port)) for _ in range(count)]
        for client in clients:
            client.recv(TIMEOUT_S)
        yield clients


def ask(client: ClientConnection, message: dict[str, Any]) -> dict[str, Any]:
    client.send(pack(message))
    reply = client.recv(TIMEOUT_S)
    assert isinstance(reply, bytes), reply
    return unpack(reply)


def health(port: int, timeout: float = TIMEOUT_S) -> tuple[int, bytes]:
    with closing(http.client.HTTPConnection("127.0.0.1", port, timeout=timeout)) as connection:
        connection.request("GET", "/healthz")
        response = connection.getresponse()
        return response.status, response.read()


def expected(seed: int, observation: dict[str, Any]) -> np.ndarray:
    policy = SessionPolicy(Network(), Batching(size=2))
    policy.reset("Do it.", seed)
    return np.asarray(policy.act(observation))


def test_session_is_that_of_the_protocol(serve: Serve) -> None:
    first, second = observations(seed=0, count=2)
    with dial(serve(Network())) as client:
        handshake = unpack(client.recv(TIMEOUT_S))
        assert handshake["duobench"]["name"] == "network"
        assert handshake["duobench"]["batch"] == "fixed"
        reply = ask(client, first | {"prompt": "Do it."})
        np.testing.assert_array_equal(reply["actions"], expected(0, first))
        assert reply["server_timing"].keys() == {"infer_ms", "policy_ms"}
        reply = ask(client, second | {"endpoint": "infer"})
        assert reply["server_timing"].keys() == {"infer_ms", "policy_ms", "prev_total_ms"}


def test_reset_seed_session_and_prompt_begin_episodes(serve: Serve) -> None:
    (observation,) = observations(seed=0, count=1)
    with joined(serve(Network())) as (client,):
        reset = {"endpoint": "reset", "prompt": "Do it.", "seed": 7}
        assert ask(client, reset) == {"status": "reset successful"}
        begun = expected(7, observation)
        changes: list[dict[str, Any]] = [{}, {"session_id": "b"}, {"prompt": "Do that."}]
        for change in changes:
            np.testing.assert_array_equal(ask(client, observation | change)["actions"], begun)
            going_on = ask(client, observation | change)["actions"]
            assert not np.array_equal(going_on, begun)
        other = ask(client, observation | {"seed": 8})["actions"]
        np.testing.assert_array_equal(other, expected(8, observation))


def test_error_is_told_in_text_and_ends_one_connection_only(serve: Serve) -> None:
    (good,) = observations(seed=0, count=1)
    with joined(serve(Refuses()), 2) as (client, other):
        client.send(pack({"agent_pos": np.ones(16, np.float32)}))
        assert "ZeroDivisionError: ones" in str(client.recv(TIMEOUT_S))
        words = "Internal server error. Traceback included in previous frame."
        assert close_of(client) == (1011, words)
        np.testing.assert_array_equal(ask(other, good)["actions"], expected(0, good))


def close_of(client: ClientConnection) -> tuple[int, str]:
    """Code and reason with which the server leaves."""
    with pytest.raises(ConnectionClosed) as closed:
        client.recv(TIMEOUT_S)
    assert closed.value.rcvd
    return closed.value.rcvd.code, closed.value.rcvd.reason


def test_endpoint_that_is_no_text_is_told_in_words(serve: Serve) -> None:
    with joined(serve(Network())) as (client,):
        client.send(pack({"endpoint": np.zeros(2)}))
        assert "is infer or reset" in str(client.recv(TIMEOUT_S))


def test_health_and_pings_are_answered_during_inference(serve: Serve) -> None:
    policy = Gated()
    port = serve(policy)
    with joined(port) as (client,):
        client.send(pack(observations(seed=0, count=1)[0]))
        assert policy.asked.wait(TIMEOUT_S)
        assert health(port) == (200, b"OK\n")
        assert client.ping().wait(TIMEOUT_S)
        policy.may.set()
        assert "actions" in unpack(client.recv(TIMEOUT_S))


def test_who_leaves_gives_the_place_back(serve: Serve) -> None:
    policy = Gated()
    first, second = observations(seed=0, count=2)
    with joined(serve(policy), 3) as (stays, leaves, also):
        for client in (stays, leaves, also):
            ask(client, {"endpoint": "reset", "prompt": "", "seed": 1})
        stays.send(pack(first))
        assert policy.asked.wait(TIMEOUT_S)
        waiting = serve.hosts[0]._loop._requests
        leaves.send(pack(first))
        wait_until(lambda: len(waiting) == 1, "a request waits")
        leaves.close()
        wait_until(waiting[0].cancelled, "it is taken back")
        also.send(pack(second))
        wait_until(lambda: len(waiting) == 2, "another one waits")
        policy.may.set()
        for client in (stays, also):
            assert "actions" in unpack(client.recv(TIMEOUT_S))
    assert len(policy.sizes) == 2


def test_silent_slow_and_deaf_peers_hold_nobody_up(serve: Serve) -> None:
    port = serve(Network())
    with ExitStack() as peers:
        for _ in range(8):
            silent, slow = (
                peers.enter_context(socket.create_connection(("127.0.0.1", port))) for _ in range(2)
            )
            assert silent.getpeername()  # it says nothing at all
            slow.sendall(b"GET / HTTP/1.1\r\nHost: x\r\n")  # and never the rest
            deaf = peers.enter_context(dial(port, close_timeout=0.1))
            for _ in range(40):
                deaf.send(pack(OBSERVATION))  # and never reads an answer
        half = peers.enter_context(dial(port, close_timeout=0.1))
        half.socket.sendall(b"\x82\xff" + (1 << 20).to_bytes(8, "big") + bytes(1000))
        (good,) = observations(seed=0, count=1)
        with joined(port) as (client,):
            for number in range(20):
                reply = ask(client, good | {"seed": number})
                np.testing.assert_array_equal(reply["actions"], expected(number, good))
            assert health(port) == (200, b"OK\n")
        half.socket.shutdown(socket.SHUT_RDWR)


def test_too_large_a_message_is_refused_unread(serve: Serve) -> None:
    with joined(serve(Network())) as (client,):
        with suppress(ConnectionClosed):
            client.send(bytes(limits.MAX_REQUEST + 1))
        assert close_of(client)[0] == 1009


@pytest.mark.parametrize(
    ("header", "is_let_in"),
    [
        ("Api-Key s3cret", True),
        ("Bearer s3cret", True),
        ("Api-Key wrong", False),
        ("Basic s3cret", False),
        ("s3cret", False),
        (None, False),
    ],
)
def test_key_opens_and_nothing_else(serve: Serve, header: str | None, *, is_let_in: bool) -> None:
    port = serve(Network(), key="s3cret")
    headers = {} if header is None else {"Authorization": header}
    if is_let_in:
        with dial(port, additional_headers=headers) as client:
            assert "duobench" in unpack(client.recv(TIMEOUT_S))
    else:
        assert refused(port, additional_headers=headers) == 401
    assert health(port) == (200, b"OK\n")


def refused(port: int, **options: Any) -> int:
    """The status with which a server turns a client away."""
    with pytest.raises(InvalidStatus) as told:
        dial(port, **options)
    return told.value.response.status_code


def test_page_in_a_browser_is_kept_out(serve: Serve) -> None:
    assert refused(serve(Network()), origin="https://page.example") == 403


@pytest.mark.parametrize(
    ("address", "message"),
    [
        ({"host": "0.0.0.0"}, "DUOBENCH_API_KEY"),
        ({"host": "::"}, "DUOBENCH_API_KEY"),
        ({"host": ""}, "DUOBENCH_API_KEY"),
        ({"host": "192.0.2.1"}, "DUOBENCH_API_KEY"),
        ({"host": "somewhere.example"}, "DUOBENCH_API_KEY"),
        ({"port": 70_000, "key": "key"}, "Cannot listen at"),
        ({"port": -1, "key": "key"}, "Cannot listen at"),
        ({"host": "x" * 64, "key": "key"}, "Cannot listen at"),
        ({"port": None}, r"Cannot listen at 127\.0\.0\.1:{port}"),
    ],
    ids=str,
)
def test_address_that_none_can_be_is_told(
    serve: Serve, address: dict[str, Any], message: str
) -> None:
    """Hosts that others reach need a key; None stands for a port that is taken."""
    taken = serve(Network())
    if "port" in address:
        address = address | {"port": taken if address["port"] is None else address["port"]}
    with pytest.raises(ServingError, match=message.format(port=taken)):
        PolicyHost(Network(), Network.metadata, Batching(), **address)


def test_clients_beyond_the_limit_take_the_place_of_a_silent_one_or_are_turned_away(
    serve: Serve, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(limits, "MAX_CONNECTIONS", 2)
    port = serve(Network())
    reset = {"endpoint": "reset", "prompt": "", "seed": 1}
    with joined(port, 2) as (playing, silent):
        ask(playing, reset)
        with joined(port) as (other,):
            assert "Others need the place" in close_of(silent)[1]
            ask(other, reset)
            assert refused(port) == 503


# --- a plain policy has places, which silent clients do not keep from others ----------------------


class Long(Counts):
    """Its answers are longer than what connections hold for one that does not read."""

    def act(self, observation: Any) -> np.ndarray:
        return np.tile(super().act(observation), (10_000, 1))


@pytest.fixture
def places(serve: Serve, monkeypatch: pytest.MonkeyPatch) -> Callable[[type[Counts]], int]:
    """Serves a plain policy with two places, at the port that is returned."""
    monkeypatch.setattr(limits, "SILENT_S", 0.5)

    def start(kind: type[Counts]) -> int:
        return serve(PolicyPool(kind(), kind, size=2), batching=Batching(mode="dynamic", size=2))

    return start


Places = Callable[[type[Counts]], int]


def count(client: ClientConnection) -> float:
    """How many answers the episode has had, by what its object of the policy counts."""
    return float(ask(client, OBSERVATION)["actions"][0, 0])


def test_who_was_silent_longest_gives_its_place_to_one_that_needs_it(places: Places) -> None:
    with joined(places(Counts), 4) as (first, second, third, fourth):
        assert [count(each) for each in (second, first, second)] == [1, 1, 2]
        assert count(third) == 1
        assert close_of(first) == (1013, "Others need the place.")
        assert count(fourth) == 1
        assert close_of(second) == (1013, "Others need the place.")
        assert [count(each) for each in (third, fourth)] == [2, 2]


def test_clients_that_never_read_give_their_places_too(serve: Serve, places: Places) -> None:
    with ExitStack() as peers:
        port = places(Long)
        for _ in range(2):
            deaf = peers.enter_context(dial(port, close_timeout=0.1, max_queue=1))
            deaf.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            for _ in range(20):
                deaf.send(pack(OBSERVATION))
            peers.callback(deaf.socket.shutdown, socket.SHUT_RDWR)
        sessions = serve.hosts[0]._clients.values()
        latest = limits.SILENT_S + 0.2
        wait_until(
            lambda: (
                len(sessions) == 2
                and all(time.monotonic() - each.silent_since > latest for each in sessions)
            ),
            "they block the server's answers",
        )
        assert all(each.is_playing for each in sessions)
        for _ in range(2):
            (client,) = peers.enter_context(joined(port))
            assert count(client) == 1


def asks_on(peer: socket.socket, is_over: threading.Event) -> None:
    """Ask again and again over a plain socket, and read nothing at all."""
    peer.sendall(
        b"GET / HTTP/1.1\r\nHost: x\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        b"Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n\r\n"
    )
    request = pack(OBSERVATION)
    frame = b"\x82\xfe" + len(request).to_bytes(2, "big") + bytes(4) + request  # masked with zeros
    with suppress(OSError):
        while not is_over.wait(0.02):
            peer.sendall(frame)


def test_clients_that_go_on_asking_without_reading_give_their_places(places: Places) -> None:
    port, is_over = places(Counts), threading.Event()
    with ExitStack() as peers:
        peers.callback(is_over.set)
        for _ in range(2):
            deaf = peers.enter_context(socket.create_connection(("127.0.0.1", port)))
            threading.Thread(target=asks_on, args=(deaf, is_over), daemon=True).start()
        time.sleep(2 * limits.SILENT_S)
        (client,) = peers.enter_context(joined(port))
        assert [count(client) for _ in range(3)] == [1, 2, 3]


def test_slow_client_keeps_its_episode_while_there_are_places(places: Places) -> None:
    with joined(places(Counts), 2) as (slow, quick):
        assert count(slow) == 1
        time.sleep(1.5 * limits.SILENT_S)
        assert count(quick) == 1
        assert count(slow) == 2


class Waits(Counts):
    """Takes longer for an answer than clients may be silent."""

    def act(self, observation: Any) -> np.ndarray:
        time.sleep(2 * limits.SILENT_S)
        return super().act(observation)


def test_who_waits_for_an_answer_is_not_silent(places: Places) -> None:
    with joined(places(Waits), 3) as (first, second, third):
        for client in (first, second):
            client.send(pack(OBSERVATION))
        time.sleep(limits.SILENT_S / 2)
        third.send(pack(OBSERVATION))
        for client in (first, second):
            assert unpack(client.recv(TIMEOUT_S))["actions"][0, 0] == 1


def test_places_are_told_of_in_words_that_let_an_episode_begin_again(
    places: Places, connect: Callable[..., Any]
) -> None:
    port = places(Counts)
    slow, quick, late = (connect(OpenpiPolicy, port) for _ in range(3))
    for client in (slow, quick):
        client.reset("Do it.", 1)
        assert client.act(OBSERVATION)[0, 0] == 101
    late.reset("Do it.", 2)
    with pytest.raises(MachineryError, match=r"try again later.*Others need the place"):
        slow.act(OBSERVATION)
    slow.reset("Do it.", 3)
    assert slow.act(OBSERVATION)[0, 0] == 301


class Plays(Counts):
    """Answers once it may."""

    may = threading.Event()

    def act(self, observation: Any) -> np.ndarray:
        assert self.may.wait(TIMEOUT_S)
        return super().act(observation)


def test_one_more_than_there_are_places_is_turned_away_as_too_early(
    places: Places, connect: Callable[..., Any]
) -> None:
    port = places(Plays)
    with joined(port, 2) as playing:
        for client in playing:
            ask(client, {"endpoint": "reset", "prompt": "", "seed": 1})
        for client in playing:
            client.send(pack(OBSERVATION))
        with pytest.raises(MachineryError, match=r"All 2 places are taken; begin again later"):
            connect(OpenpiPolicy, port).reset("Do it.", 1)
        Plays.may.set()
        assert [unpack(each.recv(TIMEOUT_S))["actions"][0, 0] for each in playing] == [101, 101]


FLOODED = """
import resource, sys
resource.setrlimit(resource.RLIMIT_NOFILE, (64, 64))
from duobench.cli import main
main(["serve", "--policy", "hold", "--port", sys.argv[1]])
"""


def test_flood_of_connections_is_told_in_a_few_lines_and_survived(tmp_path: Path) -> None:
    port, said = free_port(), tmp_path / "said.txt"
    with said.open("w") as errors:
        command = [sys.executable, "-c", FLOODED, str(port)]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors)
    assert process.stdout is not None
    process.stdout.readline()
    with ExitStack() as flood:
        for _ in range(200):
            flood.enter_context(socket.create_connection(("127.0.0.1", port)))
    wait_until(lambda: healthy(port), "the server is back")
    process.kill()
    process.wait()
    process.stdout.close()
    assert 1 <= len(said.read_text().splitlines()) < 10


def healthy(port: int) -> bool:
    with suppress(OSError, http.client.HTTPException):
        return health(port, timeout=1.0)[0] == http.HTTPStatus.OK
    return False


def test_twenty_thousand_hostile_requests_change_nothing() -> None:
    loop = InferenceLoop(Network(), Batching(size=2))
    thread = threading.Thread(target=loop.run, daemon=True)
    thread.start()

    async def answers() -> tuple[int, int]:
        read = refused = 0
        for data in messages(20_000):
            session = ClientSession(loop)
            try:
                await session.reply(data)
                read += 1
            except DuoBenchError:
                refused += 1
            session.close()
        return read, refused

    read, refused = asyncio.run(answers())
    assert read + refused == 20_000
    assert refused > 15_000
    assert read > 100
    loop.stop()
    thread.join(TIMEOUT_S)


def test_hostile_clients_leave_a_server_that_answers_as_before(serve: Serve) -> None:
    port = serve(Network())
    (good,) = observations(seed=0, count=1)
    for data in messages(130):
        with joined(port) as (client,):
            client.send(data)
            reply = client.recv(TIMEOUT_S)
            assert isinstance(reply, str) or "actions" in unpack(reply)
    with joined(port) as (client,):
        np.testing.assert_array_equal(ask(client, good)["actions"], expected(0, good))
