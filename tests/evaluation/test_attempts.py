"""A policy that tosses a coin leaves a trace, whatever it does on tails."""

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from duobench.cli import main
from duobench.evaluation.replay.verification import Verdict, verify
from duobench.results.bundle import open_source, write_bundle
from duobench.results.comparison import compare, write_comparison
from duobench.results.folder import RunFolder
from duobench.results.records import Record
from duobench.results.run import Resuming, TimeLimits
from tests.evaluation.conftest import Play

Toss = Callable[[Play], RunFolder]


def dies(play: Play) -> RunFolder:
    return play("DiesOnce", workers=1, episodes=2)[0]


def raises(play: Play) -> RunFolder:
    play("BreaksOnce", episodes=2)
    return play("BreaksOnce", episodes=2, resuming=Resuming(retry_broken=True))[0]


def deletes(play: Play) -> RunFolder:
    folder, results = play("hold", episodes=2)
    folder.record(results.tasks[0].records[1].key).unlink()
    return play("hold", episodes=2)[0]


TOSSES = [(dies, "policy"), (raises, "error"), (deletes, "failure")]


def first(folder: RunFolder) -> Record:
    """The first record that is not of a first attempt."""
    records = folder.read_records(folder.read_run())
    return next(record for record in records if record.attempt > 1)


@pytest.mark.long
@pytest.mark.parametrize(("toss", "end"), TOSSES)
def test_an_attempt_that_was_not_the_first_is_counted(
    play: Play, toss: Toss, end: str, tmp_path: Path
) -> None:
    folder = toss(play)
    record = first(folder)
    assert (record.attempt, record.earlier) == (2, (end,))
    assert len(verify(folder, import_tasks=True).of(Verdict.EXACT)) == 4
    page = folder.page.read_text()
    assert re.search(r"<dt>Begun more than once</dt><dd>[1-4]</dd>", page)
    assert re.search(rf"<dt>Earlier attempts</dt><dd>{end} \([1-4]\)</dd>", page)
    summary = json.loads(folder.file("summary.json").read_text())
    assert 1 <= summary["overall"]["begun_more_than_once"] <= 4
    bundle = tmp_path / "run.duobench.zip"
    main(["bundle", str(folder.path), "--out", str(bundle)])
    assert open_source(bundle).attempts() == folder.attempts()
    again = write_bundle(open_source(bundle), tmp_path / "again.duobench.zip")
    assert again.attempts[record.key.path][0] == end
    page = write_comparison(compare([str(folder.path), str(bundle)]), tmp_path / "comparison")
    assert re.search(r'<td class="right">[1-4]</td>\n<td class="verified">', page.read_text())


def test_a_run_of_errors_that_gives_way_takes_no_attempt_back(play: Play) -> None:
    def played(**changes: Any) -> set[tuple[str, ...]]:
        folder, _ = play("RaisesInTheSecondAnswer", episodes=1, **changes)
        return {each.earlier for each in folder.read_records(folder.read_run())}

    assert played() == {()}
    assert played(limits=TimeLimits(act_timeout=11.0)) == {("error",)}
    assert played(limits=TimeLimits(act_timeout=12.0), resuming=Resuming(fresh=True)) == {()}


@pytest.mark.slow
@pytest.mark.parametrize("from_bundle", [False, True])
def test_a_record_that_hides_its_earlier_attempts_is_contradicted(
    play: Play, tmp_path: Path, *, from_bundle: bool
) -> None:
    folder = deletes(play)
    folder.write(replace(first(folder), attempt=1, earlier=()))
    if from_bundle:
        write_bundle(folder, tmp_path / "run.duobench.zip")
    source = open_source(tmp_path / "run.duobench.zip") if from_bundle else folder
    (finding,) = verify(source, import_tasks=True).of(Verdict.CONTRADICTED)
    assert finding.reason == "its earlier attempts ended so: none; the journal says: failure"


@pytest.mark.parametrize(
    ("copied", "ends", "reason"),
    [
        (False, "success", "it is a failure; the journal says: success"),
        (True, "success", "its earlier attempts ended so: none; the journal says: failure"),
        (True, "failure", None),
    ],
)
def test_a_record_of_another_attempt_than_the_noted_one_is_contradicted(
    play: Play, ends: str, reason: str | None, *, copied: bool
) -> None:
    folder, _ = play("hold", episodes=1)
    (journal,) = folder.path.glob("attempts/*")
    luckier = journal.read_text().replace('"how":"failure"', f'"how":"{ends}"')
    (journal.with_name("1-of-2.jsonl") if copied else journal).write_text(luckier)
    assert {each.success for each in folder.read_records(folder.read_run())} == {False}
    found = verify(folder, import_tasks=True).of(Verdict.CONTRADICTED)
    assert [each.reason for each in found] == ([reason] * 2 if reason else [])


@pytest.mark.slow
def test_what_no_journal_notes_is_told(play: Play, capsys: pytest.CaptureFixture[str]) -> None:
    folder, _ = play("random", episodes=1)
    for path in folder.path.glob("attempts/*"):
        path.unlink()
    assert verify(folder, import_tasks=True).unnoted == 2
    main(["verify", str(folder.path), "--import-tasks"])
    assert "Of 2 episodes no attempt is on record." in capsys.readouterr().out


def test_a_record_that_was_written_just_before_a_kill_is_that_of_its_attempt(play: Play) -> None:
    folder, _ = play("random", episodes=1)
    (journal,) = folder.path.glob("attempts/*")
    lines = journal.read_text().splitlines(keepends=True)
    journal.write_text("".join(line for line in lines if '"ended"' not in line))
    folder, results = play("random", episodes=1)
    assert [each.attempt for one in results.tasks for each in one.records] == [1, 1]
    assert not verify(folder, import_tasks=True).of(Verdict.CONTRADICTED)


@pytest.mark.slow
def test_record_that_was_removed_is_told_while_it_is_missing(
    play: Play, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, results = play("random", episodes=2)
    assert folder.removed(folder.read_run()) == ""
    key = results.tasks[0].records[1].key
    folder.record(key).unlink()
    words = f"Played, and without a record now: 1, such as {key.path}."
    bundle = tmp_path / "b.duobench.zip"
    for command in (
        ["report", str(folder.path)],
        ["bundle", str(folder.path), "--out", str(bundle)],
        ["verify", str(bundle), "--import-tasks"],
    ):
        main(command)
        assert words in " ".join(capsys.readouterr().out.split())
