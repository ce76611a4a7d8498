"""Whether a policy answers the same twice: seeded where that is possible, said where it is not."""

import json
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from duobench.cli import main
from duobench.evaluation.policies import PolicyChoice
from duobench.policy import Batching, HoldPolicy, PolicyMetadata
from duobench.policy.batch import ONE_BY_ONE, PolicyPool
from duobench.policy.serving.host import make_served
from duobench.results.comparison import compare, write_comparison
from duobench.results.folder import RunFolder
from duobench.results.records import NOT_REPEATABLE, Record
from duobench.results.report import read_parts
from duobench.results.run import Shard
from duobench.results.tables import episodes_text
from tests.evaluation import toy_noise
from tests.evaluation.conftest import Play, compared
from tests.policy.serving.serving import Serve, server_at
from tests.quick_first import quick_first

SAME = "With one seed, its first answer was the same twice."
DIFFERENT = "This policy is not repeatable: with one seed, its first answers were not the same."


def named(policy: type) -> str:
    return f"{policy.__module__}:{policy.__name__}"


def records_of(folder: RunFolder) -> list[Record]:
    (part,) = read_parts(folder)
    return part.records


@pytest.fixture(autouse=True)
def without_torch(monkeypatch: pytest.MonkeyPatch) -> None:
    """Torch is not there before a policy imports it, and not afterwards."""
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.setitem(sys.modules, "torch", None)
    monkeypatch.delitem(sys.modules, "torch")


@pytest.mark.slow
@pytest.mark.parametrize("policy", [toy_noise.Diffuses, toy_noise.Imports])
def test_noise_of_torch_follows_from_the_seed(play: Play, policy: type) -> None:
    first, results = play(named(policy), "first", workers=1)
    assert results.overall.errors == 0
    sent = [record.sent for record in records_of(first)]
    assert len({*sent}) == len(sent)  # it has noise
    for name, workers in (("again", 1), ("beside", 2), ("here", 0)):
        assert compared(play(named(policy), name, workers=workers)[0]) == compared(first)
    assert {record.first_answer.answer for record in records_of(first)} != {NOT_REPEATABLE}
    assert SAME in first.page.read_text()


@pytest.mark.slow
def test_sets_of_texts_have_one_order_in_all_processes(
    play: Play, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("PYTHONHASHSEED", raising=False)
    first, _ = play(named(toy_noise.Orders), "first", episodes=2, workers=1)
    for name, workers in (("again", 1), ("beside", 2)):
        again, _ = play(named(toy_noise.Orders), name, episodes=2, workers=workers)
        assert compared(again) == compared(first)


@pytest.mark.slow
def test_served_episodes_side_by_side_keep_their_noise_of_torch_apart(
    play: Play, serve: Serve
) -> None:
    alone, _ = play(named(toy_noise.Diffuses), "alone")
    made, _, batching = make_served(named(toy_noise.Diffuses), Batching(size=2))
    server = server_at(serve(made, batching=batching))
    served, _ = play(PolicyChoice(name="openpi", server=server), "served", workers=2)
    assert [one.sent for one in records_of(served)] == [one.sent for one in records_of(alone)]


@pytest.mark.parametrize("workers", quick_first([0, 1]))
@pytest.mark.parametrize("policy", quick_first([toy_noise.AsksTheSystem, toy_noise.Remembers]))
def test_policy_that_answers_otherwise_the_second_time_is_not_repeatable(
    play: Play, policy: type, workers: int, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, _ = play(named(policy), episodes=1, workers=workers)
    for path in map(folder.record, folder.finished(folder.read_run())):
        assert json.loads(path.read_text())["first_answer"]["answer"] == "not repeatable"
    assert DIFFERENT in folder.page.read_text()
    assert SAME not in folder.page.read_text()
    assert json.loads(folder.summary.read_text())["repeatable"] is False
    for verb in ("report", "verify"):
        main([verb, str(folder.path), *["--import-tasks"] * (verb == "verify")])
        out = capsys.readouterr().out
        assert DIFFERENT in out
        assert SAME not in out
    copy = shutil.copytree(folder.path, folder.path.with_name("copy"))
    page = write_comparison(compare([str(folder.path), f"mine={copy}"]), copy / "compared")
    assert f"mine: {DIFFERENT}" in page.read_text()


def test_run_that_goes_on_with_another_first_answer_is_not_repeatable(
    play: Play, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, _ = play(named(toy_noise.Drifts), episodes=1)
    before = records_of(folder)
    play(named(toy_noise.Drifts), episodes=1)
    assert records_of(folder) == before
    assert SAME in folder.page.read_text()
    monkeypatch.setenv("DUOBENCH_TEST_DRIFT", "0.001")
    play(named(toy_noise.Drifts), episodes=2)
    asked = {record.first_answer for record in records_of(folder)}
    assert len(asked) == 2
    assert NOT_REPEATABLE not in {one.answer for one in asked}
    assert DIFFERENT in folder.page.read_text()


def test_scripted_policies_are_asked_like_others(play: Play) -> None:
    folder, _ = play("blind", episodes=1)
    assert SAME in folder.page.read_text()


def test_a_first_answer_of_another_part_is_to_the_same_question(play: Play) -> None:
    for number in (1, 2):
        folder, _ = play("random", episodes=2, shard=Shard(number=number, count=2))
    (asked,) = {record.first_answer for record in records_of(folder)}
    assert asked is not None
    assert SAME in folder.page.read_text()


def test_equal_records_are_said_to_be_the_same(play: Play, tmp_path: Path) -> None:
    folder, _ = play("random", episodes=2)
    copy, other = shutil.copytree(folder.path, tmp_path / "copy"), tmp_path / "other"
    for again in (folder.path, copy):
        (pair,) = compare([str(folder.path), str(again)]).pairs
        assert episodes_text(pair) == "same records"
    play("hold", "other", episodes=2)
    (pair,) = compare([str(folder.path), str(other)]).pairs
    assert episodes_text(pair) == "same episodes"


def test_served_policies_are_called_as_they_call_themselves(
    play: Play, tmp_path: Path, serve: Serve
) -> None:
    class First(HoldPolicy):
        metadata = PolicyMetadata(name="pi05 step 20k", cameras=(), version="1")

    class Second(HoldPolicy):
        metadata = PolicyMetadata(name="pi05 step 40k", cameras=(), version="2")

        def act(self, observation: dict[str, np.ndarray]) -> np.ndarray:
            return super().act(observation) + 0.001

    sources: list[str] = []
    for policy in (First, Second):
        server = server_at(serve(PolicyPool(policy(), policy), batching=ONE_BY_ONE))
        choice = PolicyChoice(name="openpi", server=server)
        folder, _ = play(choice, policy.__name__, episodes=1)
        sources.append(str(folder.path))
        page, own = folder.page.read_text(), policy.metadata.name
        assert f"<h1>{own}</h1>" in page
        assert f"openpi ({own})" in page
    comparison = compare(sources)
    assert [one.name for one in comparison.entrants] == ["pi05 step 20k", "pi05 step 40k"]
    page = write_comparison(comparison, tmp_path / "compared")
    for name in ("index.html", "table.md", "table.tex", "table.csv", "comparison.json"):
        text = page.with_name(name).read_text()
        assert "pi05 step 20k" in text
        assert "pi05 step 40k" in text
    given = compare([f"mine={sources[0]}", sources[1]])
    assert [one.name for one in given.entrants] == ["mine", "pi05 step 40k"]
