"""The whole way: two hidden policies, fifteen trials each, judged and compared."""

import json
import random
from pathlib import Path
from typing import NamedTuple

import pytest

from duobench.core.errors import EvaluationError
from duobench.evaluation.replay.verification import Verdict, verify
from duobench.real.sessions.trials_folder import LogKind, TrialsFolder
from duobench.real.sessions.trials_report import TrialsReport, write_trials_report
from duobench.results.bundle import open_source, read_source, write_bundle
from duobench.results.mixed import read_mixed, write_mixed
from duobench.results.records import InvalidTrial
from duobench.results.scores import wilson_interval
from tests.real.sessions import toys
from tests.real.sessions.operator import POLICIES, Operator, Stand, records, run
from tests.results.samples import LIFT, sample_folder, sample_record, sample_run

EPISODES = 15
LAST = 5
UNDO, INVALID = 4, 7
"""Trials in which the operator takes a press back, and which is invalid once."""
REASON = "A person came into the way."


def said(trial: int) -> int:
    """The stage that the operator sees in a trial."""
    return random.Random(trial).choice([0, 1, 2, 4, LAST, LAST])


class Scripted:
    """What the operator does in fifteen trials of each, and what he saw of the page."""

    def __init__(self) -> None:
        self.names: set[str] = set()
        self.over: dict[str, object] = {}

    def __call__(self, operator: Operator) -> None:
        number, spoiled = 0, False
        while number < 2 * EPISODES:
            operator.begin()
            self.names.add(json.dumps(operator.status))
            stage = said(number)
            if number == UNDO:
                operator.play([[3], [None, 1], [2]])
                operator.finish()
            elif number == INVALID and not spoiled:
                operator.play([[1]])
                operator.invalid(REASON)
                spoiled = True
                continue
            else:
                operator.play([[stage] if stage else []])
                if number == 0:
                    operator.say("note", text="The first one.")
                operator.finish(holds=number % 2 == 0)
            number += 1
        self.over = operator.until(lambda status: status.get("results"))


class Whole(NamedTuple):
    folder: TrialsFolder
    report: TrialsReport
    script: Scripted


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Whole:
    """All trials played and reported."""
    script = Scripted()
    stand = Stand(
        tmp_path_factory.mktemp("whole") / "trials", POLICIES, episodes=EPISODES, blind=True
    )

    def report() -> dict[str, object]:
        results = write_trials_report(stand.folder)
        return {"results": [each.row() for each in results.policies], "files": "here"}

    with stand.ending:
        assert run(stand, script, report)
    return Whole(stand.folder, write_trials_report(stand.folder), script)


@pytest.mark.long
def test_every_trial_is_recorded_as_it_was_judged(whole: Whole) -> None:
    played = records(whole.folder)
    trials = whole.folder.read_plan().trials()
    for trial in trials:
        record = played["AB"[trial.policy]][trial.episode]
        stage = 2 if trial.number == UNDO else said(trial.number)
        is_solved = stage == LAST
        assert (record.final_stage, record.success) == (stage, is_solved)
        assert record.success_at_end == (is_solved and trial.number % 2 == 0)
        assert record.judged is not None
        assert record.judged.rater == "operator"
        assert record.layout["poses"].keys() >= {"white_cube", "black_bowl"}
        assert record.targets() is not None
    again = played["AB"[trials[INVALID].policy]][trials[INVALID].episode]
    assert again.judged is not None
    assert again.judged.repeated == (InvalidTrial(reason=REASON, stage=1, is_chosen=True),)


@pytest.mark.long
def test_undone_presses_stay(whole: Whole) -> None:
    trial = whole.folder.read_plan().trials()[UNDO]
    record = records(whole.folder)["AB"[trial.policy]][trial.episode]
    assert record.judged is not None
    presses = record.judged.presses
    assert [(press.stage, press.step) for press in presses] == [
        (3, 0),
        (None, toys.CHUNK),
        (1, toys.CHUNK),
        (2, 2 * toys.CHUNK),
    ]
    assert record.stage_changes == ((toys.CHUNK, 1), (2 * toys.CHUNK, 2))
    logged = [
        (entry.stage, entry.step)
        for entry in whole.folder.read_log()
        if entry.kind is LogKind.PRESS and entry.trial == UNDO
    ]
    assert logged == [(press.stage, press.step) for press in presses]


@pytest.mark.slow
def test_policies_take_turns_over_the_same_layouts(whole: Whole) -> None:
    played = records(whole.folder)
    for one, other in zip(played["A"], played["B"], strict=True):
        assert (one.seed, one.layout) == (other.seed, other.layout)
    assert {trial.policy for trial in whole.folder.read_plan().trials()[::2]} == {0, 1}


@pytest.mark.slow
def test_page_hides_the_names_until_the_end(whole: Whole) -> None:
    shown = " ".join(whole.script.names)
    assert "Patient" not in shown
    assert "Keen" not in shown
    assert {json.loads(status)["trial"]["policy"] for status in whole.script.names} == {""}
    assert "Patient" in json.dumps(whole.script.over)


@pytest.mark.slow
def test_report_has_intervals_and_invalid_trials(whole: Whole) -> None:
    folder, report, _ = whole
    for one, played in zip(report.policies, records(folder).values(), strict=True):
        successes = sum(record.success for record in played)
        assert (one.score.successes, one.score.episodes) == (successes, EPISODES)
        assert one.score.interval == wilson_interval(successes, EPISODES)
    assert report.invalid == ((REASON, 1),)
    page = folder.page.read_text()
    assert REASON in page
    assert "compar" in folder.run.page.read_text().lower()
    for one in report.policies:
        assert f"run/{one.page}index.html" in page
        assert "real arms" in (folder.run.path / one.page / "index.html").read_text()


@pytest.mark.slow
def test_nothing_can_be_played_again(whole: Whole) -> None:
    found = verify(open_source(whole.folder.run.path))
    assert not found.is_verified
    assert {each.verdict for each in found.findings} == {Verdict.UNVERIFIABLE}
    assert "real arms" in found.findings[0].reason


@pytest.mark.slow
def test_bundle_is_read_as_the_folder(whole: Whole, tmp_path: Path) -> None:
    write_bundle(whole.folder.run, tmp_path / "b.duobench.zip")
    assert read_source(tmp_path / "b.duobench.zip") == read_source(whole.folder.run.path)


@pytest.mark.slow
def test_mixed_table(whole: Whole, tmp_path: Path) -> None:
    folder, report, _ = whole
    task = folder.read_plan().task
    run_ = sample_run(tasks=(task,), episodes=2)
    simulated = [sample_record(task, 0, (1, 2, 3, 4, 5)), sample_record(task, 1, (9,))]
    sim = sample_folder(tmp_path / "sim", run_, simulated)
    sources = [f"sim={sim.path}", str(folder.run.path)]
    table = read_mixed(sources)
    places = list(table.entrants)
    assert [tuple(place) for place in places] == [
        ("", "sim", "sim"),
        ("", "sim", "real"),
        ("", "mixed", "real"),
    ]
    (row,) = table.rows  # of one task, all of them would be the same
    simulated = table.score(row, places[0])
    assert simulated is not None
    assert simulated.successes == 1
    by_training = {one.trained_on: one.score for one in report.policies}
    for place in places[1:]:
        real = table.score(row, place)
        assert real is not None
        assert real.successes == by_training[place.trained_on].successes
        assert real.interval == by_training[place.trained_on].interval
    (test,) = table.tests  # in simulation there is one training
    assert test.pair.paired
    assert test.domain == "real"
    page = write_mixed(table, tmp_path / "mixed").read_text()
    assert "Evaluated on real arms" in page
    assert "trained on mixed" in page
    assert "n = 15" in (tmp_path / "mixed" / "mixed.md").read_text()
    with pytest.raises(EvaluationError, match="not known"):
        read_mixed([str(sim.path)])
    with pytest.raises(EvaluationError, match="second run"):
        read_mixed([sources[0], sources[0]])


def test_training_is_one_of_three(tmp_path: Path) -> None:
    sim = sample_folder(
        tmp_path / "sim", sample_run(tasks=(LIFT,), episodes=1), [sample_record(LIFT, 0, (1, 2))]
    )
    with pytest.raises(EvaluationError, match="sim, real, mixed"):
        read_mixed([f"dreams={sim.path}"])
