import json
from dataclasses import replace
from typing import Any

import pytest

from duobench.core.errors import DuoBenchError, EvaluationError, FileError, UnknownNameError
from duobench.core.files import decode, encode
from duobench.results.run import RUN_SCHEMA, Run, TimeLimits
from duobench.tasks.shifts.shift import NO_SHIFT, Shift
from tests.results.samples import LIFT, SORT, sample_run

RUN = sample_run()


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"schema": 2}', '{"schema": 3}', "null", "[" * 99_999]
)
def test_other_text_is_refused(text: str) -> None:
    with pytest.raises(FileError):
        decode(text.encode(), Run, RUN_SCHEMA)


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"episodes": 0}, EvaluationError, "at least one episode"),
        ({"first_episode": -1}, EvaluationError, "counted from 0"),
        ({"tasks": ()}, EvaluationError, "at least one task"),
        ({"tasks": (LIFT, SORT, LIFT)}, EvaluationError, "more than once: lift"),
        ({"candidates": (RUN.candidate,) * 2}, EvaluationError, "the same name"),
        ({"look": "drak"}, UnknownNameError, "'dark'"),
    ],
)
def test_impossible_run_is_refused(
    changes: dict[str, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        sample_run(**changes)


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
    document = json.loads(encode(RUN, RUN_SCHEMA))
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


@pytest.mark.parametrize(
    ("now", "before", "found"),
    [
        ({}, {}, set()),
        (
            {},
            {"policy": "other", "tasks": (LIFT,)},
            {"policy mine instead of other", "tasks lift sort turn instead of lift"},
        ),
        # A run may have more episodes than before, but not fewer.
        ({"episodes": 5}, {"episodes": 2}, set()),
        ({"episodes": 2}, {"episodes": 5}, {"episodes 2 instead of 5 or more"}),
    ],
)
def test_differences_are_told_field_by_field(
    now: dict[str, Any], before: dict[str, Any], found: set[str]
) -> None:
    differences = sample_run(**now).differences(sample_run(**before))
    assert (set(differences), len(differences)) == (found, len(found))


def test_hash_tells_runs_apart_and_not_how_much_of_one_is_played() -> None:
    shifts = (NO_SHIFT, Shift(axis="look", level=2))
    assert {sample_run(episodes=9).hash, sample_run(shifts=shifts).hash} == {RUN.hash}
    again = decode(encode(RUN, RUN_SCHEMA), Run, RUN_SCHEMA)
    assert (again, again.hash) == (RUN, RUN.hash)
    others = [
        sample_run(policy="other"),
        sample_run(first_episode=1),
        sample_run(tasks=(LIFT,)),
        sample_run(limits=TimeLimits(act_timeout=1)),
        sample_run(versions={"mujoco": "0"}),
        sample_run(trained_on="real"),
    ]
    assert len({each.hash for each in (RUN, *others)}) == 1 + len(others)


def test_policies_of_a_run_play_the_same_under_names_of_their_own() -> None:
    other = replace(RUN.candidate, policy="ours")
    both = replace(RUN, candidates=(RUN.candidate, other))
    assert list(both.conditions) == ["mine.sim.none.default", "ours.sim.none.default"]
    assert (both.size, both.counts()["lift"]) == (2 * RUN.size, 8)
    assert both.of("ours") is other


@pytest.mark.parametrize("name", ["..", "", ".", "a/b", ".hidden", "a b", "-x"])
def test_task_whose_id_is_no_name_of_a_folder_is_refused(name: str) -> None:
    with pytest.raises(EvaluationError, match="An id names a folder"):
        replace(LIFT, id=name)
