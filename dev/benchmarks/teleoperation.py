"""What teleoperation costs in real time: the period of its loop, and from a sample to its command.

A program sends hands sixty times a second over the page's socket, as a page does, while somebody
watches: a program that takes every frame and draws none, and then Chromium, which draws in 3D. All
of them share the cores of this machine, and without a graphics card Chromium takes one and more.
"""

from __future__ import annotations

import json
import math
import multiprocessing
import os
import shutil
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, closing, contextmanager, suppress
from tempfile import TemporaryDirectory
from urllib.parse import urlsplit

from websockets import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from dev.benchmarks.measure import Measurement
from duobench.data import Actor, ActorKind
from duobench.teleop.hands import HandDevice
from duobench.teleop.teleop_page import TeleopPage, Timings
from duobench.teleop.teleoperation import Teleoperation, make_recorder
from duobench.web.page import assets
from duobench.web.server import PageServer

TASKS = ("transfer_cube", "pour_marbles")
"""A usual one, and the one whose control step takes longest."""
SECONDS = 30.0
"""How long a session is measured."""
SETTLED_S = 6.0
"""How long a browser is given to load the scene and to begin to draw."""
LONGEST_WAIT_S = 60.0
"""How long a browser may take to open the page."""
HANDS_HZ = 60
MOST_PERIOD_MS, MOST_LATENCY_MS = 50.0, 20.0
"""Bars: 99 of 100 periods of the loop, and the middle one of the latencies."""
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--window-size=1280,900",
    "--no-first-run",
    "--disable-background-networking",
)


def measure() -> Iterator[Measurement]:
    """Measure each task with a program that watches, and with Chromium where there is one."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    for task in TASKS:
        yield from _measure(task, "a program watching", _program, has_bars=True)
        if browser is not None:
            yield from _measure(task, "Chromium drawing", lambda url: _drawing(browser, url))


def _measure(
    task: str,
    who: str,
    watching: Callable[[str], AbstractContextManager[None]],
    *,
    has_bars: bool = False,
) -> Iterator[Measurement]:
    """Two percentiles of the periods, and of the latencies."""
    summary = _timings(task, watching).summary()
    bars = {("period_ms", "p99"): MOST_PERIOD_MS, ("latency_ms", "p50"): MOST_LATENCY_MS}
    words = {"period_ms": "period of the loop", "latency_ms": "sample to command"}
    for name, quantiles in summary.items():
        for quantile in ("p50", "p99"):
            yield Measurement(
                what=f"{task}, {who}: {words[name]}, {quantile}",
                value=quantiles[quantile],
                unit="ms",
                at_most=bars.get((name, quantile)) if has_bars else None,
            )


def _timings(task: str, watching: Callable[[str], AbstractContextManager[None]]) -> Timings:
    """The times of a session that is recorded while somebody watches and a program leads."""
    actor = Actor(kind=ActorKind.SCRIPTED_OPERATOR, name="benchmark", device="hands")
    with TemporaryDirectory() as folder, closing(PageServer(assets())) as server:
        recorder = make_recorder(task, folder, actor, time_limit_s=10 * SECONDS)
        with closing(Teleoperation(recorder, HandDevice(), episodes=1)) as session:
            live = TeleopPage(session, server)
            with watching(server.url):
                _wait_for_viewers(server)
                with _process(_lead, server.url):
                    threading.Timer(SECONDS, live.stop).start()
                    return live.run()


def _wait_for_viewers(server: PageServer) -> None:
    """Wait until somebody watches, and is over with loading the page."""
    end = time.monotonic() + LONGEST_WAIT_S
    while not server.has_viewers:
        if time.monotonic() > end:
            raise RuntimeError("Nobody opened the page.")
        time.sleep(0.1)
    time.sleep(SETTLED_S)


@contextmanager
def _program(url: str) -> Iterator[None]:
    with _process(_watch, url):
        yield


@contextmanager
def _process(job: Callable[[str], None], url: str) -> Iterator[None]:
    """A process beside this one."""
    process = multiprocessing.get_context("spawn").Process(target=job, args=(url,), daemon=True)
    process.start()
    try:
        yield
    finally:
        process.terminate()
        process.join()


@contextmanager
def _drawing(browser: str, url: str) -> Iterator[None]:
    """A browser that has the page open and draws it."""
    with TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        command = [browser, *FLAGS, f"--user-data-dir={profile}", url]
        quiet = subprocess.DEVNULL
        process = subprocess.Popen(command, stdout=quiet, stderr=quiet, start_new_session=True)
        try:
            yield
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGTERM)
            process.wait()


def _connected(url: str) -> ClientConnection:
    parts = urlsplit(url)
    return connect(f"ws://{parts.netloc}/ws?{parts.query}", compression=None)


def _watch(url: str) -> None:
    """Take everything that the server sends."""
    with _connected(url) as connection, suppress(ConnectionClosed):
        for _ in connection:
            pass


def _lead(url: str) -> None:
    """Open both hands, squeeze them, and move them in small circles."""
    with _connected(url) as connection, suppress(ConnectionClosed):
        threading.Thread(target=_take_all, args=(connection,), daemon=True).start()
        connection.send(json.dumps({"kind": "drive"}))
        start = due = time.monotonic()
        number = 0
        while True:
            angle = 2 * math.pi * (due - start) / 4.0
            shift = 0.05 * math.cos(angle), 0.05 * math.sin(angle), 0.02 * math.sin(angle)
            squeeze = float(number > HANDS_HZ)
            hand = {"pose": [*shift, 1, 0, 0, 0], "sure": True, "squeeze": squeeze, "trigger": 0}
            sent = 1000.0 * time.monotonic()
            message = {"kind": "hands", "sent": sent, "seq": number, "left": hand, "right": hand}
            connection.send(json.dumps(message))
            number += 1
            due += 1.0 / HANDS_HZ
            time.sleep(max(0.0, due - time.monotonic()))


def _take_all(connection: ClientConnection) -> None:
    with suppress(ConnectionClosed):
        for _ in connection:
            pass
