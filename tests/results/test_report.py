import json
import re
from collections.abc import Sequence
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from duobench.cli import main
from duobench.policy import PolicyMetadata
from duobench.results.folder import RunFolder
from duobench.results.journal import PARTS, EpisodeTimes
from duobench.results.records import EpisodeRecord
from duobench.results.report import write_report
from duobench.results.run import Run, Shard
from tests.results.samples import (
    DEGREES,
    LIFT,
    SORT,
    TASKS,
    TURN,
    key,
    sample_folder,
    sample_record,
    sample_records,
    sample_run,
    without_times,
)

OUTPUTS = ("index.html", "summary.json", "figures/stages.svg", "figures/progress.svg")
COMMAND = "duobench eval --policy mine --execute 5 --out DIR"


class Page(HTMLParser):
    """Collects what the tests ask about, and checks that every element is closed."""

    VOID = frozenset({"meta", "path", "circle", "br", "use", "input"})

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.open: list[str] = []
        self.links: list[str] = []
        self.ids: list[str] = []
        self.text: list[str] = []
        self.feed(path.read_text(encoding="utf-8"))
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in self.VOID:
            self.open.append(tag)
        self.links += [value for name, value in attrs if value and name in {"href", "src"}]
        self.ids += [value for name, value in attrs if value and name == "id"]

    def handle_endtag(self, tag: str) -> None:
        if tag not in self.VOID:
            assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text.append(data)

    @property
    def words(self) -> str:
        return " ".join(" ".join(self.text).split())


def reported(
    path: Path,
    run: Run,
    records: Sequence[EpisodeRecord],
    videos: Sequence[tuple[str, int]] = (),
) -> tuple[RunFolder, Page]:
    """The folder of a run with videos and a report, and its page."""
    folder = sample_folder(path / "run", run, list(records))
    with folder.writer() as journal:
        journal.start(COMMAND, 1)
    for task, episode in videos:
        video = folder.video(key(folder, task, episode))
        video.parent.mkdir(parents=True)
        video.write_bytes(b"video")
    write_report(folder)
    return folder, Page(folder.page)


def summary(folder: RunFolder) -> dict[str, Any]:
    return json.loads(folder.summary.read_text())


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[RunFolder, Page]:
    """A finished run with one video, to be read only."""
    run = sample_run()
    return reported(tmp_path_factory.mktemp("whole"), run, sample_records(run), [(LIFT.id, 0)])


def test_summary_has_the_numbers_of_each_task(tmp_path: Path) -> None:
    run = sample_run(tasks=(SORT,), episodes=4)
    records = [sample_record(SORT, episode, (1, 2, 3)) for episode in range(3)]
    folder, _ = reported(tmp_path, run, [*records, sample_record(SORT, 3, (5,))])
    found = summary(folder)
    task = found["tasks"]["sort"]
    assert (task["episodes"], task["successes"], found["overall"]["successes"]) == (4, 3, 3)
    assert task["mean_final_progress"] == pytest.approx((3 + 1 / 3) / 4)
    assert task["last_stage_counts"] == [0, 1, 0, 3]
    assert task["wilson_95"] == pytest.approx([0.3006, 0.9544], abs=1e-4)
    assert found["policy"] == "mine"


def test_same_records_give_the_same_bytes_in_any_folder(tmp_path: Path) -> None:
    run = sample_run()
    records = sample_records(run)
    folders = [
        reported(tmp_path / name, run, ordered)[0]
        for name, ordered in (("one", records), ("two", records[::-1]))
    ]
    one, two = ([folder.file(name).read_bytes() for name in OUTPUTS] for folder in folders)
    assert one == two


def test_page_is_whole_and_its_links_lead_somewhere(whole: tuple[RunFolder, Page]) -> None:
    folder, page = whole
    assert "videos/lift/mine.sim.none.default/00000.webm" in page.links
    for link in page.links:
        if link.startswith("#"):
            assert link.removeprefix("#") in page.ids
        else:
            assert folder.file(link).is_file()
    assert len(page.ids) == len(set(page.ids))


def test_page_tells_policy_stages_seeds_and_command(whole: tuple[RunFolder, Page]) -> None:
    run, words = whole[0].read_run(), whole[1].words
    assert f"started by: {COMMAND}" in words
    for fact in ("Policy mine", "Its version 1", "Look default", "Action mode joint", "split eval"):
        assert fact in words
    for task in run.suite.tasks:
        assert task.title in words
        assert all(stage in words for stage in task.stages)
    assert {str(episode.seed) for episode in run.episodes()} <= set(words.split())
    assert "Software duobench 0, mujoco 4.0.0" in words
    assert "not finished" not in words


@pytest.mark.parametrize(
    ("policy", "object_state", "privileged"),
    [
        ("mine", False, False),
        ("mine", True, True),
        ("expert", False, True),
        ("expert:human", False, True),
        ("blind", False, True),
        ("experts:Mine", False, False),
    ],
)
def test_policy_that_knows_more_than_cameras_show_is_marked(
    tmp_path: Path, policy: str, object_state: bool, privileged: bool
) -> None:
    metadata = PolicyMetadata(name="any", object_state=object_state)
    folder, page = reported(tmp_path, sample_run(policy=policy, metadata=metadata), [])
    assert page.words.count(f"{policy} (privileged)") == 2 * privileged
    assert ("Privileged: the policy knows" in page.words) == privileged
    assert summary(folder)["privileged"] is privileged


def test_whatever_is_wider_than_a_phone_scrolls_and_says_so(
    whole: tuple[RunFolder, Page],
) -> None:
    html = whole[0].page.read_text()
    assert "Scroll sideways" in html
    wide = r'<div class="wide" role="region" tabindex="0" aria-label="[^"]+">'
    assert html.count("<table") == len(re.findall(rf"{wide}<table", html)) >= 1 + len(TASKS)
    assert html.count("<table") == html.count("<caption>")
    for figure in re.findall(r"<figure>.*?</figure>", html, re.DOTALL):
        assert re.match(rf"<figure>{wide}", figure)


def test_rate_of_success_comes_first(tmp_path: Path) -> None:
    run = sample_run(policy="expert")
    words = reported(tmp_path, run, sample_records(run))[1].words
    assert words.index("of 12 episodes") < words.index("Privileged:") < words.index("This run")


def test_failed_episodes_lead_to_a_video_or_to_the_command_that_makes_it(tmp_path: Path) -> None:
    run = sample_run(tasks=(SORT,), episodes=4)
    records = [sample_record(SORT, episode, (5,)) for episode in range(3)]
    records.append(sample_record(SORT, 3))
    folder, page = reported(tmp_path, run, records, [(SORT.id, 1)])
    assert {"#sort-0", "#sort-2", "videos/sort/mine.sim.none.default/00001.webm"} <= set(page.links)
    assert not {"#sort-1", "#sort-3"} & set(page.links)
    for episode, told in enumerate((True, False, True, False)):
        command = f"duobench report DIR --videos sort:{episode} --import-tasks"
        assert (command in page.words) == told
    rows = re.findall(r'<tr id="sort-(\d)"[^>]* class="success">', folder.page.read_text())
    assert rows == ["3"]


def test_times_are_shown_and_nothing_else_depends_on_them(whole: tuple[RunFolder, Page]) -> None:
    folder, page = whole
    assert "is not known" in page.words
    before = folder.page.read_text()
    journal = next(folder.path.glob("attempts/*.jsonl"))
    noted = journal.read_bytes()
    with folder.writer() as writer:
        writer.start(COMMAND, 2)
        for record in folder.read_records(folder.read_run()):
            writer.end(record, EpisodeTimes(total=70.0, **dict.fromkeys(PARTS, 1.0)))
    write_report(folder)
    after = folder.page.read_text()
    journal.write_bytes(noted)
    assert "2 workers side by side" in after
    assert "1 min 10 s" in after
    assert without_times(before) == without_times(after)


ERROR = "Trace\nValueError: no\n"
UNMET = ("left does not grasp cube", "cube touches table")


@pytest.mark.parametrize(
    ("records", "counts"),
    [
        pytest.param(
            [sample_record(SORT, 0, (5,), clipped=9), sample_record(SORT, 1, (5,), clipped=0)],
            {
                "in 9 of 180 control steps (5.0 %), in 1 of 2 episodes": 1,
                "Limits of the arms": 1,
            },
            id="clipped",
        ),
        pytest.param(
            [sample_record(SORT, 0, (5,), clipped=80, excess=DEGREES), sample_record(SORT, 1)],
            {
                "changed what was to be sent in 80 of 90 control steps of 1 of 2 episodes: joint "
                "targets went to 90 where 2.9 is the limit (are these degrees?).": 1
            },
            id="in degrees",
        ),
        pytest.param([sample_record(SORT, 0, ())], {"Limits of the arms": 0}, id="not clipped"),
        pytest.param(
            [sample_record(SORT, 0), sample_record(SORT, 1, (5,), error=ERROR)],
            {"1 episode failed with an error": 1, "Trace ValueError: no": 1},
            id="broken",
        ),
        pytest.param(
            [sample_record(SORT, 0, (1,), unmet=UNMET), sample_record(SORT, 1, unmet=())],
            {
                "In the way of the next stage: left does not grasp cube": 1,
                "cube touches table": 2,
            },
            id="unmet",
        ),
        pytest.param(
            [sample_record(SORT, 0), sample_record(SORT, 1, versions={"python": "3.13"})],
            {"2 different software stacks": 1, "Software python 3.13": 1},
            id="software",
        ),
    ],
)
def test_what_records_tell_is_on_the_page(
    tmp_path: Path, records: list[EpisodeRecord], counts: dict[str, int]
) -> None:
    _, page = reported(tmp_path, sample_run(tasks=(SORT,), episodes=2), records)
    assert {words: page.words.count(words) for words in counts} == counts


def test_text_from_outside_is_escaped(tmp_path: Path) -> None:
    run = sample_run(tasks=(TURN,), episodes=1, policy="<script>alert(1)</script>")
    record = sample_record(TURN, 0, (), error="<img src=x>\n", instruction="a & <b>")
    folder, page = reported(tmp_path, run, [replace(record, policy=run.candidate.policy)])
    html = folder.page.read_text()
    for raw in ("<script>alert", "<img src=x>", "a & <b>"):
        assert raw not in html
    assert "<img src=x>" in page.words


@pytest.mark.parametrize("kept", [0, 5])
def test_unfinished_run_says_so(tmp_path: Path, kept: int) -> None:
    run = sample_run()
    folder, page = reported(tmp_path, run, sample_records(run)[:kept])
    assert f"not finished: {kept} of 12 episodes" in page.words
    assert ("No episode of this task is finished yet" in page.words) == (kept < 9)
    assert "0 of 0" not in page.words
    assert summary(folder)["overall"]["episodes"] == kept


def test_unfinished_shards_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = sample_run()
    shards = [Shard(number=number, count=4) for number in (1, 2, 4)]
    done = {each for shard in shards[:2] for each in run.episode_keys(shard)}
    records = [each for each in sample_records(run) if each.key in done]
    folder = sample_folder(tmp_path / "run", run, records[:-1])
    for shard in shards:
        with folder.writer(shard):
            pass
    write_report(folder)
    missing = (
        "Missing are: shard 2/4 (1 episode), shard 3/4 (3 episodes, not begun), shard 4/4 (3 "
        "episodes)."
    )
    assert missing in Page(folder.page).words
    main(["report", str(folder.path)])
    assert "Missing are: shard 2/4 (1 episode), " in capsys.readouterr().out


def test_run_of_several_policies_has_a_page_each_and_their_comparison(tmp_path: Path) -> None:
    one = sample_run(tasks=(SORT,)).candidate
    run = replace(sample_run(tasks=(SORT,)), candidates=(one, replace(one, policy="a:b")))
    folder = sample_folder(tmp_path / "run", run, sample_records(run))
    assert write_report(folder).overall.episodes == 8
    assert "DuoBench comparison" in Page(folder.page).words
    names = ["a-b-6783a3.sim.none.default", "mine.sim.none.default"]
    assert sorted(path.name for path in (folder.path / "conditions").iterdir()) == names
    page = Page(folder.path / "conditions" / names[1] / "index.html")
    assert "../../index.html" in page.links
    write_report(folder)  # again
