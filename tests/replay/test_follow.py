"""Following a run: what its records add up to while it is played, and its report at the end."""

import os
import time
from collections.abc import Iterator
from typing import Any

import pytest

from duobench.replay.sources import FollowedRun
from duobench.replay.viewer import Viewer
from duobench.results.folder import RunFolder, RunReader
from duobench.results.scores import wilson_interval
from duobench.web.server import PageServer
from tests.web.pages import get


@pytest.fixture
def server() -> Iterator[PageServer]:
    server = PageServer({})
    yield server
    server.close()


def followed(folder: RunFolder, server: PageServer) -> FollowedRun:
    return FollowedRun(folder, server, import_tasks=True)


def test_a_run_is_followed_from_before_its_start(play, server):
    path = play("random", "other", episodes=1)[0].path.with_name("run")
    run = followed(RunFolder(path), server)
    assert run.refresh() == {"run": {"note": "Nothing is written yet."}}
    folder, results = play("random", episodes=2)
    folder.page.unlink()
    folder.discard(results.tasks[1].records[1].key)
    found = run.refresh()["run"]
    assert (found["finished"], found["of"]) == (3, 4)
    assert [(row["task"], row["episodes"], row["of"]) for row in found["rows"]] == [
        ("wave", 2, 2),
        ("nod", 1, 2),
    ]
    for row in found["rows"]:
        assert row["wilson_95"] == list(wilson_interval(row["successes"], row["episodes"]))
    failed = {item.id for item in run.items if item.state != "success"}
    assert {each["id"] for each in found["failures"]} == failed
    assert [item.id for item in run.items] == ["wave/0", "wave/1", "nod/0"]
    assert len(run.load("nod/0").poses()) == results.tasks[1].records[0].steps + 1
    run.close()


def test_every_record_is_read_once(play, server, monkeypatch):
    folder, _ = play("random", episodes=2)
    read: list[Any] = []
    whole = RunReader.read_record
    monkeypatch.setattr(
        RunReader, "read_record", lambda *words: read.append(words[-1]) or whole(*words)
    )
    run = followed(folder, server)
    for _ in range(3):
        run.refresh()
    assert len(read) == len(set(read)) == 4


def test_the_report_is_shown_once_it_is_that_of_all_episodes(play, server):
    folder, _ = play("random", episodes=1)
    run = followed(folder, server)
    shown = run.refresh()
    assert get(server.url, shown["report"])[2] == folder.page.read_bytes()
    content = folder.page.read_bytes()
    folder.page.unlink()
    assert "report" not in run.refresh()
    assert run.refresh(is_last=True)["ended"]
    folder.page.write_bytes(content)
    play("random", episodes=2)
    (folder.path / "records/nod").rename(folder.path / "elsewhere")
    assert "report" not in run.refresh()
    assert run.refresh(is_last=True)["report"] == shown["report"]


def test_a_run_that_cannot_be_read_says_so_and_is_followed_on(play, server):
    folder, results = play("random", episodes=1)
    path = folder.record(results.tasks[0].records[0].key)
    content = path.read_bytes()
    path.write_bytes(b"{")
    run = followed(folder, server)
    assert "cannot be read now" in run.refresh()["run"]["note"]
    path.write_bytes(content)
    assert run.refresh()["run"]["finished"] == 2


def test_a_viewer_shows_what_comes(play, server, tmp_path):
    run = followed(RunFolder(tmp_path / "run"), server)
    viewer = Viewer(run, server, run.refresh)
    viewer.stop()
    play("random", episodes=1)
    viewer.run()
    assert server._latest["status"]
    assert '"report"' in str(server._latest["status"])


def test_a_break_of_a_run_is_no_time_that_it_took(play, server):
    folder, results = play("random", episodes=2)
    keys = [record.key for task in results.tasks for record in task.records]
    folder.discard(keys.pop())
    end = time.time()
    days = 3 * 86400.0
    moments = [end - days - 20.0, end - days - 10.0, end - days, end]  # gone on with days later
    for path, moment in zip([folder.description, *map(folder.record, keys)], moments, strict=True):
        os.utime(path, (moment, moment))
    found = followed(folder, server).refresh()["run"]
    assert found["elapsed_s"] == pytest.approx(20.0, abs=5.0)
    assert found["left_s"] == pytest.approx(10.0, abs=0.1)
