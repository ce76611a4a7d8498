"""The server of the page, over real sockets: who is let in, what is refused, and who is slow."""

import gzip
import json
import random
import socket
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from duobench.core.errors import MessageError, ServingError
from duobench.web.messages import FRAMES_HZ, MAX_MESSAGE, PageMessage, pack_frame
from duobench.web.server import PageServer
from tests.web.pages import get, open_page, unpack_frame, wait_until

ASSETS = {"/": ("text/html; charset=utf-8", b"<p>page"), "/app.js": ("text/javascript", b"1;" * 99)}
BROKEN = (
    "",
    "[" * 4000,
    '{"kind":"ping","x":' + "[" * 4000,
    '{"kind": 3}',
    '{"sent": 3}',
    '{"kind": "ping", "sent": "now"}',
    '{"kind": "fly"}',
    '{"kind": "select"}',
)
FUZZED = 10_000
BIG = 40_000


class Keep(PageMessage):
    pass


class Select(PageMessage):
    id: str


@pytest.fixture
def server() -> Iterator[PageServer]:
    with closing(PageServer(ASSETS)) as server:
        yield server


def token_of(server: PageServer) -> str:
    return urlsplit(server.url).query


# --- files ---------------------------------------------------------------------------------------


def test_page_and_its_files(server: PageServer) -> None:
    status, headers, page = get(server.url, f"/?{token_of(server)}", {"Accept-Encoding": "gzip"})
    assert (status, headers["Content-Encoding"]) == (200, "gzip")
    assert gzip.decompress(page) == ASSETS["/"][1]
    assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
    assert headers["Referrer-Policy"] == "no-referrer"
    status, headers, script = get(server.url, "/app.js")
    assert (status, headers["Content-Type"], script) == (200, *ASSETS["/app.js"])
    assert get(server.url, f"/absent?{token_of(server)}")[0] == 404


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "TRACE", "HEAD"])
def test_a_page_is_only_read(server: PageServer, method: str) -> None:
    status, headers, _ = get(server.url, f"/?{token_of(server)}", method=method)
    assert (status, headers["Allow"]) == (405, "GET")


@pytest.mark.parametrize(
    "query", ["", "token=wrong", "token=", "token=%ff", "&".join(["a=1"] * 99)]
)
def test_without_the_token_there_is_neither_page_nor_scene_nor_socket(
    server: PageServer, query: str
) -> None:
    server.publish_scene("table", b"scene")
    for path in ("/", "/scene/table.bin"):
        status, _, content = get(server.url, f"{path}?{query}")
        assert status == 403
        assert b"Open the whole address" in content
    with pytest.raises(InvalidStatus, match="403"), open_page(server.url, query=query):
        pass
    assert not server.has_viewers


def test_files_of_a_folder_are_given_out_to_those_with_the_token(
    server: PageServer, tmp_path: Path
) -> None:
    folder = tmp_path / "run"
    (folder / "figures").mkdir(parents=True)
    (folder / "figures" / "a.svg").write_text("<svg/>")
    (tmp_path / "secret.txt").write_text("secret")
    (folder / "link.txt").symlink_to(tmp_path / "secret.txt")
    base = f"/folder/{token_of(server).removeprefix('token=')}/"
    assert get(server.url, f"{base}figures/a.svg")[0] == 404  # nothing is published yet
    assert server.publish_folder(folder) == base
    status, headers, content = get(server.url, f"{base}figures/a.svg")
    assert (status, headers["Content-Type"], content) == (200, "image/svg+xml", b"<svg/>")
    for path in ("../secret.txt", "%2e%2e/secret.txt", "link.txt", "figures", "absent.txt"):
        assert get(server.url, base + path)[0] == 404
    assert get(server.url, "/folder/wrong/figures/a.svg")[0] == 403


def test_a_scene_is_where_its_message_says(server: PageServer) -> None:
    with open_page(server.url) as page:
        server.publish_scene("table-1", b"scene")
        message = page.hear_of("scene")
        assert message["name"] == "table-1"
        assert get(server.url, message["url"])[2] == b"scene"


# --- who may connect -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "http://127.0.0.1:1", "http://localhost", "http://["]
)
def test_pages_of_others_may_not_connect(server: PageServer, origin: str) -> None:
    with pytest.raises(InvalidStatus, match="403"), open_page(server.url, origin=origin):
        pass


def test_a_foreign_name_that_leads_here_is_refused(server: PageServer) -> None:
    parts = urlsplit(server.url)
    foreign = f"evil.example:{parts.port}"
    with socket.create_connection((parts.hostname or "", parts.port or 0)) as raw:
        raw.sendall(
            f"GET /ws?{parts.query} HTTP/1.1\r\nHost: {foreign}\r\nOrigin: http://{foreign}\r\n"
            "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
            "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n".encode()
        )
        assert raw.recv(100).startswith(b"HTTP/1.1 403")


def test_the_own_page_connects_by_any_name_of_this_machine(server: PageServer) -> None:
    with open_page(server.url.replace("127.0.0.1", "localhost")) as page:
        assert page.hear_of("role")["role"] == "viewer"
    with open_page(server.url, origin=None) as program:
        assert program.hear_of("role")["viewers"] == 1


@pytest.mark.parametrize("host", ["0.0.0.0", "", "192.0.2.7"])
def test_other_machines_need_a_certificate(host: str) -> None:
    with pytest.raises(ServingError, match="needs a certificate"):
        PageServer(ASSETS, host=host)


# --- messages ------------------------------------------------------------------------------------


def test_what_concerns_the_server_alone_is_answered_by_it(server: PageServer) -> None:
    heard: list[PageMessage] = []
    server.listen(Keep | Select, heard.append)
    with open_page(server.url) as page:
        page.say(kind="ping", sent=12.5)
        assert page.hear_of("pong")["sent"] == 12.5
        page.say(kind="select", id="a")
        page.say(kind="drive")
        page.say(kind="keep")
        page.hear_of("role", role="driver")
        wait_until(lambda: len(heard) == 2)
    assert heard == [Select("a"), Keep()]


def test_those_who_watch_may_be_refused(server: PageServer) -> None:
    heard: list[PageMessage] = []
    server.listen(Keep, heard.append, watching="You watch.")
    with open_page(server.url) as page:
        page.say(kind="keep")
        assert page.hear_of("refused")["reason"] == "You watch."
        page.say(kind="drive")
        page.say(kind="keep")
        wait_until(lambda: heard == [Keep()])


def test_some_messages_are_taken_from_those_who_watch(server: PageServer) -> None:
    heard: list[PageMessage] = []
    server.listen(Keep | Select, heard.append, watching="You watch.", anyone=(Keep,))
    with open_page(server.url) as page:
        page.say(kind="select", id="a")
        assert page.hear_of("refused")["reason"] == "You watch."
        page.say(kind="keep")
        wait_until(lambda: heard == [Keep()])


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b'{"kind": "ping"}', "is text"),
        *((broken, "This message is refused") for broken in BROKEN),
        ('{"kind": "select", "id": "worse"}', "Something failed here"),
        ('{"kind": "select", "id": "bad"}', "too bad"),
        ('{"kind": "select", "id": "odd"}', "odd"),
    ],
)
def test_a_message_is_refused_with_a_word_and_the_session_lives(
    server: PageServer, data: str | bytes, reason: str
) -> None:
    def act(message: Select) -> str:
        match message.id:
            case "worse":
                raise RuntimeError
            case "bad":
                raise MessageError("too bad")
        return "odd"

    server.listen(Select, act)
    with open_page(server.url) as page:
        page.connection.send(data)
        assert reason in page.hear_of("refused")["reason"]
        page.say(kind="ping", sent=1)
        page.hear_of("pong")


def test_an_oversized_message_ends_its_own_connection(server: PageServer) -> None:
    with open_page(server.url) as other, open_page(server.url) as page:
        page.connection.send(" " * MAX_MESSAGE)
        page.hear_of("refused")
        page.connection.send(" " * (MAX_MESSAGE + 1))
        with pytest.raises(ConnectionClosed) as closed:
            page.hear_of("pong")
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == 1009
        other.say(kind="ping", sent=1)
        other.hear_of("pong")


def fuzzed(generator: random.Random) -> str | bytes:
    """A message that nobody should send, or one with fields that nobody should trust."""
    good = json.dumps(
        {
            "kind": generator.choice(["hands", "select", "seek", "play", "ping", "keep", "x"]),
            "sent": generator.choice([0, -1e308, "x", None, [], 1e999, True]),
            "left": generator.choice([None, {}, {"pose": [0] * 7}, {"pose": ["x"]}]),
            "id": generator.choice(["../..", "a" * 999, 3, None, {"a": 1}]),
        }
    )
    match generator.randrange(4):
        case 0:
            return good
        case 1:
            return good[: generator.randrange(len(good))]
        case 2:
            data = bytearray(good.encode())
            for _ in range(generator.randint(1, 8)):
                data[generator.randrange(len(data))] = generator.randrange(128)
            return data.decode("ascii")
        case _:
            return generator.randbytes(generator.randrange(200))


def test_ten_thousand_fuzzed_messages(server: PageServer) -> None:
    with open_page(server.url) as witness, open_page(server.url) as page:
        generator = random.Random(0)
        for number in range(FUZZED):
            page.connection.send(fuzzed(generator))
            if number % 100 == 0:  # what it has to say is read, or it would wait for us
                page.say(kind="ping", sent=number)
                page.hear_of("pong", sent=number)
        for each in (page, witness):
            each.say(kind="ping", sent=-1)
            each.hear_of("pong", sent=-1)


# --- one drives ----------------------------------------------------------------------------------


def test_one_drives_and_others_watch(server: PageServer) -> None:
    lost: list[bool] = []
    server.listen(None, lambda _message: None, lost.append)
    with open_page(server.url) as first, open_page(server.url) as second:
        first.drive(viewers=1)
        for kind in ("drive", "take_over"):  # who drives already changes nothing
            first.say(kind=kind)
        first.say(kind="ping", sent=0)
        first.hear_of("pong")
        assert lost == []
        second.say(kind="drive")
        assert "take over" in second.hear_of("refused")["reason"]
        second.say(kind="take_over")
        second.hear_of("role", role="driver")
        first.hear_of("role", role="viewer", drivers=1)
        assert lost == [True]
        second.connection.socket.shutdown(socket.SHUT_RDWR)  # it is gone without a goodbye
        first.hear_of("role", drivers=0)
        assert lost == [True, False]
        first.drive(viewers=0)


def named(server: PageServer, name: str) -> str:
    """Query of a page by which its server knows it again."""
    return f"{token_of(server)}&page={name}"


@pytest.mark.parametrize("is_silent", [False, True], ids=["closed", "cut without a goodbye"])
def test_a_page_that_was_cut_off_drives_again_unless_another_one_did(
    server: PageServer, is_silent: bool
) -> None:
    lost: list[bool] = []
    server.listen(None, lambda _message: None, lost.append)
    with open_page(server.url) as other:
        with open_page(server.url, query=named(server, "a")) as page:
            page.drive()
            if is_silent:  # the server has not noticed it
                with open_page(server.url, query=named(server, "a")) as again:
                    again.hear_of("role", role="driver", viewers=1)
                    assert lost == [False]
                    with pytest.raises(ConnectionClosed):
                        page.hear_of("pong")
        wait_until(lambda: lost == ([False, False] if is_silent else [False]))
        with open_page(server.url, query=named(server, "b")) as stranger:
            assert stranger.hear_of("role")["role"] == "viewer"
        with open_page(server.url, query=named(server, "a")) as page:
            page.hear_of("role", role="driver")
        other.say(kind="take_over")
        other.hear_of("role", role="driver")
    with open_page(server.url, query=named(server, "a")) as page:
        assert page.hear_of("role")["role"] == "viewer"  # another one drove meanwhile
    with open_page(server.url) as nameless:  # a program is nobody's page
        assert nameless.hear_of("role")["role"] == "viewer"


# --- what is shown -------------------------------------------------------------------------------


def test_who_comes_later_sees_what_there_is(server: PageServer) -> None:
    poses = np.arange(14, dtype=np.float32).reshape(2, 7)
    server.publish_scene("table", b"scene")
    server.publish_status({"task": "carry_pot", "step": 3})
    server.publish_frame(pack_frame(poses, 3, 0.5))
    for _ in range(2):
        with open_page(server.url) as page:
            assert page.hear_of("scene")["name"] == "table"
            assert page.hear_of("status")["task"] == "carry_pot"
            shown, step, time_s = unpack_frame(page.frame())
        np.testing.assert_array_equal(shown, poses)
        assert (step, time_s) == (3, 0.5)


def test_a_frame_of_another_scene_is_not_shown(server: PageServer) -> None:
    server.publish_scene("one", b"")
    server.publish_frame(b"frame of one")
    server.publish_scene("two", b"")
    server.publish_frame(b"frame of two")
    with open_page(server.url) as page:
        assert page.hear_of("scene")["name"] == "two"
        assert page.frame() == b"frame of two"


def test_no_peer_gets_more_frames_than_it_can_show(server: PageServer) -> None:
    with open_page(server.url) as page:
        page.hear_of("role")
        begun = time.monotonic()
        for number in range(200):
            server.publish_frame(b"%d" % number)
            time.sleep(0.005)
        server.publish_status({"note": "end"})
        page.hear_of("status")
        most = FRAMES_HZ * (time.monotonic() - begun) + 3
        newest = [int(frame) for frame in page.frames]
        assert newest == sorted(newest)
        assert 2 <= len(newest) <= most


@pytest.mark.slow
def test_a_slow_peer_skips_frames_and_slows_nobody(server: PageServer) -> None:
    frames = 90
    with open_page(server.url) as fast, open_page(server.url) as slow:
        fast.hear_of("role", viewers=2)
        for number in range(frames):
            server.publish_frame(number.to_bytes(4, "little") * (BIG // 4))
            assert int.from_bytes(fast.frame()[:4], "little") == number
        seen = [int.from_bytes(slow.frame()[:4], "little")]
        while seen[-1] != frames - 1:
            seen.append(int.from_bytes(slow.frame()[:4], "little"))
    assert seen == sorted(seen)
    assert len(seen) < frames
