import json
from dataclasses import replace
from typing import Any

import pytest

from duobench.errors import (
    DuoBenchError,
    EvaluationError,
    FileError,
    UnknownNameError,
)
from duobench.files import decode, encode
from duobench.results.limits import TimeLimits
from duobench.results.run import RUN_SCHEMA, Run
from duobench.shifts.shift import NO_SHIFT, Shift
from tests.results.samples import LIFT, SORT, sample_run


def test_description_survives_its_text() -> None:
    run = sample_run()
    assert decode(encode(run, RUN_SCHEMA), Run, RUN_SCHEMA) == run


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"schema": 2}', '{"schema": 3}', "null", "[" * 99_999]
)
def test_other_text_is_refused(text: str) -> None:
    with pytest.raises(FileError):
        decode(text.encode(), Run, RUN_SCHEMA)


@pytest.mark.parametrize(
    "changes",
    [
        {"episodes": 0},
        {"first_episode": -1},
        {"tasks": ()},
        {"tasks": (LIFT, SORT, LIFT)},
    ],
)
def test_impossible_run_is_refused(changes: dict[str, Any]) -> None:
    with pytest.raises(EvaluationError):
        sample_run(**changes)


def test_unknown_look_is_refused() -> None:
    with pytest.raises(UnknownNameError, match="'dark'"):
        sample_run(look="drak")


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("suite", "episodes"), None, "Expected `int`, got `null` - at `suite.episodes`"),
        (("limits", "act_timeout"), "1", "Expected `float`, got `str` - at `limits.act_timeout`"),
        (("candidates", 0, "config", "cameras"), ["haed"], "Unknown camera 'haed'"),
        (
            ("candidates", 0, "metadata", "version"),
            1,
            r"Expected `str \| null`, got `int` - at `candidates\[0\].metadata.version`",
        ),
        (("versions",), [], "Expected `object`, got `array` - at `versions`"),
        (("colour",), "red", "Unknown fields: colour"),
    ],
)
def test_wrong_type_is_refused_with_the_name_of_the_field(
    path: tuple[str | int, ...], value: Any, message: str
) -> None:
    document = json.loads(encode(sample_run(), RUN_SCHEMA))
    part = document
    for name in path[:-1]:
        part = part[name]
    part[path[-1]] = value
    with pytest.raises(DuoBenchError, match=message):
        decode(json.dumps(document).encode(), Run, RUN_SCHEMA)


def test_episodes_count_from_the_first() -> None:
    run = sample_run(tasks=(LIFT,), episodes=3, first_episode=7)
    assert [episode.index for episode in run.episodes()] == [7, 8, 9]
    assert [episode.has_video for episode in run.episodes(videos=2)] == [True, True, False]


def test_differences_are_told_field_by_field() -> None:
    run = sample_run()
    assert run.differences(run) == []
    found = run.differences(sample_run(policy="other", tasks=(LIFT,)))
    assert "policy mine instead of other" in found
    assert "tasks lift sort turn instead of lift" in found
    assert len(found) == 2


def test_hash_tells_runs_apart_and_not_how_much_of_one_is_played() -> None:
    run = sample_run()
    shifts = (NO_SHIFT, Shift(axis="look", level=2))
    assert {sample_run(episodes=9).hash, sample_run(shifts=shifts).hash} == {run.hash}
    assert decode(encode(run, RUN_SCHEMA), Run, RUN_SCHEMA).hash == run.hash
    others = [
        sample_run(policy="other"),
        sample_run(first_episode=1),
        sample_run(tasks=(LIFT,)),
        sample_run(limits=TimeLimits(act_timeout=1)),
        sample_run(versions={"mujoco": "0"}),
        sample_run(trained_on="real"),
    ]
    assert len({each.hash for each in (run, *others)}) == 1 + len(others)


def test_policies_of_a_run_play_the_same_under_names_of_their_own() -> None:
    run = sample_run()
    other = replace(run.candidate, policy="ours")
    both = replace(run, candidates=(run.candidate, other))
    assert list(both.conditions) == ["mine.sim.none.default", "ours.sim.none.default"]
    assert (both.size, both.counts()["lift"]) == (2 * run.size, 8)
    assert both.of("ours") is other
    with pytest.raises(EvaluationError, match="the same name"):
        replace(run, candidates=(run.candidate, run.candidate))


def test_run_may_have_more_episodes_than_before_but_not_fewer() -> None:
    short, long = sample_run(episodes=2), sample_run(episodes=5)
    assert long.differences(short) == []
    assert short.differences(long) == ["episodes 2 instead of 5 or more"]


@pytest.mark.parametrize("name", ["..", "", ".", "a/b", ".hidden", "a b", "-x"])
def test_task_whose_id_is_no_name_of_a_folder_is_refused(name: str) -> None:
    with pytest.raises(EvaluationError, match="An id names a folder"):
        replace(LIFT, id=name)
