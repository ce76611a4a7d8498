"""`duobench compare` says of each run or bundle whether it was verified."""

import csv
import json
import re
import shutil
from pathlib import Path

import pytest

from duobench.results.folder import RunFolder
from tests.cli.conftest import Told, refusal
from tests.evaluation import toy_tasks
from tests.evaluation.forging import Document, Edit, rewritten
from tests.results.samples import key
from tests.results.test_report import Page

WRONG = "exact 1, contradicted 1. bin_sort, episode 1: stage_changes is ((3, 1),), the replay gives"
SHORT = ("--tasks", "bin_sort", "--episodes", "2", "--videos", "0", "--workers", "0")


@pytest.fixture
def run(tmp_path: Path, told: Told) -> Path:
    """An honest run of two episodes."""
    told("eval", "--policy", "hold", "--out", tmp_path / "run", *SHORT)
    return tmp_path / "run"


def forged(run: Path, name: str, edit: Edit) -> Path:
    """A copy of a run whose second record is edited, with a checksum that fits."""
    folder = RunFolder(shutil.copytree(run, run.with_name(name)))
    rewritten(folder.record(key(folder, "bin_sort", 1)), edit)
    return folder.path


def further(record: Document) -> None:
    record.update(final_stage=1, stage_changes=[[3, 1]])


def without_targets(record: Document) -> None:
    record.update(sent=None)


def verified(out: Path) -> dict[str, tuple[str, str]]:
    """The columns of the table of results, by name; the JSON form has the same."""
    with (out / "table.csv").open(encoding="utf-8", newline="") as file:
        lines = list(csv.DictReader(file))
    found = {line["name"]: (line["verified"], line["verification"]) for line in lines}
    policies = json.loads((out / "comparison.json").read_text())["policies"].values()
    assert found == {
        one["name"]: (one.get("verified", ""), one.get("verification", "")) for one in policies
    }
    return found


@pytest.mark.long
def test_a_forged_record_a_bundle_and_what_cannot_be_played_have_their_words(
    run: Path, told: Told, capsys: pytest.CaptureFixture[str]
) -> None:
    out, bundle = run.with_name("compared"), run.with_name("run.duobench.zip")
    told("bundle", run)
    wrong, part = forged(run, "wrong", further), forged(run, "part", without_targets)
    words = [bundle, f"wrong={wrong}", f"part={part}", "paper:ACT", "--out", out]
    assert refusal("compare", *words, "--verify", "--workers", "0") == "1"
    said = capsys.readouterr().out
    found = verified(out)
    assert found.pop("hold") == ("yes", "exact 2")
    assert found.pop("ACT [paper]") == ("", "")
    verdict, details = found.pop("wrong")
    assert verdict == "no"
    assert details.startswith(
        "exact 1, contradicted 1. bin_sort, episode 1: stage_changes is ((3, 1),), "
    )
    verdict, details = found.pop("part")
    assert (verdict, details) == (
        "in part",
        "exact 1, not verifiable 1. bin_sort, episode 1: It has no joint targets.",
    )
    assert found == {}
    assert "Verified, hold: yes (exact 2)\n" in said
    assert re.search(r"Verified, wrong: no \(exact 1, contradicted 1\. bin_sort, episode 1: ", said)
    page = Page(out / "index.html").words
    assert f"wrong is not verified: {WRONG}" in page
    assert "part is verified in part: exact 1, not verifiable 1." in page
    assert "| Verified | yes | no | in part | – |" in (out / "table.md").read_text()
    assert r"Verified & yes & no & in part & -- \\" in (out / "table.tex").read_text()


def test_without_the_option_nothing_is_played_and_nothing_is_kept(run: Path, told: Told) -> None:
    out, wrong = run.with_name("compared"), forged(run, "wrong", further)
    words = ["compare", run, f"wrong={wrong}", "--out", out]
    said = told(*words)
    assert "Verified" not in said
    assert set(verified(out).values()) == {("not checked", "")}
    told("compare", run, f"again={run}", "--out", out, "--verify", "--workers", "0")
    assert set(verified(out).values()) == {("yes", "exact 2")}
    told(*words)
    assert set(verified(out).values()) == {("not checked", "")}


def test_tasks_of_others_are_verified_where_they_may_be_imported(
    tmp_path: Path, told: Told
) -> None:
    run, out = tmp_path / "run", tmp_path / "compared"
    words = ["--tasks", toy_tasks.NOD_NAME, "--episodes", "2", "--videos", "0", "--workers", "0"]
    told("eval", "--policy", "hold", "--out", run, *words)
    words = ["compare", run, f"again={run}", "--out", out, "--verify", "--workers", "0"]
    assert refusal(*map(str, words)) == "1"
    for verdict, details in verified(out).values():
        assert verdict == "no"
        assert details.startswith("not verifiable 2. nod, episode 0: ")
    told(*words, "--import-tasks")
    assert set(verified(out).values()) == {("yes", "exact 2")}


@pytest.mark.slow
def test_one_condition_is_verified_alone(run: Path, told: Told) -> None:
    shifted, out = run.with_name("shifted"), run.with_name("compared")
    words = ["--suite", "robust", "--axes", "latency", "--levels", "1", *SHORT]
    told("eval", "--policy", "hold", "--out", shifted, *words)
    words = ["compare", f"plain={run}", f"late={shifted}@latency-1", "--out", out, "--verify"]
    said = told(*words, "--workers", "0")
    assert said.count("Verified, ") == 2
    assert verified(out)["late"] == ("yes", "exact 2")
    for more in ([shifted, shifted], [f"sim={run}", "--mixed"]):
        message = refusal("compare", *more, "--out", run.with_name("more"), "--verify")
        assert "--verify is for the comparison of single conditions" in message
