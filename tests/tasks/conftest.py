"""What tests of single tasks share."""

import pytest

from tests.task_harness import TaskHarness


@pytest.fixture(scope="module")
def bench(request: pytest.FixtureRequest) -> TaskHarness:
    """The `TASK` that a module is about."""
    return TaskHarness(request.module.TASK)
