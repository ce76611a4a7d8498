import shlex
from typing import Any

import pytest

from duobench.errors import EvaluationError
from duobench.evaluation.run import Run
from tests.evaluation.samples import LIFT, SORT, sample_run


def test_description_survives_its_text() -> None:
    run = sample_run()
    assert Run.from_json(run.to_json()) == run


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"schema": 1}', '{"schema": 2}', "null"])
def test_other_text_is_refused(text: str) -> None:
    with pytest.raises(EvaluationError):
        Run.from_json(text)


@pytest.mark.parametrize(
    "changes",
    [
        {"episodes": 0},
        {"first_episode": -1},
        {"videos": -1},
        {"tasks": ()},
        {"tasks": (LIFT, SORT, LIFT)},
    ],
)
def test_impossible_run_is_refused(changes: dict[str, Any]) -> None:
    with pytest.raises(EvaluationError):
        sample_run(**changes)


def test_episodes_count_from_the_first() -> None:
    run = sample_run(episodes=3, first_episode=7, videos=2)
    assert list(run.episode_indices) == [7, 8, 9]
    assert [run.is_filmed(episode) for episode in run.episode_indices] == [True, True, False]


def test_command_names_everything_that_decides_the_results() -> None:
    words = shlex.split(sample_run(policy="my pkg:make", episodes=3, first_episode=7).command)
    assert words[:4] == ["duobench", "eval", "--policy", "my pkg:make"]
    rest = "--tasks lift pkg.tasks:SORT turn --episodes 3 --first-episode 7 --videos 1 --out DIR"
    assert words[4:] == rest.split()


def test_differences_are_told_field_by_field() -> None:
    found = sample_run().differences(sample_run(policy="other", episodes=9, tasks=(LIFT,)))
    assert len(found) == 3
    assert "policy: mine instead of other" in found
    assert "episodes: 4 instead of 9" in found
    assert found[1].startswith("tasks: lift")
    assert sample_run().differences(sample_run()) == []
