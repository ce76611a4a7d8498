"""Same seed, same episode: in any process, after any other episodes, seen by cameras or not."""

from __future__ import annotations

import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import pytest

from tests.envs.tools import hash_of_episode

SEED = 4
BLIND: dict[str, Any] = {"cameras": False}


@pytest.fixture(scope="module")
def expected() -> str:
    return hash_of_episode(BLIND, SEED)


def test_again(expected: str) -> None:
    assert hash_of_episode(BLIND, SEED) == expected
    assert hash_of_episode(BLIND, SEED + 1) != expected


def test_after_other_episodes(expected: str) -> None:
    assert hash_of_episode(BLIND, SEED, before=3) == expected


def test_with_cameras(expected: str) -> None:
    options = {"cameras": ("head",), "image_size": (24, 32)}
    assert hash_of_episode(options, SEED, before=1) == expected


def test_in_another_process(expected: str) -> None:
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context) as pool:
        assert pool.submit(hash_of_episode, BLIND, SEED, before=1).result() == expected
