"""The pages of tasks in 3D: there is one for each, and none is old."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
from replays import FOLDER, page

from duobench.tasks import catalog

TASK = "bin_sort"


def episode(text: str) -> dict[str, Any]:
    found = re.search(r'class="episodes-data">(.*?)</script>', text)
    assert found
    (shown,) = json.loads(found[1])
    return shown


def written(name: str) -> str:
    return (FOLDER / f"{name}.html").read_text(encoding="utf-8")


def test_there_is_a_page_for_each_task_and_no_other() -> None:
    assert sorted(path.stem for path in Path(FOLDER).glob("*")) == sorted(catalog.names())


@pytest.mark.parametrize("name", catalog.names())
def test_the_expert_solves_it_there(name: str) -> None:
    shown, task = episode(written(name)), catalog.get(name)
    assert shown["stages"] == [stage.name for stage in task.stages], "run: make docs"
    assert [stage for _, stage in shown["stage_changes"]][-1] == task.max_stage
    assert shown["instruction"]


def test_a_page_shows_what_its_expert_does_now() -> None:
    assert episode(page(TASK)) == episode(written(TASK)), "run: make docs"
