import gzip
import json
import re

import numpy as np
import pytest

from duobench.core.errors import DataError, OptionError, UnknownNameError
from duobench.tasks import get
from duobench.web.geometry import Geometry
from duobench.web.page import EpisodeReplay, assets, replay_fragment, replay_page
from duobench.web.track import encode
from duobench.world.sim.simulation import Simulation

FIRST_LOAD = 150_000
DRIVEN = 70_000
"""Compressed bytes of page, style and scripts that somebody loads who drives, without a scene."""
POSES = np.tile(np.array([0.0, 0, 0, 1, 0, 0, 0]), (30, 2, 1))
TRACK = encode(POSES)


def replay(**changes: object) -> EpisodeReplay:
    fields = {"title": "Episode 3", "scene": "sort", "track": TRACK, "stages": ("lifted", "in")}
    return EpisodeReplay(**{**fields, **changes})  # type: ignore[arg-type]


def test_first_load_is_small() -> None:
    scenes = [len(Geometry(Simulation(get(id).props).model).data) for id in ("ball_maze",)]
    content = [gzip.compress(body) for _, body in assets().values()]
    assert sum(map(len, content)) + max(scenes) <= FIRST_LOAD


def test_what_a_driver_loads_is_small() -> None:
    given = assets()
    names, wanted = {"/", "/page.css"}, ["/live.js", "/inputs.js", "/judging.js"]
    while wanted:
        name = wanted.pop()
        names.add(name)
        found = re.findall(r'(?:import|from) "\.(/[\w.]+)"', given[name][1].decode())
        wanted += set(found) - names
    assert {"/headset.js", "/scene.js", "/panel.js"} <= names
    assert not {"/takes.js", "/trials.js", "/replay.js"} & names
    assert sum(len(gzip.compress(given[name][1])) for name in names) <= DRIVEN, names


def test_page_and_scripts_load_only_what_is_given_out() -> None:
    given = assets()
    kind, page = given["/"]
    assert kind == "text/html; charset=utf-8"
    text = "\n".join(body.decode() for _, body in given.values())
    assert not re.search(r"https?://(?!www\.w3\.org)", text)
    named = re.findall(r'(?:from|import\() ?"\./([\w.]+)"', text)
    named += re.findall(r'(?:src|href)="/([\w.]+)"', page.decode())
    assert {"scene.js", "live.js", "page.css"} <= set(named)
    # What drives comes with the room that takes hands.
    assert {f"/{name}" for name in named} - {"/inputs.js"} <= set(given)


def test_replays_are_one_file_that_loads_nothing() -> None:
    page = replay_page("Failures <1>", {"sort": b"scene"}, [replay(), replay(title="</script>")])
    assert "<h1>Failures &lt;1&gt;</h1>" in page
    assert not re.search(r"""https?://|\bimport\b|\bexport\b| src=|@import|url\(""", page)
    assert page.count("</script>") == page.count("<script")
    assert replay_page("Failures <1>", {"sort": b"scene"}, [replay()]) == replay_page(
        "Failures <1>", {"sort": b"scene"}, [replay()]
    )


def test_a_scene_is_there_once_and_only_where_needed() -> None:
    scenes = {"sort": b"1" * 3000, "pour": b"2" * 3000, "maze": b"3" * 3000}
    fragment = replay_fragment(scenes, [replay(), replay(), replay(scene="pour")])
    held = re.findall(r'<script type="text/plain" id="(\S+)">', fragment)
    assert held == ["scene-data-0", "scene-data-1", *(f"track-data-{n}" for n in range(3))]
    found = re.search(r'class="episodes-data">(.*?)</script>', fragment)
    assert found
    episodes = json.loads(found[1])
    assert [each["scene"] for each in episodes] == ["scene-data-0"] * 2 + ["scene-data-1"]
    assert [each["id"] for each in episodes] == ["replay-1", "replay-2", "replay-3"]
    assert '<section class="replays" data-replays aria-label' in fragment


def test_list_says_how_far_an_episode_came() -> None:
    fragment = replay_fragment({"sort": b""}, [replay(stage_changes=((10, 1),), id="sort-3")])
    assert re.search(r'data-replay="sort-3".*Episode 3.*stage 1 of 2 · 1\.0 s', fragment)


@pytest.mark.parametrize(
    ("scenes", "replays", "error", "words"),
    [
        ({}, [], OptionError, "at least one"),
        ({"sorts": b""}, [{}], UnknownNameError, "sort"),
        ({"sort": b""}, [{"track": b"nothing"}], DataError, "no track"),
    ],
)
def test_bad_replays_are_rejected(
    scenes: dict[str, bytes], replays: list[dict[str, object]], error: type, words: str
) -> None:
    with pytest.raises(error, match=words):
        replay_page("bad", scenes, [replay(**changes) for changes in replays])
