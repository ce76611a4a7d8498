"""An honest run verifies to the bit; every edit of its records is found."""

import json
import shutil
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from duobench.core.errors import DuoBenchError, FileError, OtherRunError
from duobench.core.randomness import episode_seed, policy_seed
from duobench.evaluation.replay.verification import Verdict, Verification, verify
from duobench.evaluation.runners.evaluations import evaluate
from duobench.results.bundle import read_source
from duobench.results.folder import RunFolder
from duobench.results.journal import Journal
from duobench.results.suite import Suite, find_tasks
from tests.evaluation import test_recorder
from tests.evaluation.forging import (
    Document,
    Edit,
    copied,
    flipped_bit,
    redescribed,
    rewritten,
    targets_of,
    with_targets,
)
from tests.quick_first import quick_first
from tests.results.samples import key

TASK = "bin_sort"
SECOND = 1
"""The episode that is edited; there are 0 and 1."""


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, RunFolder]:
    """Honest runs: of the expert, which succeeds, and of a policy that reaches nothing."""
    folders = {}
    for policy, tasks in (("expert", [TASK, "transfer_cube"]), ("hold", [TASK])):
        folders[policy] = RunFolder(tmp_path_factory.mktemp("runs") / policy)
        suite = Suite(tasks=find_tasks(tasks), episodes=2)
        evaluate(policy, suite, folders[policy], workers=0)
    return folders


@pytest.fixture
def held(runs: dict[str, RunFolder], tmp_path: Path) -> RunFolder:
    """A copy of the latter."""
    return copied(runs["hold"], tmp_path / "copy")


@pytest.fixture
def verified(runs: dict[str, RunFolder], tmp_path: Path) -> Any:
    """Forge the second episode of a run and its journal, and verify what becomes of it."""

    def forge(edit: Edit, policy: str = "expert", *, sealed: bool = True) -> Verification:
        folder = copied(runs[policy], tmp_path / "forged")
        second = key(folder, TASK, SECOND)
        rewritten(folder.record(second), edit, sealed=sealed)
        with suppress(DuoBenchError):  # a record that cannot be read
            journal = Journal(next(folder.path.glob("attempts/*")), folder.entries)
            journal.end(folder.read_record(folder.read_run(), second), None)
        return verify(folder)

    return forge


def only_contradiction(found: Verification) -> str:
    """Why the edited record is contradicted, where no other one is."""
    assert not found.is_verified
    (wrong,) = found.of(Verdict.CONTRADICTED)
    assert (wrong.key.task, wrong.key.episode) == (TASK, SECOND)
    assert len(found.of(Verdict.EXACT)) == len(found.findings) - 1
    return wrong.reason


@pytest.mark.slow
@pytest.mark.parametrize("policy", ["expert", "hold"])
def test_honest_run_agrees_to_the_bit(runs, policy):
    found = verify(runs[policy])
    assert {one.verdict for one in found.findings} == {Verdict.EXACT}
    assert len(found.findings) == found.run.suite.size
    assert found.missing == 0
    assert found.is_verified
    assert found == verify(runs[policy], workers=1)


@pytest.mark.parametrize("policy", quick_first([f"{test_recorder.__name__}:Drifts", "random"]))
def test_run_on_tasks_of_others_agrees_where_these_may_be_imported(play, policy):
    folder, _ = play(policy, episodes=1)
    found = verify(folder)
    assert {one.verdict for one in found.findings} == {Verdict.UNVERIFIABLE}
    assert "is not in the benchmark" in found.findings[0].reason
    assert not found.is_verified
    found = verify(folder, import_tasks=True)
    assert {one.verdict for one in found.findings} == {Verdict.EXACT}


# --- edits ---------------------------------------------------------------------------------------


def changed(**fields: Any) -> Edit:
    return lambda record: record.update(fields)


def targets(change: Callable[[Any], Any], **fields: int) -> Edit:
    """Change the joint targets, and add to other fields."""

    def edit(record: Document) -> None:
        with_targets(record, change(targets_of(record)))
        record.update({name: record[name] + more for name, more in fields.items()})

    return edit


def one_bit(step: int, number: int) -> Edit:
    return targets(lambda rows: flipped_bit(rows, step, number))


def too_fast(rows: Any) -> Any:
    rows[7, 0] += 0.5
    return rows


def step_removed(record: Document) -> None:
    targets(lambda rows: rows[:-1], steps=-1)(record)
    record["truncated"] = False


def other_seed(record: Document) -> None:
    record["seed"] += 1
    record["policy_seed"] = policy_seed(TASK, record["seed"])


def earlier_stage(record: Document) -> None:
    record["stage_changes"][0][0] -= 1


def claimed_success(record: Document) -> None:
    stage = record["max_stage"]
    record.update(stage_changes=[[record["steps"], stage]], final_stage=stage, unmet=[])
    record.update(success=True, success_at_end=True, terminated=True, truncated=False)


def moved_start(record: Document) -> None:
    pose = next(iter(record["layout"]["poses"].values()))
    pose[0] += 1e-9


def other_hash(moment: str, part: str) -> Edit:
    return lambda record: record[moment].update({part: "0" * 64})


ADDED_STAGE = changed(stage_changes=[[10, 1]], final_stage=1)


@pytest.mark.long
@pytest.mark.parametrize(
    ("policy", "edit", "words"),
    [
        ("expert", one_bit(40, 3), "physics at the end is"),
        ("expert", one_bit(-1, 9), "physics at the end is"),
        ("expert", targets(lambda rows: rows[:-1]), "does not hold as many joint targets"),
        ("hold", step_removed, "the episode is not over after"),
        ("expert", targets(lambda rows: rows[[*range(len(rows)), -1]], steps=1), "steps is"),
        ("expert", targets(too_fast), "joint targets of step 8 exceed a limit"),
        ("expert", changed(episode=7), "its episode is 7, expected was 1"),
        ("expert", other_seed, "its seed is"),
        ("expert", earlier_stage, "stage_changes is"),
        ("hold", ADDED_STAGE, "final_stage is 1, the replay gives 0"),
        ("hold", claimed_success, "success is True, the replay gives False"),
        ("expert", moved_start, "start of"),
        ("hold", changed(steps=100), "does not hold as many joint targets"),
        ("hold", changed(horizon=10**9), "The horizon is 1000000000, that of the task is 216"),
        ("hold", changed(terminated=True), "terminated is True, the replay gives False"),
        ("hold", changed(truncated=False), "truncated is False, the replay gives True"),
        ("expert", changed(success_at_end=False), "success_at_end is False, the replay gives True"),
        ("expert", other_hash("start", "physics"), "physics at the start is 000"),
        ("expert", other_hash("end", "stages"), "stages at the end is 000"),
        ("expert", changed(end=None), "physics at the end is None"),
        ("expert", changed(state_hash="0" * 64), "state_hash is 000"),
        ("hold", changed(unmet=["nothing"]), "unmet is ('nothing',)"),
        ("expert", changed(instruction="Do it."), "instruction is Do it., the replay gives"),
        ("expert", changed(policy="mine"), "its policy is mine, expected was expert"),
        ("expert", changed(versions={"mujoco": "4.0.9"}), "its version of mujoco is 4.0.9, that"),
    ],
)
def test_edit_is_found_although_the_checksum_fits(verified, policy, edit, words):
    assert words in only_contradiction(verified(edit, policy))


@pytest.mark.long
@pytest.mark.parametrize(
    "edit",
    [
        one_bit(40, 3),
        changed(policy="mine"),
        changed(instruction="Do it."),
        changed(versions={}),
        lambda record: record.pop("sha256"),
        lambda record: record["config"].update(unknown=1),
    ],
)
def test_edit_without_a_new_checksum_is_found_by_every_reader(verified, tmp_path, edit):
    assert "Its checksum does not fit" in only_contradiction(verified(edit, sealed=False))
    with pytest.raises(FileError, match=rf"{SECOND:05d}\.json: Its checksum does not fit"):
        read_source(tmp_path / "forged")


def test_spaces_and_the_order_of_keys_are_no_edit(runs, held):
    path = held.record(key(held, TASK, 0))
    document = json.loads(path.read_text())
    path.write_text(json.dumps(dict(reversed(document.items())), indent=8))
    assert read_source(held.path) == read_source(runs["hold"].path)


def test_record_of_another_run_is_found(runs, held):
    other = runs["expert"]
    shutil.copy(other.record(key(other, TASK, SECOND)), held.record(key(held, TASK, SECOND)))
    with pytest.raises(OtherRunError, match=r"another run than run\.json .*: its policy is expert"):
        verify(held)


def test_record_under_another_index_is_found(held):
    shutil.copy(held.record(key(held, TASK, 0)), held.record(key(held, TASK, SECOND)))
    assert "its episode is 0, expected was 1" in only_contradiction(verify(held))

    def disguised(record: Document) -> None:
        record["episode"], record["seed"] = SECOND, episode_seed(TASK, SECOND)
        record["policy_seed"] = policy_seed(TASK, record["seed"])

    rewritten(held.record(key(held, TASK, SECOND)), disguised)
    reason = only_contradiction(verify(held))
    assert "start of" in reason
    assert "physics at the start" in reason


def test_run_that_describes_its_tasks_wrongly_is_found(held):

    def easier(run: Document) -> None:
        run["suite"]["tasks"][0]["category"] = "sequential handoff"

    rewritten(held.description, easier, sealed=False)
    with pytest.raises(FileError, match=r"run\.json: Its checksum does not fit"):
        verify(held)
    rewritten(held.description, easier)
    with pytest.raises(OtherRunError, match="something else differs"):
        verify(held)
    redescribed(held, easier)
    found = verify(held)
    assert "its category is sequential handoff, not" in found.objections[0]
    assert not found.is_verified


@pytest.mark.slow
def test_task_with_a_name_of_the_benchmark_is_that_of_the_benchmark(held):
    redescribed(
        held,
        lambda run: run["suite"]["tasks"][0].update(reference="tests.evaluation.toy_tasks:NOD"),
    )
    assert verify(held, import_tasks=True).is_verified


# --- what cannot be verified ---------------------------------------------------------------------


def test_episode_with_an_error_is_checked_up_to_it(play):
    folder, _ = play("Faulty", episodes=2)
    found = verify(folder, import_tasks=True)
    verdicts = [one.verdict for one in found.findings]
    assert verdicts == [Verdict.ERROR] * 2 + [Verdict.EXACT] * 2
    assert found.is_verified
    claim = changed(stage_changes=[[2, 1]], final_stage=1)
    rewritten(folder.record(key(folder, "wave", 1)), claim)
    (wrong,) = verify(folder, import_tasks=True).of(Verdict.CONTRADICTED)
    assert (wrong.key.task, wrong.key.episode) == ("wave", 1)


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"sent": None, "error": "PolicyTimeoutError: 120 s\n"}, "Its policy was stopped"),
        ({"sent": None, "start": None, "error": "boom\n"}, "failed before the episode began"),
        ({"sent": None}, "no joint targets"),
    ],
)
def test_record_without_targets_is_counted_apart(verified, fields, reason):
    found = verified(changed(**fields), "hold")
    (one,) = found.of(Verdict.UNVERIFIABLE)
    assert reason in one.reason
    assert found.is_verified


def test_run_of_another_suite_is_not_verifiable(held):
    redescribed(held, lambda run: run["suite"].update(version="3"))
    for index in (0, 1):
        rewritten(held.record(key(held, TASK, index)), changed(suite_version="3"))
    found = verify(held)
    assert {one.verdict for one in found.findings} == {Verdict.UNVERIFIABLE}
    assert "suite 3" in found.findings[0].reason
    assert not found.is_verified


@pytest.mark.slow
def test_other_versions_agree_in_stages_and_say_why_not_in_bits(held):
    older: Edit = lambda document: document["versions"].update(numpy="2.0.0")  # noqa: E731
    redescribed(held, older)
    for index in range(2):
        rewritten(held.record(key(held, TASK, index)), older)
    rewritten(held.record(key(held, TASK, SECOND)), other_hash("end", "physics"))
    found = verify(held)
    assert [one.verdict for one in found.findings] == [Verdict.EXACT, Verdict.STAGES]
    assert "instead of 2.0.0: physics at the end" in found.findings[1].reason
    assert found.is_verified
    rewritten(held.record(key(held, TASK, SECOND)), ADDED_STAGE)
    assert not verify(held).is_verified


@pytest.mark.slow
def test_unfinished_run_says_what_is_missing(runs, tmp_path):
    folder = copied(runs["expert"], tmp_path / "part")
    folder.record(key(folder, TASK, 0)).unlink()
    found = verify(folder)
    assert found.missing == 1
    assert found.is_verified
    folder.begin(replace(found.run, suite=replace(found.run.suite, episodes=9)))
    assert verify(folder).missing == 15
