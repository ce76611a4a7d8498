"""A small data set for all tests of this folder."""

from pathlib import Path

import pytest

from duobench.data import DataSet, Recording
from duobench.data.arrange import merge
from tests.data.real.number_duo import play_real, real_recorder
from tests.data.tools import data_of

EPISODES = 3
LENGTHS = (12, 9, 15)
"""Actions of the real episodes."""


@pytest.fixture(scope="session")
def original(tmp_path_factory: pytest.TempPathFactory) -> DataSet:
    """Whole episodes, to read only."""
    return data_of(tmp_path_factory.mktemp("data") / "demos", EPISODES, split="train")


@pytest.fixture(scope="session")
def real(tmp_path_factory: pytest.TempPathFactory) -> DataSet:
    """Episodes of a rig, with their videos, to read only."""
    folder = tmp_path_factory.mktemp("data") / "real"
    for length in LENGTHS:
        env, _ = real_recorder(folder, horizon=length)
        play_real(env, length)
        env.close()
    return DataSet.open(folder)


@pytest.fixture
def data(original: DataSet, tmp_path: Path) -> DataSet:
    """A copy of its own, to spoil."""
    merge([original], tmp_path / "demos")
    return DataSet.open(tmp_path / "demos")


@pytest.fixture(scope="session")
def example(original: DataSet) -> Recording:
    return Recording.read(original.episodes()[0])
