"""Noise that depends on the episode and the call alone, whatever a model asks torch for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch  # pyright: ignore[reportMissingImports]
from torch.overrides import TorchFunctionMode  # pyright: ignore[reportMissingImports]

from duobench.policy.batch import NOISE_STREAM

_NORMAL = (torch.randn, torch.randn_like, torch.normal)


class EpisodeNoise(TorchFunctionMode):
    """While active, normal noise for a batch is made row by row, each from its own generator.

    Models differ in whether they take noise as an argument and how often they sample: diffusion
    does in every denoising step, X-VLA takes none. All of them sample with torch and put the batch
    first, so noise is replaced there. It is made on the processor by NumPy, so that it is the same
    on every device.
    """

    def __init__(self, keys: Sequence[tuple[int, int]]) -> None:
        """Begin a call of the model.

        Args:
            keys: Seed of the episode and number of the call in it, for each row of the batch.
        """
        super().__init__()
        self._generators = [np.random.default_rng((NOISE_STREAM, *key)) for key in keys]
        # Whatever else a model samples follows from the whole batch, at least.
        seeds = np.random.SeedSequence([number for key in keys for number in key])
        torch.manual_seed(int(seeds.generate_state(1)[0]))

    def __torch_function__(
        self, func: Any, types: Any, args: tuple[Any, ...] = (), kwargs: Any = None
    ) -> Any:
        """Call a function of torch, and replace the noise that it returns."""
        kwargs = kwargs or {}
        result = func(*args, **kwargs)
        if func not in _NORMAL or not result.ndim or len(result) != len(self._generators):
            return result
        rows = [
            generator.standard_normal(result.shape[1:], dtype=np.float32)
            for generator in self._generators
        ]
        noise = torch.from_numpy(np.stack(rows)).to(result)
        if func is torch.normal:
            mean, std = _parameters(args, kwargs)
            return noise * std + mean
        return noise


def _parameters(args: tuple[Any, ...], kwargs: dict[str, Any]) -> tuple[Any, Any]:
    """Mean and standard deviation of a call of `torch.normal`."""
    named = dict(zip(("mean", "std"), args, strict=False)) | kwargs
    return named.get("mean", 0.0), named.get("std", 1.0)
