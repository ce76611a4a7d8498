"""The latency that the page says is from the hand to the picture, whatever lies between."""

from __future__ import annotations

import asyncio
import re
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from urllib.parse import urlsplit

from playwright.sync_api import Page

from duobench.data import Actor, ActorKind, DataSet
from duobench.teleop.hands import HandDevice
from duobench.teleop.teleop_page import TeleopPage
from duobench.teleop.teleoperation import Teleoperation, make_recorder
from duobench.web.page import assets
from duobench.web.server import PageServer
from tests.pages.driving import opened, take_the_drive
from tests.pages.windows import complaints_of, until

ONE_WAY_S = 0.150
LEAST_MS = 2000 * ONE_WAY_S
MOST_MS = 6000
"""A browser without a graphics card on a busy machine draws slowly."""


@contextmanager
def delayed(port: int) -> Iterator[int]:
    """A port where everything passes to another one, and back, some time later."""
    ready, ended = threading.Event(), threading.Event()
    ports: list[int] = []
    writers: list[asyncio.StreamWriter] = []

    async def pass_on(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        waiting: asyncio.Queue[tuple[float, bytes]] = asyncio.Queue()

        async def write() -> None:
            while (piece := await waiting.get())[1]:
                await asyncio.sleep(max(0.0, piece[0] - time.monotonic()))
                writer.write(piece[1])
            writer.close()

        writing, data = asyncio.create_task(write()), b"-"
        while data:
            try:
                data = await reader.read(1 << 16)
            except ConnectionError:
                data = b""
            waiting.put_nowait((time.monotonic() + ONE_WAY_S, data))
        await writing

    async def connect(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        there, back = await asyncio.open_connection("127.0.0.1", port)
        writers.extend((writer, back))
        await asyncio.gather(pass_on(reader, back), pass_on(there, writer), return_exceptions=True)

    async def serve() -> None:
        async with await asyncio.start_server(connect, "127.0.0.1", 0) as server:
            ports.append(server.sockets[0].getsockname()[1])
            ready.set()
            await asyncio.to_thread(ended.wait)
            for writer in writers:
                writer.transport.abort()
            await asyncio.sleep(2 * ONE_WAY_S)

    thread = threading.Thread(target=lambda: asyncio.run(serve()))
    thread.start()
    ready.wait()
    try:
        yield ports[0]
    finally:
        ended.set()
        thread.join()


def lead(page: Page, seconds: float) -> None:
    """Drag the tool to and fro."""
    box = page.locator("canvas").first.bounding_box()
    assert box
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        for shift in (10, 0):
            page.mouse.move(x + shift, y)
            page.wait_for_timeout(40)
    page.mouse.up()


def test_a_slow_line_is_in_the_latency_and_nothing_is_said_before(tmp_path: Path) -> None:
    actor = Actor(kind=ActorKind.SCRIPTED_OPERATOR, name="dragger")
    recorder = make_recorder("transfer_cube", tmp_path, actor)
    with (
        closing(Teleoperation(recorder, HandDevice())) as session,
        closing(PageServer(assets())) as server,
        opened() as page,
    ):
        live = TeleopPage(session, server)
        thread = threading.Thread(target=live.run)
        address = urlsplit(server.url)
        with delayed(address.port or 0) as port:
            complaints = complaints_of(page)
            thread.start()
            url = address._replace(netloc=f"127.0.0.1:{port}").geturl()
            take_the_drive(page, url, lambda: None)
            until(page, "document.querySelector('.role').textContent == 'You drive as dragger'")
            page.wait_for_timeout(1000)
            facts = page.locator(".facts")
            assert "picture" not in facts.inner_text()
            assert "0 ms" not in facts.inner_text().split("Episode")[0]
            for _ in range(5):
                lead(page, 4.0)
                if "Hand to picture" in facts.inner_text():
                    break
            said = re.search(r"Hand to picture\s+(\d+) ms", facts.inner_text())
            assert said, facts.inner_text()
            assert LEAST_MS <= int(said[1]) <= MOST_MS
            served = re.search(r"Of it on the server\s+(\d+) ms", facts.inner_text())
            assert served
            assert int(served[1]) <= int(said[1]) - LEAST_MS
            page.screenshot(path=tmp_path / "page.png", full_page=True)
            live.stop()
            thread.join()
            assert complaints == []
            page.goto("about:blank")
    (recording,) = DataSet(tmp_path).recordings()
    assert recording.info.actor.device == "mouse"
