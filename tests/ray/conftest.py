"""A Ray cluster of two nodes on this machine, started once a test session."""

from collections.abc import Iterator

import pytest

from dev.benchmarks.ray_cluster import LocalCluster, local_cluster, set_environment

set_environment()  # before a test module imports Ray


@pytest.fixture(scope="session")
def cluster() -> Iterator[LocalCluster]:
    with local_cluster(nodes=2, cpus=2) as there:
        yield there
