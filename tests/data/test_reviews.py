"""A second look: what is said beside recordings is honoured wherever they are read."""

from __future__ import annotations

import codecs
import json
import shutil
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from duobench.core.errors import DataError, NoSuccessesError
from duobench.data import (
    Actor,
    ActorKind,
    DataSet,
    ExportOptions,
    Recording,
    find_problems,
    merge,
    split,
    summarize,
    transitions,
)
from duobench.data.lerobot.export import Exported, export_lerobot
from duobench.data.reviews import REVIEWS, Judgement
from duobench.data.used_rows import Reason
from tests.data.tools import HORIZON, TASK, child_of

LINES = 20
PERSON = Actor(kind=ActorKind.PERSON, name="P07")


def write_notes(folder: Path, who: str) -> None:
    """Say something about the first episode again and again, as one of several processes."""
    data = DataSet.open(folder, create=False)
    reviews = data.reviews
    for number in range(LINES):
        reviews.add(data.episodes()[0], by=who, note=f"{number}")


def bytes_of(data: DataSet) -> dict[str, bytes]:
    return {path.stem: path.read_bytes() for path in data.episodes()}


def export(data: DataSet, out: Path, **options: Any) -> Exported:
    return export_lerobot(data, out, ExportOptions(cameras=(), **options), workers=0)


def rows_of(data: DataSet, out: Path, **options: Any) -> list[tuple[str, int]]:
    """Names and lengths of the episodes of an export."""
    export(data, out, **options)
    about = json.loads((out / "meta" / "duobench.json").read_text())
    return [(Path(each["file"]).stem, each["length"]) for each in about["episodes"]]


def test_what_is_said_later_is_honoured_and_no_byte_of_a_recording_changes(
    data: DataSet, tmp_path: Path
) -> None:
    first, second, third = data.episodes()
    before = bytes_of(data)
    reviews = data.reviews
    reviews.add(first, by="P07", kept=False, note="The cube was pushed.")
    reviews.add(second, by="P07", rows=(5, 30))
    reviews.add(third, by="P11", kept=False)
    reviews.add(third, by="P11", undo=True)
    assert bytes_of(data) == before
    assert data.kept(TASK) == 2
    (task,) = summarize(data).tasks
    assert (task.episodes, task.discarded, task.reviewed) == (3, 1, 2)
    assert task.unused == {Reason.TRIMMED: HORIZON - 25}
    expected = [(second.stem, 25), (third.stem, HORIZON)]
    assert rows_of(data, tmp_path / "exported") == expected
    learned = [(each.rows[0], each.next_rows[-1]) for each in transitions(data, TASK)]
    assert learned == [(5, 30), (0, HORIZON)]
    assert find_problems(data) == []
    line = json.loads((data.path / REVIEWS).read_text().splitlines()[0])
    assert (line["by"], line["episode"]) == ("P07", f"{TASK}/00000")
    assert line["at"].endswith("+00:00")
    reviews.add(first, kept=True)
    assert rows_of(data, tmp_path / "later")[0] == (first.stem, HORIZON)


@pytest.mark.slow
def test_two_processes_lose_no_line(data: DataSet) -> None:
    children = [child_of(__name__, data.path, who) for who in ("P07", "P11")]
    for child in children:
        assert child.communicate(timeout=240)[1] == ""
    reviews = data.reviews
    said = [(review.by, review.note) for review in reviews.reviews]
    assert sorted(said) == sorted((who, f"{n}") for who in ("P07", "P11") for n in range(LINES))
    assert reviews.unreadable == {}


def test_half_a_line_is_tolerated_named_and_ends_there(data: DataSet) -> None:
    first, second, _ = data.episodes()
    data.reviews.add(first, kept=False)
    log = data.path / REVIEWS
    whole = log.read_bytes()
    log.write_bytes(whole + whole[:-20])
    data.reviews.add(second, kept=False)
    reviews = data.reviews
    assert [reviews.of(path).kept for path in data.episodes()] == [False, False, None]
    (problem,) = find_problems(data)
    assert problem.path == log
    assert "Line 2 cannot be read" in problem.what


def test_it_travels_with_its_episodes_under_other_names_too(data: DataSet, tmp_path: Path) -> None:
    first, second, _ = data.episodes()
    other = DataSet.open(tmp_path / "other")
    shutil.copytree(data.path / "episodes", other.path / "episodes")
    shutil.move(other.episode(TASK, "00002"), other.episode(TASK, "00000"))  # another one
    data.reviews.add(first, kept=False, by="P07")
    data.reviews.add(second, note="slow")
    other.reviews.add(other.episode(TASK, "00000"), kept=False, by="P11")
    for _ in range(2):  # also when it goes on after an interruption
        merge([data, other], tmp_path / "merged", rename=True)
    merged = DataSet.open(tmp_path / "merged")
    reviews = merged.reviews
    found = {path.stem: reviews.of(path) for path in merged.episodes()}
    assert [found[name].kept for name in ("00000", "00001", "00002")] == [False, None, False]
    assert found["00001"].note == "slow"
    assert (found["00000"].by, found["00002"].by) == ("P07", "P11")
    assert len(reviews.reviews) == 3
    parts = tmp_path / "one", tmp_path / "two"
    split(merged, *parts, fraction=0.34)
    travelled = [DataSet.open(part).reviews.reviews for part in parts]
    assert sum(map(len, travelled)) == 3
    assert find_problems(merged) == []


def copied(data: DataSet, folder: Path) -> DataSet:
    shutil.copytree(data.path, folder)
    return DataSet.open(folder)


def test_what_leaves_nothing_to_export_is_said(data: DataSet, tmp_path: Path) -> None:
    data.reviews.add(data.episodes()[0], rows=(0, 5))
    told = "In 3 every row is left out: trimmed and uncorrected, uncorrected"
    with pytest.raises(DataError, match=told):
        export(data, tmp_path / "out", only_corrections=True)


def test_joining_copies_changes_no_judgement(data: DataSet, tmp_path: Path) -> None:
    first, second, third = data.episodes()
    copy = copied(data, tmp_path / "copy")
    data.reviews.add(first, kept=False)
    time.sleep(0.01)
    copy.reviews.add(copy.episodes()[0], note="slow")
    time.sleep(0.01)
    data.reviews.add(first, undo=True)
    data.reviews.add(second, kept=False)
    data.reviews.add(second, kept=True)
    data.reviews.add(third, kept=False)  # of which the copy knows nothing
    log = data.path / REVIEWS
    lines = [json.loads(line) for line in log.read_text().splitlines()]
    lines[2]["at"] = "2099-01-01T00:00:00.000+00:00"  # a clock that was put back
    log.write_text("".join(json.dumps(line) + "\n" for line in lines))
    for sources in ([data, copy], [copy, data]):
        merge(sources, tmp_path / "merged")
    merged = DataSet.open(tmp_path / "merged")
    found = [merged.reviews.of(path) for path in merged.episodes()]
    assert [(each.kept, each.note) for each in found] == [(None, "slow"), (True, ""), (False, "")]
    exported = export_lerobot([copy, data], tmp_path / "out", ExportOptions(cameras=()), workers=0)
    assert exported.episodes == 2, "a copy without its log brings nothing back"


def test_an_editor_may_have_saved_the_log(data: DataSet) -> None:
    data.reviews.add(data.episodes()[0], kept=False)
    data.reviews.add(data.episodes()[1], note="slow")
    log = data.path / REVIEWS
    text = log.read_bytes().replace(b"\n", b"\r\n\r\n")
    log.write_bytes(codecs.BOM_UTF8 + text)
    reviews = data.reviews
    assert [reviews.of(path).kept for path in data.episodes()] == [False, None, None]
    assert (reviews.unreadable, find_problems(data)) == ({}, [])


def test_it_is_about_a_recording_and_not_about_its_name(data: DataSet) -> None:
    first, second, third = data.episodes()
    data.reviews.add(first, kept=False)
    data.reviews.add(second, kept=False)
    third.replace(first)
    second.unlink()
    assert data.reviews.of(first) == Judgement()
    assert data.kept(TASK) == 1
    told = [problem.what for problem in find_problems(data)]
    assert [f"{TASK}/00000 was said about another recording" in each for each in told] == [
        False,
        True,
    ]
    assert f"{TASK}/00001, which is missing" in told[0]


@pytest.mark.parametrize(
    ("said", "expected"),
    [
        ({}, "one line keeps, discards"),
        ({"undo": True}, "Nothing was said about"),
        ({"undo": True, "kept": True}, "one line keeps"),
        ({"rows": (7, 7)}, "first row is before the last"),
        ({"rows": (0, HORIZON + 1)}, f"are 0 to {HORIZON}, got"),
        ({"kept": 1}, "Expected `bool"),
        ({"note": "\ud800"}, "surrogates not allowed"),
    ],
)
def test_what_cannot_be_said_is_refused(data: DataSet, said: Any, expected: str) -> None:
    with pytest.raises(DataError, match=expected):
        data.reviews.add(data.episodes()[0], **said)
    assert not (data.path / REVIEWS).exists()


@pytest.fixture
def people(demonstrations: Callable[..., Path], data: DataSet, tmp_path: Path) -> DataSet:
    """A success and a failure, as if a person had led them."""
    led = DataSet.open(tmp_path / "people")
    (success,) = DataSet.open(demonstrations(TASK)).episodes()
    for number, path in enumerate((success, data.episodes()[0])):
        recording = Recording.read(path)
        info = replace(recording.info, actor=PERSON)
        replace(recording, info=info).write(led.episode(TASK, f"{number:05d}"))
    return led


@pytest.mark.slow
def test_of_people_successes_alone_are_exported_unless_asked(
    people: DataSet, data: DataSet, tmp_path: Path
) -> None:
    done = export(people, tmp_path / "default")
    assert (done.episodes, done.left_out, done.failures) == (1, 1, 1)
    assert export(people, tmp_path / "all", keep_failures=True).episodes == 2
    assert export(data, tmp_path / "programs").episodes == 3, "nobody led them"
    with pytest.raises(DataError, match="by one option"):
        ExportOptions(only_successes=True, keep_failures=True)


@pytest.mark.slow
def test_a_success_whose_row_is_trimmed_away_is_none(people: DataSet, tmp_path: Path) -> None:
    path = people.episodes()[0]
    step = Recording.read(path).success_step
    assert step is not None
    people.reviews.add(path, rows=(10, step))
    assert rows_of(people, tmp_path / "with") == [(path.stem, step - 10)]
    people.reviews.add(path, rows=(10, step - 1))
    assert summarize(people).successes == 0
    with pytest.raises(NoSuccessesError, match="2 that people led did not succeed"):
        export(people, tmp_path / "without")


if __name__ == "__main__":
    write_notes(Path(sys.argv[1]), sys.argv[2])
