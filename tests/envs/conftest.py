from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

import pytest

from tests.envs.tools import TASK, make_small


@pytest.fixture
def make() -> Iterator[Callable[..., Any]]:
    """Makes environments, without cameras unless it is told which, and closes them."""
    with ExitStack() as closing:

        def made(task: Any = TASK, **options: Any) -> Any:
            env = make_small(task, **options)
            closing.callback(env.close)
            return env

        yield made
