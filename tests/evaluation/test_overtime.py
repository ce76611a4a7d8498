"""Episodes played on after their horizon, which tells slow from wrong and changes nothing."""

import json
from typing import Any

import pytest

from duobench.core.errors import EvaluationError
from duobench.evaluation.policies import PolicyChoice
from duobench.evaluation.replay.verify import Verdict, verify
from duobench.policy import Batching
from duobench.results.bundle import read_source
from duobench.results.folder import RunFolder
from duobench.results.report import read_parts
from duobench.results.run import Shard, TimeLimits
from duobench.results.suite import find_tasks
from duobench.tasks.shifts.shift import NO_SHIFT, Shift
from tests.evaluation import toy_batches, toy_tasks
from tests.evaluation.conftest import small_suite

NUDGE = find_tasks([toy_tasks.NUDGE_NAME])
NEW = ("late_success", "run", "sha256")
"""Fields of a record that an overtime may change."""


def records(folder: RunFolder) -> dict[str, dict[str, Any]]:
    """What the records of a run say, by their names."""
    paths = sorted(folder.path.glob("records/*/*/*.json"))
    return {str(path.relative_to(folder.path)): json.loads(path.read_text()) for path in paths}


def at_horizon(folder: RunFolder) -> dict[str, dict[str, Any]]:
    """What they say without what an overtime adds."""
    return {
        name: {field: value for field, value in record.items() if field not in NEW}
        for name, record in records(folder).items()
    }


def late(folder: RunFolder) -> list[int | None]:
    return [record["late_success"] for record in records(folder).values()]


def test_records_end_at_the_horizon_whether_or_not_episodes_are_played_on(play):
    plain, _ = play("Late", "plain", tasks=NUDGE, videos=4)
    folder, results = play("Late", tasks=NUDGE, videos=4, overtime=1.5)
    assert at_horizon(folder) == at_horizon(plain)
    assert late(plain) == [None] * 4
    first, second, third, never = late(folder)
    assert (first, never) == (None, None)  # one succeeds before its horizon, one not at all
    assert toy_tasks.HORIZON < second < third <= 36
    for path in plain.path.glob("videos/*/*/*"):
        assert (folder.path / path.relative_to(plain.path)).read_bytes() == path.read_bytes()
    score = results.overall
    assert (score.successes, score.late_successes, score.errors) == (1, 2, 0)
    assert (score.success_rate, score.late_rate) == (0.25, 0.75)
    assert len(verify(folder, import_tasks=True).of(Verdict.EXACT)) == 4


def test_overtime_is_as_long_as_asked_for(play):
    folder, _ = play("Late", "longer", tasks=NUDGE, overtime=1.5)
    *_, last, _ = late(folder)
    horizon = toy_tasks.HORIZON
    exact, _ = play("Late", "exact", tasks=NUDGE, overtime=last / horizon)
    assert late(exact) == late(folder)
    shorter, _ = play("Late", "shorter", tasks=NUDGE, overtime=(last - 1) / horizon)
    assert late(shorter) == [*late(folder)[:2], None, None]


@pytest.mark.parametrize("overtime", [0.99, -1.5, float("inf"), float("nan")])
def test_impossible_overtime_is_refused(overtime):
    with pytest.raises(EvaluationError, match=f"1 .none. or more, such as 1.5; got {overtime}"):
        small_suite(overtime=overtime)


def test_every_executor_plays_on(play):
    folder, _ = play("Late", tasks=NUDGE, overtime=1.5)
    apart, _ = play("Late", "apart", tasks=NUDGE, overtime=1.5, workers=2)
    assert records(apart) == records(folder)
    shard, shift = Shard(number=2, count=2), Shift(axis="latency", level=1)
    part, _ = play(
        "Late", "shifts", tasks=NUDGE, overtime=1.5, shifts=(NO_SHIFT, shift), shard=shard
    )
    usual, shifted = read_parts(part)
    whole = {record.key: record for record in read_source(folder.path)[1]}
    assert [whole[record.key] for record in usual.records] == list(usual.records)
    assert len(usual.records) == 2
    found = [record.late_success for record in shifted.records]
    assert None in found
    assert any(found)


@pytest.mark.parametrize("workers", [0, 1])
def test_policy_that_fails_after_the_horizon_has_the_result_of_its_horizon(play, workers):
    limits = TimeLimits(act_timeout=3.0)
    episodes = len(toy_tasks.LATE_FAULTS) if workers else 2
    options = {"tasks": NUDGE, "episodes": episodes, "limits": limits, "workers": workers}
    plain, _ = play("FailsLate", "plain", **options)
    folder, results = play("FailsLate", overtime=1.5, **options)
    assert (results.overall.errors, results.overall.episodes) == (0, episodes)
    assert late(folder) == [None] * episodes
    assert at_horizon(folder) == at_horizon(plain)


@pytest.mark.parametrize("workers", [1, 3])
def test_policy_of_all_that_dies_after_a_horizon_fails_no_episode(play, workers):
    choice = PolicyChoice.parse(f"{toy_batches.__name__}:DiesLate", batching=Batching(size=3))
    plain, _ = play(choice, "plain", workers=1, episodes=2)
    folder, results = play(choice, workers=workers, episodes=2, overtime=1.5)
    assert (folder.path.parent / "marks" / "late").exists()
    assert results.overall.errors == 0
    assert at_horizon(folder) == at_horizon(plain)


def test_policy_that_dies_when_it_is_too_late_gets_no_second_attempt(play):
    folder, results = play("TriesAgain", tasks=NUDGE, episodes=1, workers=1, overtime=1.5)
    assert (folder.path.parent / "marks" / "again").exists()
    score = results.overall
    assert (score.episodes, score.successes, score.errors) == (1, 0, 0)
    assert late(folder) == [None]
