"""A small data set for all tests of this folder."""

from pathlib import Path

import pytest

from duobench.data import DataSet, Recording
from duobench.data.arrange import merge
from tests.data.tools import data_of

EPISODES = 3


@pytest.fixture(scope="session")
def original(tmp_path_factory: pytest.TempPathFactory) -> DataSet:
    """Whole episodes, to read only."""
    return data_of(tmp_path_factory.mktemp("data") / "demos", EPISODES, split="train")


@pytest.fixture
def data(original: DataSet, tmp_path: Path) -> DataSet:
    """A copy of its own, to spoil."""
    merge([original], tmp_path / "demos")
    return DataSet.open(tmp_path / "demos")


@pytest.fixture(scope="session")
def example(original: DataSet) -> Recording:
    return Recording.read(original.episodes()[0])
