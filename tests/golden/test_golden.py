"""The golden file itself; `tests.tasks.experts.test_episodes` asks that experts still play it."""

import copy
import json
from pathlib import Path
from typing import Any

import pytest

from duobench.core.randomness import SUITE_VERSION
from duobench.tasks import catalog
from tests.golden import episodes, models

TASK = "hinge_chest"


@pytest.fixture(scope="module")
def golden() -> dict[str, Any]:
    return episodes.read()


@pytest.fixture(scope="module")
def content() -> dict[str, Any]:
    return episodes.record([TASK])


def test_the_file_is_of_this_suite_version_and_names_every_task(golden: dict[str, Any]) -> None:
    assert golden["suite_version"] == SUITE_VERSION
    assert tuple(golden["tasks"]) == catalog.names()


@pytest.mark.parametrize("name", catalog.names())
def test_the_physics_is_made_of_what_it_was(golden: dict[str, Any], name: str) -> None:
    described = models.describe(catalog.get(name).props)
    expected = golden["tasks"][name][episodes.MODEL]
    for part, quantities in described.items():
        if part != episodes.COMPILED or episodes.EXACT:
            assert quantities == expected[part], part
    assert described.keys() == expected.keys()


STAGES = [[58, 1], [60, 2], [90, 4]]


@pytest.mark.parametrize(
    ("other", "same"),
    [
        ([[58, 1], [60, 2], [90, 4]], True),
        ([[61, 1], [63, 2], [87, 4]], True),
        ([[60, 2], [90, 4]], True),  # both in one step
        ([[58, 1], [60, 2], [88, 3], [90, 4]], True),
        ([[62, 1], [62, 2], [90, 4]], False),
        ([[58, 1], [60, 2], [86, 4]], False),
        ([[58, 1], [60, 2], [86, 3], [90, 4]], False),
        ([[58, 1], [60, 2], [90, 3]], False),
        ([[58, 1], [60, 2], [90, 4], [91, 5]], False),
        ([], False),
    ],
)
def test_a_stage_may_be_reached_a_few_steps_sooner_or_later(
    other: list[list[int]], same: bool
) -> None:
    for one, two in ((STAGES, other), (other, STAGES)):
        found = list(episodes.episode_differences("e", {"stages": one}, {"stages": two}))
        assert (found == []) is same


def changed(content: dict[str, Any], *keys: Any, to: Any) -> dict[str, Any]:
    """A copy in which the task's value under some keys is another."""
    other = copy.deepcopy(content)
    *way, last = keys
    place = other["tasks"][TASK]
    for key in way:
        place = place[key]
    place[last] = to
    return other


def test_the_file_is_written_where_there_is_none_or_nothing_differs(
    tmp_path: Path, content: dict[str, Any]
) -> None:
    path = tmp_path / "episodes.json"
    for _ in range(2):
        episodes.write(content, path)
        assert episodes.read(path) == json.loads(json.dumps(content))
    # What another machine rounds differently is no difference.
    state = content["tasks"][TASK]["0"]["states"]["10"]
    near = [number + 0.4 * episodes.TOLERANCE for number in state]
    episodes.write(changed(content, "0", "states", "10", to=near), path)


@pytest.mark.parametrize(
    ("keys", "to", "told"),
    [
        (("model", "chest/lid", "damping"), 0.11, "chest/lid, damping: 0.11 became 0.03"),
        (("model", "chest/lid"), {}, "hinge_chest: chest/lid is new"),
        (("model", "other"), {"mass": 1.0}, "hinge_chest: other is gone"),
        (("model",), {}, "hinge_chest: options is new"),
        (("0", "stages"), [[58, 1]], r"seed 0: the stages by control step: \[\[58, 1\]\] became"),
        (("1", "states", "20"), [0.0] * 22, "seed 1, step 20: a joint or a position is"),
        (("1", "states", "20"), [0.0], "seed 1, step 20: 1 numbers became 22"),
        (("2",), {"stages": [[1, 1]]}, "seed 2: the stages"),
        *[(("1", "hashes"), [], "seed 1: the hashes of the first and last state are others")]
        * episodes.EXACT,
    ],
)
def test_a_file_of_the_same_suite_version_is_not_written_over(
    tmp_path: Path, content: dict[str, Any], keys: tuple[str, ...], to: Any, told: str
) -> None:
    path = tmp_path / "episodes.json"
    episodes.write(changed(content, *keys, to=to), path)
    before = path.read_bytes()
    with pytest.raises(episodes.NotRenewedError, match=told) as refusal:
        episodes.write(content, path)
    assert "raise SUITE_VERSION in duobench.core.randomness first" in str(refusal.value)
    assert path.read_bytes() == before


def test_a_task_that_is_gone_or_new_is_a_difference(content: dict[str, Any]) -> None:
    none = {**content, "tasks": {}}
    for old, new in ((none, content), (content, none)):
        assert any("stages by control step" in line for line in episodes.differences(old, new))
    assert episodes.differences(content, content) == []


def test_a_file_of_another_suite_version_is_renewed(
    tmp_path: Path, content: dict[str, Any]
) -> None:
    path = tmp_path / "episodes.json"
    episodes.write({**changed(content, "0", "stages", to=[]), "suite_version": "before"}, path)
    episodes.write(content, path)
    assert episodes.read(path) == json.loads(json.dumps(content))
