from collections.abc import Iterator

import pytest

from tests.policy.serving.serving import Serve


@pytest.fixture
def serve() -> Iterator[Serve]:
    serving = Serve()
    yield serving
    serving.close()
