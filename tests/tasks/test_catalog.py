"""How a name becomes a task; what is no task is in tests/promised_errors.py."""

from __future__ import annotations

import pytest

from duobench.envs.registration import NAMESPACE, env_id
from duobench.tasks import catalog


def test_a_task_is_found_by_id_and_by_path() -> None:
    assert catalog.get("bin_sort") is catalog.get("duobench.tasks.bin_sort:TASK")


@pytest.mark.parametrize("name", catalog.names())
def test_the_id_of_an_environment_names_its_task_too(name: str) -> None:
    for spelling in (name, env_id(name), f"{NAMESPACE}:{env_id(name)}"):
        assert catalog.plain(spelling) == name
    assert catalog.plain("mine:TASK") == "mine:TASK"
