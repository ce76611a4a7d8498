"""Data sets as a whole: looked at, checked, merged and split, in Python and by their commands."""

import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from duobench.cli import main
from duobench.data import Actor, ActorKind, DataSet, Recording
from duobench.data.arrange import merge, split
from duobench.data.check import find_problems
from duobench.data.page import write_page
from duobench.data.summary import Smoothness, summarize
from duobench.errors import DataError, OutputError, UnknownNameError
from duobench.files import locked
from duobench.tasks import catalog
from tests.data.tools import HORIZON, TASK, data_of, ended, recorded

EPISODES = 4


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> DataSet:
    return data_of(tmp_path_factory.mktemp("data") / "demos", EPISODES, split="train")


@pytest.fixture
def data(original: DataSet, tmp_path: Path) -> DataSet:
    """A copy of its own, to spoil."""
    merge([original], tmp_path / "demos")
    return DataSet.open(tmp_path / "demos")


def contents(data: DataSet) -> list[bytes]:
    return sorted(path.read_bytes() for path in data.episodes())


def spoil(data: DataSet, change: Callable[[Recording], Recording]) -> Path:
    path = data.episodes()[1]
    change(Recording.read(path)).write(path)
    return path


def with_info(**values: Any) -> Callable[[Recording], Recording]:
    return lambda recording: replace(recording, info=replace(recording.info, **values))


def with_outcome(**values: Any) -> Callable[[Recording], Recording]:
    return lambda recording: with_info(outcome=replace(ended(recording), **values))(recording)


def with_column(name: str, row: int, value: float) -> Callable[[Recording], Recording]:
    def change(recording: Recording) -> Recording:
        column = np.array(getattr(recording, name))
        column[row] = value
        return replace(recording, **{name: column})

    return change


# --- check ---------------------------------------------------------------------------------------


def test_a_sound_data_set_has_no_problems(original: DataSet, tmp_path: Path) -> None:
    seen = []
    assert find_problems(original, progress=lambda *numbers: seen.append(numbers)) == []
    assert seen == [(done, EPISODES) for done in range(EPISODES + 1)]
    recorded(tmp_path, steps=3, horizon=None, max_episode_steps=-1)
    assert find_problems(DataSet.open(tmp_path), workers=0) == [], "without a time limit"


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
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
        (with_column("success", 5, True), "goes on for 35 control steps after success"),
        (with_outcome(success_step=3), "step of its success is not the one"),
    ],
)
def test_what_is_wrong_is_found(
    data: DataSet, change: Callable[[Recording], Recording], complaint: str
) -> None:
    path = spoil(data, change)
    problems = find_problems(data)
    assert {problem.path for problem in problems} == {path}
    assert any(complaint.lower() in problem.what.lower() for problem in problems), problems


def test_a_damaged_file_and_a_leftover_are_named_by_the_command(
    data: DataSet, capsys: pytest.CaptureFixture[str]
) -> None:
    path = data.episodes()[2]
    path.write_bytes(path.read_bytes()[:2000])
    path.with_name("00009.part").write_bytes(b"")
    with pytest.raises(SystemExit, match="1"):
        main(["data", "check", str(data.path), "--workers", "2"])
    out = capsys.readouterr().out
    for said in (
        f"{path}: Cannot read",
        "00009.part: Its recording was interrupted",
        f"{EPISODES} episodes, 2 problems",
    ):
        assert said in out


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


def test_names_that_clash_are_refused_or_renamed(
    original: DataSet, data: DataSet, tmp_path: Path
) -> None:
    spoil(data, with_info(instruction="Do it differently."))
    out = tmp_path / "out"
    with pytest.raises(DataError, match=f"1 name stands.*{TASK}/00001"):
        merge([original, data], out)
    assert DataSet.open(out).episodes() == []
    for _ in range(2):  # the second time nothing is left to do
        assert merge([original, data], out, rename=True) == EPISODES + 1
        assert contents(DataSet.open(out)) == sorted({*contents(original), *contents(data)})
    assert DataSet.open(out).episode(TASK, f"{EPISODES:05d}").exists()


def test_commands_merge_and_split(
    original: DataSet, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one, two, whole = (str(tmp_path / name) for name in ("one", "two", "whole"))
    main(["data", "split", str(original.path), "--out", one, two, "--fraction", "0.25"])
    main(["data", "merge", one, two, "--out", whole])
    out = capsys.readouterr().out
    assert f"1 episode in {one}" in out
    assert f"{EPISODES} episodes in {whole}" in out
    with pytest.raises(SystemExit, match=f"no folder {tmp_path / 'three'}.*Beside it"):
        main(["data", "merge", one, str(tmp_path / "three"), "--out", whole])


def test_parts_of_a_split_never_overlap(original: DataSet, tmp_path: Path) -> None:
    one, two = tmp_path / "one", tmp_path / "two"
    with pytest.raises(DataError, match="a folder each"):
        split(original, one, tmp_path / "x" / ".." / "one", fraction=0.5)
    with pytest.raises(DataError, match="no episode of this part"):
        split(original, original.path, two, fraction=0.5)
    split(original, one, two, fraction=0.5, seed=0)
    before = contents(DataSet.open(one))
    split(original, one, two, fraction=0.5, seed=0)
    for seed in range(1, 9):
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


def test_commands_at_a_limit_are_counted(data: DataSet) -> None:
    spoil(data, with_column("sent", 0, 1000.0))
    joints = summarize(data).joints
    assert {joint.at_limit for joint in joints} == {1 / (EPISODES * HORIZON)}


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


def test_experts_are_named_once(data: DataSet) -> None:
    named = with_info(actor=Actor(kind=ActorKind.EXPERT, name="expert:human"))
    for path in data.episodes():
        named(Recording.read(path)).write(path)
    assert summarize(data).tasks[0].actors == ("expert:human",)


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
