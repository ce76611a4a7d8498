"""What tests of single tasks share."""

import pytest

from duobench.tasks import catalog
from tests.task_harness import TaskHarness


@pytest.fixture(scope="module")
def bench(request: pytest.FixtureRequest) -> TaskHarness:
    """The task that a module is named after."""
    return TaskHarness(catalog.get(request.module.__name__.rpartition("test_")[2]))


@pytest.fixture
def table(bench: TaskHarness, request: pytest.FixtureRequest) -> TaskHarness:
    """The task at the start of an episode with the layout of the module."""
    bench.start(layout=request.module.LAYOUT)
    return bench
