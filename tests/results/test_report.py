import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest

from duobench.cli import main
from duobench.policy import PolicyMetadata
from duobench.results.folder import RunFolder
from duobench.results.journal import PARTS, EpisodeTimes
from duobench.results.records import EpisodeRecord
from duobench.results.report import write_report
from duobench.results.run import Run
from duobench.results.shard import Shard
from tests.results.samples import (
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
        self.note(attrs)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:  # noqa: ARG002 - the parser's signature
        self.note(attrs)

    def note(self, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if value and name in {"href", "src"}:
                self.links.append(value)
            if value and name == "id":
                self.ids.append(value)

    def handle_endtag(self, tag: str) -> None:
        if tag not in self.VOID:
            assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text.append(data)

    @property
    def words(self) -> str:
        return " ".join(" ".join(self.text).split())


def reported(path: Path, run: Run, records: list[EpisodeRecord]) -> tuple[RunFolder, Page]:
    """The folder of a run with a report, and its page."""
    folder = sample_folder(path / "run", run, records)
    write_report(folder)
    return folder, Page(folder.page)


def test_summary_has_the_numbers_of_each_task(tmp_path: Path) -> None:
    run = sample_run(tasks=(SORT,), episodes=4)
    records = [sample_record(SORT, episode, (1, 2, 3)) for episode in range(3)]
    folder, _ = reported(tmp_path, run, [*records, sample_record(SORT, 3, (5,))])
    summary = json.loads(folder.summary.read_text())
    task = summary["tasks"]["sort"]
    assert task["episodes"] == 4
    assert task["successes"] == 3
    assert task["mean_final_progress"] == pytest.approx((3 + 1 / 3) / 4)
    assert task["last_stage_counts"] == [0, 1, 0, 3]
    assert task["wilson_95"] == pytest.approx([0.3006, 0.9544], abs=1e-4)
    assert summary["overall"]["successes"] == 3
    assert summary["policy"] == "mine"


def test_late_successes_are_beside_the_scores_and_change_none(tmp_path: Path) -> None:
    records = [sample_record(SORT, 0), sample_record(SORT, 1, (5,))]
    slow = replace(records[1], late_success=100)
    summaries, pages = [], []
    for name, overtime, second in (("plain", 1.0, records[1]), ("overtime", 1.5, slow)):
        run = sample_run(tasks=(SORT,), episodes=2, overtime=overtime)
        folder = sample_folder(tmp_path / name, run, [records[0], second])
        write_report(folder)
        summaries.append(json.loads(folder.summary.read_text()))
        pages.append(Page(folder.page).words)
    plain, overtime = summaries
    assert (overtime.pop("overtime"), plain.pop("overtime")) == (1.5, 1.0)
    for score in (overtime["tasks"]["sort"], *overtime["categories"].values(), overtime["overall"]):
        assert score["late_successes"] == 1
        score["late_successes"] = 0
    assert overtime == plain
    assert "Within 1.5 horizons / %" in pages[1]
    assert "is no score" in pages[1]
    assert "(3 at 100, after the horizon)" in pages[1]
    assert "horizons" not in pages[0]


def test_same_records_give_the_same_bytes_in_any_folder(tmp_path: Path) -> None:
    run = sample_run()
    records = sample_records(run)
    written = []
    for name, ordered in (("one", records), ("two", records[::-1])):
        folder = sample_folder(tmp_path / name, run, ordered)
        write_report(folder)
        written.append([(folder.path / output).read_bytes() for output in OUTPUTS])
    assert written[0] == written[1]


def test_page_is_whole_and_its_links_lead_somewhere(tmp_path: Path) -> None:
    run = sample_run()
    folder = sample_folder(tmp_path / "run", run, sample_records(run))
    video = folder.video(key(folder, LIFT.id, 0))
    video.parent.mkdir(parents=True)
    video.write_bytes(b"video")
    write_report(folder)
    page = Page(folder.page)
    assert "videos/lift/mine.sim.none.default/00000.webm" in page.links
    for link in page.links:
        if link.startswith("#"):
            assert link.removeprefix("#") in page.ids
        else:
            assert (folder.path / link).is_file()
    assert len(page.ids) == len(set(page.ids))


def test_page_tells_policy_stages_seeds_and_command(tmp_path: Path) -> None:
    run, command = sample_run(), "duobench eval --policy mine --execute 5 --out DIR"
    folder = sample_folder(tmp_path / "run", run, sample_records(run))
    with folder.writer() as journal:
        journal.start(command, 1)
    write_report(folder)
    words = Page(folder.page).words
    assert f"come from: {command}" in words
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
    run = sample_run(policy=policy, metadata=metadata)
    folder, page = reported(tmp_path, run, [])
    words = page.words
    assert words.count(f"{policy} (privileged)") == 2 * privileged
    assert ("Privileged: the policy knows" in words) == privileged
    assert json.loads(folder.summary.read_text())["privileged"] is privileged


def test_whatever_is_wider_than_a_phone_scrolls_and_says_so(tmp_path: Path) -> None:
    run = sample_run()
    folder, _ = reported(tmp_path, run, sample_records(run))
    html = folder.page.read_text()
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
    folder = sample_folder(tmp_path / "run", run, [*records, sample_record(SORT, 3)])
    with folder.writer() as journal:
        journal.start("duobench eval --policy mine", 1)
    video = folder.video(key(folder, SORT.id, 1))
    video.parent.mkdir(parents=True)
    video.write_bytes(b"video")
    write_report(folder)
    page = Page(folder.page)
    assert {"#sort-0", "#sort-2", "videos/sort/mine.sim.none.default/00001.webm"} <= set(page.links)
    assert not {"#sort-1", "#sort-3"} & set(page.links)
    for episode, told in enumerate((True, False, True, False)):
        command = f"duobench report DIR --videos sort:{episode} --import-tasks"
        assert (command in page.words) == told
    assert folder.page.read_text().count('<tr id="sort-3" class="success">') == 1


def test_times_are_shown_and_nothing_else_depends_on_them(tmp_path: Path) -> None:
    run = sample_run()
    records = sample_records(run)
    pages = []
    for name, seconds in (("none", None), ("slow", 70.0)):
        folder = sample_folder(tmp_path / name, run, records)
        with folder.writer() as journal:
            journal.start("", 2)
            for record in records if seconds else ():
                parts = dict.fromkeys(PARTS, 1.0)
                journal.end(record, EpisodeTimes(total=seconds or 0, **parts))
        write_report(folder)
        pages.append(folder.page.read_text())
    assert "is not known" in pages[0]
    assert "2 workers side by side" in pages[1]
    assert "1 min 10 s" in pages[1]
    assert without_times(pages[0]) == without_times(pages[1])


def test_clipped_commands_are_counted_task_by_task(tmp_path: Path) -> None:
    run = sample_run(tasks=(SORT, TURN), episodes=2)
    records = [
        sample_record(SORT, 0, (5,), clipped=9),
        sample_record(SORT, 1, (5,), clipped=0),
        *(sample_record(TURN, episode, ()) for episode in range(2)),
    ]
    words = reported(tmp_path, run, records)[1].words
    assert "in 9 of 180 control steps (5.0 %), in 1 of 2 episodes" in words
    assert words.count("Limits of the arms") == 1


def test_text_from_outside_is_escaped(tmp_path: Path) -> None:
    run = sample_run(tasks=(TURN,), episodes=1, policy="<script>alert(1)</script>")
    record = sample_record(TURN, 0, (), error="<img src=x>\n", instruction="a & <b>")
    record = replace(record, policy=run.candidate.policy)
    folder, _ = reported(tmp_path, run, [record])
    html = folder.page.read_text()
    for raw in ("<script>alert", "<img src=x>", "a & <b>"):
        assert raw not in html
    assert "<img src=x>" in Page(folder.page).words


def test_broken_episode_is_shown_with_its_traceback(tmp_path: Path) -> None:
    run = sample_run(tasks=(SORT,), episodes=2)
    records = [
        sample_record(SORT, 0),
        sample_record(SORT, 1, (5,), error="Trace\nValueError: no\n"),
    ]
    words = reported(tmp_path, run, records)[1].words
    assert "1 episode failed with an error" in words
    assert "Trace ValueError: no" in words


def test_what_kept_an_episode_from_its_next_stage_is_shown(tmp_path: Path) -> None:
    run = sample_run(tasks=(SORT,), episodes=2)
    records = [
        sample_record(SORT, 0, (1,), unmet=("left does not grasp cube", "cube touches table")),
        sample_record(SORT, 1, unmet=()),
    ]
    folder, _ = reported(tmp_path, run, records)
    text = folder.page.read_text(encoding="utf-8")
    assert text.count("In the way of the next stage:") == 1
    assert "left does not grasp cube; cube touches table" in text


@pytest.mark.parametrize("kept", [0, 5])
def test_unfinished_run_says_so(tmp_path: Path, kept: int) -> None:
    run = sample_run()
    folder, page = reported(tmp_path, run, sample_records(run)[:kept])
    words = page.words
    assert f"not finished: {kept} of 12 episodes" in words
    assert ("No episode of this task is finished yet" in words) == (kept < 9)
    assert "0 of 0" not in words
    assert json.loads(folder.summary.read_text())["overall"]["episodes"] == kept


def test_mixed_software_stacks_are_pointed_out(tmp_path: Path) -> None:
    run = sample_run(tasks=(TURN,), episodes=2)
    second = sample_record(TURN, 1, (3,), versions={"python": "3.13"})
    words = reported(tmp_path, run, [sample_record(TURN, 0, (3,)), second])[1].words
    assert "2 different software stacks" in words
    assert "Software python 3.13" in words


def test_unfinished_shards_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = sample_run()
    shards = [Shard(number=number, count=4) for number in (1, 2, 4)]
    done = [{(key.task, key.episode) for key in run.episode_keys(shard)} for shard in shards]
    records = [
        each for each in sample_records(run) if (each.task, each.episode) in done[0] | done[1]
    ]
    folder = sample_folder(tmp_path / "run", run, records[:-1])
    for shard in shards:
        with folder.writer(shard):
            pass
    write_report(folder)
    words = Page(folder.page).words
    assert "Missing are: shard 2/4 (1 episode), shard 3/4 (3 episodes, not begun), " in words
    assert "shard 4/4 (3 episodes)." in words
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
