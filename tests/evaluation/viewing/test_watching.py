"""A run that is watched, in a browser's place a socket; and what watching changes: nothing."""

import json
import threading
from collections.abc import Iterator
from typing import Any

import pytest

from duobench.replay.watching import RunWatch
from duobench.sim.simulation import Simulation
from duobench.web.geometry import Geometry
from duobench.web.messages import unpack_frame
from duobench.web.server import PageServer
from tests.evaluation import toy_tasks
from tests.evaluation.conftest import Play, assert_same_episodes, compared
from tests.web.pages import get, open_page

SLOW = "Dawdles"
"""A policy that gives time to look."""


@pytest.fixture
def server() -> Iterator[PageServer]:
    server = PageServer({})
    yield server
    server.close()


class Looking:
    """Somebody who looks at a run from another thread, and keeps what there is to see."""

    def __init__(self, url: str, choose: str | None = None) -> None:
        self.statuses: list[dict[str, Any]] = []
        self.scenes: dict[str, bytes] = {}
        self.steps: list[tuple[int, int]] = []
        self._url, self._choose = url, choose
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._look)
        self._thread.start()
        assert self._ready.wait(30)

    def end(self) -> None:
        self._thread.join(30)
        assert not self._thread.is_alive()

    def _look(self) -> None:
        with open_page(self._url) as page:
            self._ready.set()
            if self._choose is not None:
                self._wait_for_choice(page)
            for data in page.connection:
                if isinstance(data, bytes):
                    poses, step, _ = unpack_frame(data)
                    self.steps.append((step, len(poses)))
                    continue
                message = json.loads(data)
                if message["kind"] == "status":
                    self.statuses.append(message)
                elif message["kind"] == "scene":
                    self.scenes[message["name"]] = get(self._url, message["url"])[2]

    def _wait_for_choice(self, page: Any) -> None:
        while len(page.hear_of("status")["items"]) < int(self._choose or 0):
            pass
        page.say(kind="select", id=self._choose)


@pytest.mark.parametrize("workers", [0, 1, 2])
def test_records_are_the_same_bytes_whoever_looks(
    play: Play, reference: dict[str, bytes], server: PageServer, workers: int
) -> None:
    unseen, _ = play("random", "unseen", workers=workers, watch=RunWatch(server))
    assert compared(unseen) == reference
    looking = Looking(server.url)
    seen, _ = play("random", "seen", workers=workers, watch=RunWatch(server))
    server.close()
    looking.end()
    assert compared(seen) == reference
    assert looking.steps


def test_which_worker_plays_what_and_one_of_them_in_3d(play: Play, server: PageServer) -> None:
    looking = Looking(server.url, choose="2")
    play(SLOW, "run", workers=2, episodes=2, watch=RunWatch(server))
    server.close()
    looking.end()
    chosen = [each for each in looking.statuses if each["selected"] == "2" and "next" in each]
    assert {each["task"] for each in chosen} == {"nod"}  # each has a task of its own
    assert {each["instruction"] for each in chosen} == {"Do the nod."}
    assert {each["next"] for each in chosen} == {"Move."}
    assert chosen[0]["stages"] == [stage.name for stage in toy_tasks.NOD.stages]
    details = {item["detail"].partition(", stage")[0] for each in chosen for item in each["items"]}
    assert {"wave, episode 0", "nod, episode 0", "nod, episode 1"} <= details
    assert "1 of 4 episodes are finished." in {each["note"] for each in looking.statuses}
    end = looking.statuses[-1]
    assert (end["state"], end["note"]) == ("over", "4 of 4 episodes are finished.")
    assert looking.scenes
    assert all(scene[:2] == b"\x1f\x8b" for scene in looking.scenes.values())
    bodies = len(Geometry(Simulation(toy_tasks.NOD.props).model).bodies)
    assert {count for _, count in looking.steps} == {bodies}


def test_nothing_is_computed_while_nobody_looks(
    play: Play, server: PageServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    computed = []
    monkeypatch.setattr(
        "duobench.replay.live.LiveWatcher._show",
        lambda *arguments: computed.append(arguments),
    )
    play("random", "unseen", workers=0, watch=RunWatch(server))
    assert computed == []
    looking = Looking(server.url)
    play("random", "seen", workers=0, watch=RunWatch(server))
    server.close()
    looking.end()
    assert computed


def test_nobody_can_choose_what_is_not_there(server: PageServer) -> None:
    watch = RunWatch(server)
    with open_page(server.url) as page:
        for message in ({"id": "7"}, {"id": 7}, {}):
            page.say(kind="select", **message)
            page.hear_of("refused")
        page.say(kind="seek", step=3)
        assert "goes on as it does" in page.hear_of("refused")["reason"]
    assert watch.watched is None


def test_an_episode_that_cannot_be_shown_is_played(
    play: Play, reference: dict[str, bytes], server: PageServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_arguments: object) -> None:
        raise RuntimeError

    monkeypatch.setattr("duobench.replay.playback.Geometry", fails)
    looking = Looking(server.url)
    folder, _ = play("random", "run", workers=0, watch=RunWatch(server))
    server.close()
    looking.end()
    assert_same_episodes(folder, reference, 8)
    assert looking.steps == []
