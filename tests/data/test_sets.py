"""Data sets as a whole: checked, merged, split and summed up, in Python and by their commands."""

import re
import shutil
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from duobench.cli import main
from duobench.core.errors import DataError, NamesTakenError, OutputError, UnknownNameError
from duobench.core.files import locked
from duobench.core.types import POLICY_CAMERAS
from duobench.data import Actor, ActorKind, DataSet, Recording
from duobench.data.arrange import merge, split
from duobench.data.check import find_problems
from duobench.data.page import write_page
from duobench.data.schema import video_path
from duobench.data.summary import Smoothness, summarize
from duobench.tasks import catalog
from tests.data.conftest import EPISODES, LENGTHS
from tests.data.real.number_duo import numbers_in, play_real, real_recorder
from tests.data.tools import HORIZON, TASK, ended, recorded


@pytest.fixture
def real_copy(real: DataSet, tmp_path: Path) -> DataSet:
    shutil.copytree(real.path, tmp_path / "real")
    return DataSet.open(tmp_path / "real")


def contents(*sets: DataSet) -> list[bytes]:
    return sorted(path.read_bytes() for data in sets for path in (*data.episodes(), *data.videos()))


Change = Callable[[Path], object]
"""Spoils an episode, whose file is given."""


def changed(change: Callable[[Recording], Recording]) -> Change:
    return lambda path: change(Recording.read(path)).write(path)


def with_info(**values: Any) -> Change:
    return changed(lambda recording: replace(recording, info=replace(recording.info, **values)))


def with_outcome(**values: Any) -> Change:
    def change(path: Path) -> None:
        with_info(outcome=replace(ended(Recording.read(path)), **values))(path)

    return change


def with_column(name: str, place: int | slice | tuple[int, int], value: float) -> Change:
    def change(recording: Recording) -> Recording:
        column = np.array(getattr(recording, name))
        column[place] = value
        return replace(recording, **{name: column})

    return changed(change)


def with_video(change: Callable[[bytes], bytes]) -> Change:
    def spoil(path: Path) -> None:
        video = video_path(path, "head")
        video.write_bytes(change(video.read_bytes()))

    return spoil


def flipped(content: bytes) -> bytes:
    middle = len(content) // 2
    return content[:middle] + bytes([content[middle] ^ 255]) + content[middle + 1 :]


# --- check ---------------------------------------------------------------------------------------


def test_a_sound_data_set_has_no_problems(original: DataSet, real: DataSet, tmp_path: Path) -> None:
    seen = []
    assert find_problems(original, progress=lambda *numbers: seen.append(numbers)) == []
    assert seen == [(done, EPISODES) for done in range(EPISODES + 1)]
    assert find_problems(real) == []
    assert len(real.videos()) == len(LENGTHS) * len(POLICY_CAMERAS)
    recorded(tmp_path, steps=3, horizon=None, max_episode_steps=-1)
    assert find_problems(DataSet.open(tmp_path), workers=0) == [], "without a time limit"


SIMULATED: list[tuple[Change, str]] = [
    (with_info(task="ball_maze"), "belongs to task 'ball_maze'"),
    (with_info(suite_version="1"), "belongs to suite 1"),
    (with_info(seed=77), "not the one that seed 77 of 'train' samples"),
    (with_info(split="eval"), "of 'eval' samples"),
    (with_info(first_hash="0" * 64), "hash of its first state"),
    (with_info(last_hash=None), "hash of its last state is missing"),
    (with_info(outcome=None), "does not say how it ended"),
    (with_outcome(stage=1), "last stage is not the one"),
    (with_outcome(success=True), "no success as it says"),
    (with_column("state", 0, 0.0), "first state is not the one"),
    (with_column("action", 3, np.nan), "not all numbers are finite: action"),
    (with_column("time", 5, -1.0), "clock goes back"),
    (with_column("stage", 5, 1), "stage falls"),
    (with_column("success", 5, True), "success ends"),
    (with_column("success", slice(5, None), True), "goes on for 35 control steps after success"),
    (with_outcome(success_step=3), "step of its success is not the one"),
]
REAL: list[tuple[Change, str]] = [
    (lambda path: video_path(path, "head").unlink(), "is missing"),
    (with_video(lambda content: content[: len(content) // 2]), "frames, not"),
    (with_video(flipped), "00001.head.mp4 has"),
    (with_column("frame", (-1, 0), 99), "name frame 99 of 00001.head.mp4"),
    (with_column("frame", (5, 1), 0), "go back in 00001.left_wrist.mp4"),
]


@pytest.mark.parametrize(
    ("name", "change", "complaint"),
    [*(("data", *row) for row in SIMULATED), *(("real_copy", *row) for row in REAL)],
)
def test_what_is_wrong_is_found(
    request: pytest.FixtureRequest, name: str, change: Change, complaint: str
) -> None:
    data = request.getfixturevalue(name)
    path = data.episodes()[1]
    change(path)
    problems = find_problems(data)
    assert {problem.path for problem in problems} == {path}
    assert any(complaint.lower() in problem.what.lower() for problem in problems), problems


def test_damaged_files_and_leftovers_are_named_by_the_command(
    real_copy: DataSet, capsys: pytest.CaptureFixture[str]
) -> None:
    lost, _, damaged = real_copy.episodes()
    lost.unlink()
    video_path(lost, "head").rename(lost.with_name("notes.mp4"))
    damaged.write_bytes(damaged.read_bytes()[:2000])
    lost.with_name("00009.part").write_bytes(b"")
    with pytest.raises(SystemExit, match="1"):
        main(["data", "check", str(real_copy.path), "--workers", "2"])
    out = capsys.readouterr().out
    for said in (
        f"{damaged}: Cannot read",
        "00009.part: Its recording was interrupted",
        "notes.mp4: It is a video without an episode",
        "2 episodes, 5 problems",
    ):
        assert said in out
    assert out.count("It is a video without an episode.") == 3


# --- merge and split -----------------------------------------------------------------------------


def test_a_split_follows_from_its_seed_and_takes_whole_tasks(
    original: DataSet, tmp_path: Path
) -> None:
    chosen = []
    for name, seed in (("a", 0), ("b", 0), *((str(seed), seed) for seed in range(1, 9))):
        split(original, tmp_path / name, tmp_path / f"not-{name}", fraction=0.5, seed=seed)
        chosen.append([path.name for path in DataSet.open(tmp_path / name).episodes()])
    assert chosen[0] == chosen[1]
    assert len({tuple(names) for names in chosen}) > 1
    assert split(original, tmp_path / "all", tmp_path / "none", tasks=[TASK]) == (EPISODES, 0)


@pytest.mark.parametrize(
    ("options", "error", "word"),
    [
        ({}, DataError, "fraction"),
        ({"fraction": 0.5, "tasks": [TASK]}, DataError, "fraction"),
        ({"fraction": 0.0}, DataError, "fraction"),
        ({"fraction": 1.5}, DataError, "fraction"),
        ({"tasks": ["sort_bin"]}, UnknownNameError, TASK),
    ],
)
def test_a_split_that_says_nothing_is_refused(
    original: DataSet, tmp_path: Path, options: dict[str, Any], error: type[Exception], word: str
) -> None:
    with pytest.raises(error, match=word):
        split(original, tmp_path / "a", tmp_path / "b", **options)
    assert not (tmp_path / "a").exists()


def test_parts_of_a_split_never_overlap(original: DataSet, tmp_path: Path) -> None:
    one, two = tmp_path / "one", tmp_path / "two"
    with pytest.raises(DataError, match="a folder each"):
        split(original, one, tmp_path / "x" / ".." / "one", fraction=0.5)
    merge([original], tmp_path / "whole")
    with pytest.raises(DataError, match="no episode of this part"):
        split(original, tmp_path / "whole", two, fraction=0.5)
    with pytest.raises(OutputError, match="which is read"):
        split(original, original.path, two, fraction=0.5)
    split(original, one, two, fraction=0.5, seed=0)
    before = contents(DataSet.open(one))
    for seed in range(9):
        with suppress(DataError):  # unless the seed chooses the same ones
            split(original, one, two, fraction=0.5, seed=seed)
        assert contents(DataSet.open(one)) == before
        assert sorted([*before, *contents(DataSet.open(two))]) == contents(original)


def test_a_folder_takes_one_writer_and_at_least_one_source(
    original: DataSet, tmp_path: Path
) -> None:
    with pytest.raises(DataError, match="at least one"):
        merge([], tmp_path / "out")
    with locked(tmp_path / "out"), pytest.raises(OutputError, match="Another process"):
        merge([original], tmp_path / "out")
    with locked(tmp_path / "two"), pytest.raises(OutputError, match="Another process"):
        split(original, tmp_path / "one", tmp_path / "two", fraction=0.5)


def test_commands_merge_what_they_split_with_its_videos(
    real: DataSet, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one, two, whole = (tmp_path / name for name in ("one", "two", "whole"))
    words = ["--out", str(one), str(two), "--fraction", "0.67"]
    main(["data", "split", str(real.path), *words])
    assert len(DataSet(one).videos()) == 6
    assert find_problems(DataSet.open(one)) == find_problems(DataSet.open(two)) == []
    for _ in range(2):  # the second time nothing is left to do
        main(["data", "merge", str(one), str(two), "--out", str(whole)])
        assert contents(DataSet(whole)) == contents(real)
    out = capsys.readouterr().out
    assert f"2 episodes in {one}" in out
    assert f"3 episodes in {whole}\n" in out
    main(["data", "merge", str(one), str(one), "--out", str(tmp_path / "same")])
    assert "same; left out, as equal to one of these: 2\n" in capsys.readouterr().out
    names = [path.relative_to(whole) for path in DataSet(whole).episodes()]
    assert names == [path.relative_to(real.path) for path in real.episodes()]
    DataSet(whole).episodes()[1].unlink()
    assert merge([real], whole) == 3  # goes on where it was interrupted; videos are copied first
    assert contents(DataSet(whole)) == contents(real)
    with pytest.raises(SystemExit, match=f"no folder {tmp_path / 'three'}.*Beside it"):
        main(["data", "merge", str(one), str(tmp_path / "three"), "--out", str(whole)])


def test_names_that_clash_are_refused_or_renamed_with_their_videos(
    real: DataSet, real_copy: DataSet, tmp_path: Path
) -> None:
    path = real_copy.episodes()[1]
    with_info(instruction="Do it differently.")(path)
    out = DataSet(tmp_path / "out")
    with pytest.raises(NamesTakenError, match=f"1 name stands.*{TASK}/00001"):
        merge([real, real_copy], out.path)
    assert contents(out) == []
    for _ in range(2):
        assert merge([real, real_copy], out.path, rename=True) == 4
        renamed = DataSet.open(out.path).episodes()[3]
        assert renamed.name == "00003.parquet"
        videos = [video_path(path, camera).read_bytes() for camera in POLICY_CAMERAS]
        assert contents(out) == sorted([*contents(real), path.read_bytes(), *videos])
    assert find_problems(out) == []
    assert len(numbers_in(video_path(renamed, "head"))) == LENGTHS[1] + 1


def test_nothing_is_merged_over_a_recording_that_runs(real: DataSet, tmp_path: Path) -> None:
    env, _ = real_recorder(tmp_path)
    play_real(env, 5)
    with pytest.raises(NamesTakenError):
        merge([real], tmp_path)
    merge([real], tmp_path, rename=True)
    env.close()
    assert find_problems(DataSet.open(tmp_path)) == []
    assert len(DataSet(tmp_path).episodes()) == len(LENGTHS) + 1


def test_an_episode_without_its_video_is_not_copied(real_copy: DataSet, tmp_path: Path) -> None:
    video_path(real_copy.episodes()[1], "head").unlink()
    with pytest.raises(DataError, match=r"head\.mp4 is missing"):
        merge([real_copy], tmp_path / "out")
    with pytest.raises(DataError, match=r"head\.mp4 is missing"):
        split(real_copy, tmp_path / "a", tmp_path / "b", fraction=0.5)


def test_a_damaged_episode_is_not_copied(original: DataSet, tmp_path: Path) -> None:
    data = DataSet.open(tmp_path / "data")
    merge([original], data.path)
    path = data.episodes()[1]
    content = bytearray(path.read_bytes())
    content[len(content) // 3] ^= 1
    path.write_bytes(content)
    with pytest.raises(DataError, match=path.name):
        merge([data], tmp_path / "out")
    assert not (tmp_path / "out" / "episodes").exists()


# --- info ----------------------------------------------------------------------------------------


def test_summary_adds_up(original: DataSet) -> None:
    summary = summarize(original)
    recordings = list(original.recordings())
    (task,) = summary.tasks
    assert (task.episodes, task.successes, task.discarded, task.cut) == (EPISODES, 0, 0, 0)
    assert (task.horizon, task.frames) == (catalog.get(TASK).horizon, EPISODES * HORIZON)
    assert task.lengths == (HORIZON,) * EPISODES
    assert task.long_length == HORIZON
    assert replace(task, lengths=(10, 20)).median_length == 15
    assert (task.repeated_layouts, task.eval_layouts) == (0, 0)
    assert len(task.stage_seconds) == catalog.get(TASK).max_stage + 1
    assert sum(task.stage_seconds) == pytest.approx(HORIZON / 30)
    joint = next(each for each in summary.joints if each.name == "right_joint_4")
    sent = np.concatenate([each.sent[:, 11] for each in recordings])
    assert joint.quantiles == pytest.approx(np.quantile(sent, [0, 0.01, 0.5, 0.99, 1]), abs=1e-6)
    assert joint.low < joint.quantiles[0] <= joint.quantiles[-1] < joint.high
    assert joint.fastest == max(abs(each.joint_velocity[:, 10]).max() for each in recordings)
    assert joint.at_limit == 0.0
    assert task.actors == ("program wave",)
    assert task.smoothness == Smoothness(at_limit=0.0, reversals=0.0, jumps=0.0)


def test_commands_at_a_limit_are_counted_and_experts_named_once(data: DataSet) -> None:
    first, *_ = data.episodes()
    with_column("sent", 0, 1000.0)(first)
    for path in data.episodes():
        with_info(actor=Actor(kind=ActorKind.EXPERT, name="expert:human"))(path)
    summary = summarize(data)
    assert {joint.at_limit for joint in summary.joints} == {1 / (EPISODES * HORIZON)}
    assert summary.tasks[0].actors == ("expert:human",)


@pytest.mark.parametrize(
    ("steps", "reversals", "jumps"),
    [
        ([0.021, -0.021], 1, 0),  # their difference is no jump yet
        ([0.021, -0.019], 0, 0),
        ([0.03, -0.03, 0.03], 2, 2),
        ([0.06, 0.06], 0, 2),  # where it starts and where it stops
        ([0.049, 0.049], 0, 0),
    ],
)
def test_smoothness_of_labels_is_measured(
    data: DataSet, steps: list[float], reversals: int, jumps: int
) -> None:
    for path in data.episodes():
        recording = Recording.read(path)
        action = np.zeros_like(recording.action)
        action[2 : 2 + len(steps), 3] = np.cumsum(steps)
        action[2 + len(steps) :, 3] = sum(steps)
        replace(recording, action=action).write(path)
    (task,) = summarize(data).tasks
    assert task.smoothness.reversals == reversals
    assert task.smoothness.jumps == pytest.approx(jumps / HORIZON)


def test_page_works_offline_and_shows_every_task(
    data: DataSet, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["data", "info", str(data.path)])
    page = data.path / "index.html"
    assert f"Page: {page}" in capsys.readouterr().out
    text = page.read_text(encoding="utf-8")
    addresses = re.findall(r'\b(?:href|src)="([^"]+)"', text)
    assert f"#task-{TASK}" in addresses
    assert sum(address.startswith("data:image/jpeg;base64,") for address in addresses) == 1
    assert all(address.startswith(("#", "data:")) for address in addresses)
    assert catalog.get(TASK).title in text
    before = page.read_bytes()
    write_page(data, summarize(data))
    assert page.read_bytes() == before
    assert find_problems(data) == []


def test_info_and_page_say_where_episodes_are_from(
    real_copy: DataSet, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["data", "info", str(real_copy.path)])
    text = (real_copy.path / "index.html").read_text()
    for shown in (capsys.readouterr().out, text):
        assert "3 real (simulated, simulated drivers)" in shown
    assert text.count("data:image/jpeg") == 1


def test_an_episode_without_actions_adds_up_to_nothing_and_no_episode_is_no_page(
    tmp_path: Path,
) -> None:
    recorded(tmp_path / "zero", steps=0)
    summary = summarize(DataSet.open(tmp_path / "zero"))
    assert (summary.episodes, summary.frames, summary.joints) == (1, 0, ())
    write_page(DataSet.open(tmp_path / "zero"), summary, images=False)
    DataSet.open(tmp_path / "empty")
    with pytest.raises(SystemExit, match="holds no episode"):
        main(["data", "info", str(tmp_path / "empty")])
