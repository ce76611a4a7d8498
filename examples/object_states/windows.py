"""Windows: square parts of images around objects, all as large on the objects.

In them is looked closer at what was found in whole images.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from sight import NEAR, SIZES, WINDOW, lenses
from torch.nn import functional

SPAN = 0.18
"""Metres along a side of a window, where its object is."""


@dataclass(frozen=True)
class Windows:
    """Where windows are in images."""

    centres: torch.Tensor
    """Pixels in their middle (B, cameras, K, 2)."""
    scale: torch.Tensor
    """How many pixels of an image one of theirs is (B, cameras, K)."""

    @staticmethod
    def around(places: torch.Tensor, cameras: torch.Tensor) -> Windows:
        """Those around objects at places (B, K, 3), for cameras (B, cameras, 4, 4)."""
        centres, scales = [], []
        for nth, lens in enumerate(lenses()):
            turned, place = cameras[:, nth, :3, :3], cameras[:, nth, :3, 3]
            there = (places - place[:, None]) @ turned @ lens.T
            far = there[..., 2].clamp(min=NEAR)
            centres.append(there[..., :2] / far[..., None])
            scales.append(lens[0, 0] * SPAN / WINDOW / far)
        return Windows(torch.stack(centres, 1), torch.stack(scales, 1))

    def cut(self, images: Sequence[torch.Tensor]) -> torch.Tensor:
        """What is in them (B, cameras, K, 3, WINDOW, WINDOW); black is beyond an image.

        Args:
            images: Of each camera (B, 3, height, width), of any size.
        """
        line = torch.arange(WINDOW) - (WINDOW - 1) / 2
        grid = torch.stack(torch.meshgrid(line, line, indexing="xy"), -1)
        found = []
        for nth, (image, size) in enumerate(zip(images, SIZES.values(), strict=True)):
            scale = self.scale[:, nth, :, None, None, None]
            at = self.centres[:, nth, :, None, None] + grid * scale
            at = (at + 0.5) / torch.tensor(size[::-1]) * 2 - 1
            seen = functional.grid_sample(
                image.float(), at.flatten(1, 2), align_corners=False
            )
            found.append(seen.unflatten(2, (-1, WINDOW)).transpose(1, 2))
        return torch.stack(found, 1)

    def inside(self, pixels: torch.Tensor, things: torch.Tensor) -> torch.Tensor:
        """Pixels (B, cameras, J, 2) of images in the windows of objects (J,)."""
        away = pixels - self.centres[:, :, things]
        return away / self.scale[:, :, things, None] + (WINDOW - 1) / 2

    def outside(self, pixels: torch.Tensor, things: torch.Tensor) -> torch.Tensor:
        """Pixels (B, cameras, J, 2) in the windows of objects (J,) as those of images."""
        away = (pixels - (WINDOW - 1) / 2) * self.scale[:, :, things, None]
        return away + self.centres[:, :, things]
