"""Statistics of features, exact: of vectors from all rows, of images from counts of values."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from duobench.backend import Image
from duobench.types import Array

QUANTILES = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}
"""The quantiles that LeRobot reads, by name."""
LEVELS = 256
"""Values that a channel of an image can have."""
CHANNELS = 3

Counts = NDArray[np.int64]
"""How often each value occurs in each channel (3, 256)."""
Statistics = dict[str, Array]
"""Statistics of one feature by name."""


def of_rows(rows: NDArray[Any]) -> Statistics:
    """Statistics (n,) of a feature's rows (T,) or (T, n), n being 1 for plain numbers."""
    values = rows.reshape(len(rows), -1).astype(np.float64)
    numbers = {
        "min": values.min(axis=0),
        "max": values.max(axis=0),
        "mean": values.mean(axis=0),
        "std": values.std(axis=0),
        "count": np.array([len(values)]),
    }
    quantiles = np.quantile(values, list(QUANTILES.values()), axis=0)
    return numbers | dict(zip(QUANTILES, quantiles, strict=True))


def no_counts() -> Counts:
    """Counts of no image."""
    return np.zeros((CHANNELS, LEVELS), dtype=np.int64)


def count_values(counts: Counts, image: Image) -> None:
    """Add an image (height, width, 3) to counts, in place."""
    for channel in range(CHANNELS):
        counts[channel] += np.bincount(image[..., channel].ravel(), minlength=LEVELS)


def of_counts(counts: Counts, frames: int) -> Statistics:
    """Statistics (3, 1, 1) of the counted images with channels in [0, 1], equal to NumPy's."""
    channels = [_of_channel(each) for each in counts]
    numbers = {
        name: np.array([each[name] for each in channels]).reshape(CHANNELS, 1, 1)
        for name in channels[0]
    }
    return numbers | {"count": np.array([frames])}


def _of_channel(counts: NDArray[np.int64]) -> dict[str, float]:
    """Statistics of a channel; quantiles lie between neighbours in the sorted pixels as NumPy's."""
    levels, counts = np.flatnonzero(counts) / (LEVELS - 1), counts[counts > 0]
    mean = np.average(levels, weights=counts)
    ends = counts.cumsum()
    places = np.column_stack([ends - counts, ends - 1])  # of a level's first and last pixel
    wanted = np.array(list(QUANTILES.values())) * (ends[-1] - 1)
    quantiles = np.interp(wanted, places.ravel(), levels.repeat(2))
    return {
        "min": levels[0],
        "max": levels[-1],
        "mean": mean,
        "std": np.sqrt(np.average((levels - mean) ** 2, weights=counts)),
        **dict(zip(QUANTILES, quantiles, strict=True)),
    }
