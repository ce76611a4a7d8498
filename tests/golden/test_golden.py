from typing import Any

import numpy as np
import pytest

from duobench.randomness import SUITE_VERSION
from duobench.tasks import catalog
from tests.golden import episodes


@pytest.fixture(scope="module")
def golden() -> dict[str, Any]:
    return episodes.read()


def test_the_file_is_of_this_suite_version_and_names_every_task(golden: dict[str, Any]) -> None:
    assert golden["suite_version"] == SUITE_VERSION
    assert tuple(golden["tasks"]) == catalog.names()


@pytest.mark.parametrize("name", catalog.names())
def test_expert_episodes_are_the_golden_ones(golden: dict[str, Any], name: str) -> None:
    for seed, episode in episodes.play(name).items():
        expected = golden["tasks"][name][seed]
        for step, state in episode["states"].items():
            apart = np.abs(np.subtract(state, expected["states"][step])).max()
            assert apart <= episodes.TOLERANCE, f"seed {seed}, step {step}"
        assert episode["stages"] == expected["stages"], f"seed {seed}"
        assert episode["stages"][-1][1] == catalog.get(name).max_stage
