"""An environment may be reset for days: memory stays where it is after the first episodes."""

import multiprocessing
import resource
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import pytest

import duobench

MEGABYTE = 2**20
MAX_GROWTH = 4 * MEGABYTE
"""In bytes; measured: none. As much as two kilobytes kept at every reset, or half an image."""
BLIND: dict[str, Any] = {"cameras": False}
SEEING: dict[str, Any] = {"cameras": ("head",), "image_size": 96}


def resident() -> int:
    """Memory in use by this process, in bytes."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()


def growth(task: str, options: dict[str, Any], warm_up: int, resets: int) -> int:
    """By how many bytes the last of these resets make the process larger."""
    env = duobench.make(task, **options)
    for seed in range(warm_up):
        env.reset(seed=seed)
    before = resident()
    for seed in range(warm_up, resets):
        env.reset(seed=seed)
    after = resident()
    env.close()
    return after - before


@pytest.mark.long
@pytest.mark.parametrize(
    ("options", "warm_up", "resets"), [(BLIND, 200, 2000), (SEEING, 100, 400)], ids=["", "images"]
)
def test_resets_leave_no_memory_behind(options: dict[str, Any], warm_up: int, resets: int) -> None:
    """In a process of its own, where nothing else takes memory or gives it back."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        grown = pool.submit(growth, "ball_maze", options, warm_up, resets).result()
    assert grown < MAX_GROWTH, f"{grown / MEGABYTE:.1f} MiB in {resets - warm_up} resets"
