"""The page of a source: what visitors ask for, over a real socket, and what they see then."""

import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from duobench.core.errors import EvaluationError
from duobench.core.types import CONTROL_HZ
from duobench.evaluation.replay.sources import Item
from duobench.evaluation.replay.trajectory import Trajectory
from duobench.evaluation.replay.viewer import Viewer
from duobench.web import track
from duobench.web.server import PageServer
from tests.web.pages import open_page, unpack_frame, wait_until

STEPS = 20


def trajectory(scene: str) -> Trajectory:
    """One body that rises by a centimetre a step."""
    poses = np.zeros((STEPS + 1, 1, 7))
    poses[:, 0, 2] = 0.01 * np.arange(STEPS + 1)
    poses[:, 0, 3] = 1
    return Trajectory(
        task="rise",
        instruction="Rise.",
        stages=("risen", "high"),
        subinstructions=("Begin.", "Go on."),
        stage_changes=((5, 1), (15, 2)),
        scene=scene,
        scene_data=b"scene",
        track=track.encode(poses),
    )


class Rises:
    """A source of its own, with an episode that takes long, and one that cannot be shown."""

    title = "Rises"
    items = tuple(Item(id=name, title=name.title()) for name in ("a", "slow", "broken", "still"))

    def __init__(self) -> None:
        self.loads: list[str] = []
        self.go_on = threading.Event()
        self.threads: set[int] = set()

    def load(self, item: str) -> Trajectory:
        self.loads.append(item)
        self.threads.add(threading.get_ident())
        if item == "broken":
            raise EvaluationError("It is broken.")
        if item == "slow":
            assert self.go_on.wait(30)
        made = trajectory(f"scene-{item}")
        return replace(made, track=track.encode(made.poses()[:1])) if item == "still" else made

    def close(self) -> None:
        self.loads.append("closed")


@pytest.fixture
def source():
    return Rises()


@pytest.fixture
def server(source):
    server = PageServer({})
    viewer = Viewer(source, server)
    thread = threading.Thread(target=viewer.run)
    thread.start()
    yield server
    source.go_on.set()
    viewer.stop()
    thread.join(30)
    server.close()
    assert source.loads[-1] == "closed"


@pytest.fixture
def page(server):
    with open_page(server.url) as page:
        yield page


def test_an_episode_is_played_to_its_end_for_all_who_look(server, page):
    with open_page(server.url) as other:
        for each in (page, other):
            end = each.hear_of("status", state="paused", step=STEPS)
            assert (end["stage"], end["next"], end["steps"]) == (2, "", STEPS)
        page.say(kind="play", on=True)
        again = page.hear_of("status", state="playing")
        assert (again["step"], again["stage"], again["next"]) == (0, 0, "Begin.")
        assert page.hear_of("status", stage=1)["next"] == "Go on."
        page.say(kind="play", on=False)
        stopped = page.hear_of("status", state="paused")["step"]
        other.say(kind="seek", step=3)
        assert page.hear_of("status", step=3)["state"] == "paused"
        page.say(kind="seek", step=999)
        page.hear_of("status", step=STEPS)
        assert 5 <= stopped <= STEPS
        wait_until(lambda: page.frames or page.hear())
        page.frames = page.frames[-1:]
        while (frame := unpack_frame(page.frame()))[1] != STEPS:
            pass
        assert frame[0][0, 2] == pytest.approx(0.01 * STEPS, abs=1e-4)


def test_nothing_moves_while_nobody_looks(source, server):
    wait_until(lambda: source.loads)
    time.sleep(2 * STEPS / CONTROL_HZ)
    with open_page(server.url) as page:
        assert page.hear_of("status", task="rise")["state"] == "playing"
        assert unpack_frame(page.frame())[1] == 0


def test_what_takes_long_is_made_aside_and_once(source, page):
    page.hear_of("status", selected="a", task="rise")
    page.say(kind="select", id="slow")
    assert page.hear_of("status", selected="slow")["note"] == "Loading …"
    page.say(kind="ping", sent=1)
    page.hear_of("pong")
    source.go_on.set()
    page.hear_of("scene", name="scene-slow")
    for name in ("a", "slow"):
        page.say(kind="select", id=name)
        page.hear_of("scene", name=f"scene-{name}")
    assert source.loads == ["a", "slow"]
    assert len(source.threads) == 1
    assert threading.get_ident() not in source.threads


def test_who_chooses_another_while_one_is_made_sees_that_one(source, page):
    for name in ("slow", "still"):
        page.say(kind="select", id=name)
        page.hear_of("status", selected=name)
    source.go_on.set()
    assert page.hear_of("status", task="rise")["selected"] == "still"


def test_what_cannot_be_shown_says_why(page):
    page.say(kind="select", id="broken")
    page.hear_of("status", note="It is broken.")
    page.say(kind="play", on=True)
    page.say(kind="seek", step=2)
    page.say(kind="select", id="still")
    shown = page.hear_of("status", task="rise")
    assert (shown["steps"], shown["state"]) == (0, None)


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        ({"kind": "select", "id": "../a"}, "There is no '../a'"),
        ({"kind": "select"}, "missing required field `id`"),
        ({"kind": "select", "id": "a" * 301}, "length <= 300"),
        ({"kind": "seek", "step": -1}, "`int` >= 0"),
        ({"kind": "seek", "step": 1.5}, "Expected `int`, got `float`"),
        ({"kind": "play", "on": 1}, "Expected `bool`, got `int`"),
        ({"kind": "review", "id": "a", "kept": False}, "A second look is taken"),
        ({"kind": "review", "id": "a", "rows": [-1, 3]}, "`int` >= 0"),
        ({"kind": "hands", "left": None}, "Invalid value 'hands'"),
    ],
)
def test_other_wishes_are_refused(page, message, reason):
    page.say(**message)
    assert reason in page.hear_of("refused")["reason"]
