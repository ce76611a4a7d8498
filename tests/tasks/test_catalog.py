"""How a name becomes a task, and what a task refuses to be."""

from __future__ import annotations

from dataclasses import replace

import pytest

from duobench.envs.registration import NAMESPACE, env_id
from duobench.errors import DuoBenchError, LayoutError, UnknownNameError
from duobench.tasks import catalog


def test_a_task_is_found_by_id_and_by_path() -> None:
    assert catalog.get("bin_sort") is catalog.get("duobench.tasks.bin_sort:TASK")


@pytest.mark.parametrize("name", catalog.names())
def test_the_id_of_an_environment_names_its_task_too(name: str) -> None:
    for spelling in (name, env_id(name), f"{NAMESPACE}:{env_id(name)}"):
        assert catalog.plain(spelling) == name
    assert catalog.plain("mine:TASK") == "mine:TASK"


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("duobench/bin-sort-v1", "task 'bin-sort'.*Did you mean 'bin_sort'"),
        ("duobench/bin_sort-v2", "task 'duobench/bin_sort-v2'.*Known: .*bin_sort"),
        ("bin-sort", "task 'bin-sort'.*Did you mean 'bin_sort'"),
        ("no_such_module:TASK", "no module named 'no_such_module'.*PYTHONPATH"),
        ("no_such.module:TASK", "no module named 'no_such'"),
        (":TASK", "is no `module:attribute`"),
        ("duobench.tasks.bin_sort:TSAK", "'TSAK'.*Did you mean 'TASK'"),
        ("duobench.tasks.bin_sort:COLOURS", "Known: TASK"),
        ("json:TASK", r"Known: \(none\)"),
    ],
)
def test_what_is_no_task_is_an_error(name: str, words: str) -> None:
    with pytest.raises(DuoBenchError, match=words):
        catalog.get(name)


@pytest.mark.parametrize("field", ["title", "instruction", "stages"])
def test_text_that_cannot_be_written_down_is_refused_as_given(field: str) -> None:
    task = catalog.get("bin_sort")
    stage = replace(task.stages[0], name="w\udcff")
    with pytest.raises(DuoBenchError, match=r"texts of task 'bin_sort' .*, got 'w\\udcff'"):
        replace(task, **{field: (stage,) if field == "stages" else "w\udcff"})


def test_a_placement_of_no_prop_is_refused() -> None:
    task = catalog.get("bin_sort")
    placements = {"white_cub": task.placements["white_cube"]}
    with pytest.raises(UnknownNameError, match=r"'white_cub'.*'white_cube'"):
        replace(task, placements=placements)


def test_a_task_without_stages_is_refused() -> None:
    with pytest.raises(DuoBenchError, match="at least one stage"):
        replace(catalog.get("bin_sort"), stages=())


def test_a_task_that_accepts_no_draw_says_so() -> None:
    task = replace(catalog.get("transfer_cube"), accept=lambda _layout: False)
    with pytest.raises(LayoutError, match=r"'transfer_cube' accepts none of \d+ samples"):
        next(task.layouts(0))
