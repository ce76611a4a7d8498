"""Where cameras see things: convolutional networks that point.

Each camera is taught in which pixels the points of each object are: its lens and its place are
known, so that the simulation tells that of every image. Of these pixels `rays.py` makes poses.
What a layout chose, such as the walls of a maze, is read in patches that are laid on the objects
once these are found.

What the robot says of itself enters by where its wrists hold their cameras, and in no other way: in
demonstrations a hand is where its object is.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from rays import Points, Rays
from torch import nn
from torch.nn import functional

from duobench.world.robot.camera_geometry import geometries, matrix_of
from duobench.world.robot.cameras import CAMERAS, HEAD, POLICY_CAMERAS
from duobench.world.robot.frames import Robot

SIZES = {
    camera: (224, 224) if camera == HEAD else (112, 112) for camera in POLICY_CAMERAS
}
"""Height and width of images, as pixels are counted: those on the wrists are nearer to what they
see."""
STRIDE, CHANNELS, WIDTH = 4, 32, 256
"""Pixels from a cell to the next one, numbers that are told of each, and of hidden layers."""
PATCH, SIDE = 40, 0.2
"""Pixels and metres along a side of a patch on an object."""
FINE = 2
"""How many pixels along a side of an image, as it is rendered, are one of those `SIZES`."""
WINDOW = 64
"""Pixels along a side of the window around an object in which it looks closer (`windows.py`)."""
NEAR = 0.05
"""Metres in front of a camera, where it begins to see."""
MARGIN = 2.0
"""Pixels from the border of an image to an object that is seen in it."""


def rendered_sizes() -> dict[str, tuple[int, int]]:
    """Height and width of images as they are rendered."""
    return {
        name: (FINE * height, FINE * width) for name, (height, width) in SIZES.items()
    }


def whole(images: torch.Tensor) -> torch.Tensor:
    """Images (B, 3, height, width) of `SIZES`, of rendered ones."""
    return functional.avg_pool2d(images.float(), FINE).round().byte()


def lenses() -> torch.Tensor:
    """Matrices of the lenses of all cameras (cameras, 3, 3)."""
    found = [matrix_of(CAMERAS[name], size) for name, size in SIZES.items()]
    return torch.from_numpy(np.array(found)).float()


def places_of_cameras(state: NDArray[Any], robot: Robot) -> NDArray[np.float32]:
    """Poses (T, cameras, 4, 4) of the cameras in the table frame, of joints and openings (T, 16).

    Their axes are OpenCV's.
    """
    joints = state.reshape(len(state), 2, -1)[..., :-1]
    found = [
        geometries(dict(SIZES), robot.tcp_poses(both), robot.gripper) for both in joints
    ]
    poses = [[one[camera].table_from_camera for camera in SIZES] for one in found]
    return np.array(poses, dtype=np.float32)


@dataclass(frozen=True)
class Seen:
    """What one camera sees of points in images."""

    maps: torch.Tensor
    """Logarithms of shares of cells (B, points, cells)."""
    pixels: torch.Tensor
    """Those that follow (B, points, 2)."""
    spread: torch.Tensor
    """How far shares are spread around them (B, points), in square pixels."""
    what: torch.Tensor
    """What is there (B, points, CHANNELS + 3)."""


class Eye(nn.Module):
    """Where one camera sees each point."""

    def __init__(self, size: tuple[int, int], points: int) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Conv2d(3, CHANNELS, 2 * STRIDE, STRIDE, padding=STRIDE // 2),
            nn.ReLU(),
            nn.Conv2d(CHANNELS, CHANNELS, 3, padding=1),
            nn.ReLU(),
            nn.Conv2d(CHANNELS, CHANNELS, 3, padding=2, dilation=2),
            nn.ReLU(),
            nn.Conv2d(CHANNELS, CHANNELS, 3, padding=4, dilation=4),
            nn.ReLU(),
        )
        self.maps = nn.Conv2d(CHANNELS, points, 3, padding=1)
        down, across = ((torch.arange(n // STRIDE) + 0.5) * STRIDE - 0.5 for n in size)
        grid = torch.stack(torch.meshgrid(across, down, indexing="xy"), -1).view(-1, 2)
        self.register_buffer("grid", grid, persistent=False)
        self._size = size

    def forward(self, images: torch.Tensor) -> Seen:
        """What is seen in images (B, 3, height, width) of 0 to 255."""
        how = {"dtype": torch.bfloat16, "enabled": self.training}  # twice as fast
        with torch.autocast(images.device.type, **how):
            cells = self.layers(images.float() / 127.5 - 1)
            maps = self.maps(cells)
        maps = maps.float().flatten(2).log_softmax(-1)
        shares = maps.detach().exp()  # taught by pixels alone
        pixels = shares @ self.grid
        spread = shares @ self.grid.square().sum(-1) - pixels.square().sum(-1)
        spread = (
            spread - STRIDE**2 / 3
        ).relu()  # that much a pixel between cells is spread
        sharp = shares.amax(-1, keepdim=True)
        around = pixels / max(self._size) - 0.5
        what = torch.cat([shares @ cells.float().flatten(2).mT, sharp, around], -1)
        return Seen(maps, pixels, spread, what)

    def surprise(
        self, maps: torch.Tensor, pixels: torch.Tensor, within: torch.Tensor
    ) -> torch.Tensor:
        """Cross entropy (B, points) of maps where points are in pixels (B, points, 2).

        A pixel is shared by the four cells around it, so that the mean of the map is the pixel;
        what is not within the image is anywhere.
        """
        columns = self._size[1] // STRIDE
        most = torch.tensor([n // STRIDE - 1.001 for n in self._size[::-1]])
        cell = ((pixels + 0.5) / STRIDE - 0.5).clamp(min=0).minimum(most.to(pixels))
        low = cell.floor()
        right, below = (cell - low).unbind(-1)
        first = (low[..., 1] * columns + low[..., 0]).long()
        near = torch.stack([first, first + 1, first + columns, first + columns + 1], -1)
        shares = [(1 - right) * (1 - below), right * (1 - below), (1 - right) * below]
        shares = torch.stack([*shares, right * below], -1)
        here = (maps.gather(-1, near) * shares).sum(-1)
        return -torch.where(within, here, maps.mean(-1))


class Sight(nn.Module):
    """From images, and where the cameras are, to what `images.shown` makes of the object state.

    Args:
        names: What each number of the object state is.
        scale: Mean and size of what is seen, `o_mean` and `o_scale`.
        chosen: Which numbers a layout chose: they are read in patches, with the quarters of a turn
            that they depend on.
    """

    def __init__(
        self,
        names: tuple[str, ...],
        scale: Mapping[str, NDArray[Any]],
        chosen: Sequence[int],
    ) -> None:
        super().__init__()
        self.points = Points.of(names)
        origins = np.flatnonzero((self.points.offsets == 0).all(1))
        self.register_buffer("origins", torch.from_numpy(origins), persistent=False)
        quarters = range(len(names), len(scale["o_mean"]))
        self.read_there = [*chosen, *quarters] if chosen else []
        patches = sum(name.endswith("_x_axis_x") for name in names)
        count = len(self.points.things)
        self.eyes = nn.ModuleList(Eye(size, count) for size in SIZES.values())
        each = np.bincount(self.points.things)
        self.near = nn.ModuleList(Eye((WINDOW, WINDOW), n) for n in each.tolist())
        self.things = torch.from_numpy(self.points.things)
        self.find = nn.Sequential(
            nn.Linear(len(SIZES) * len(origins) * (CHANNELS + 3), WIDTH),
            nn.GELU(),
            nn.Linear(WIDTH, WIDTH),
            nn.GELU(),
            nn.Linear(WIDTH, len(scale["o_mean"])),
        )
        self.reads = nn.Sequential(
            nn.Conv2d(3 * len(SIZES) * max(patches, 1), CHANNELS, 3, padding=1),
            nn.ReLU(),
            nn.Conv2d(CHANNELS, CHANNELS, 3, 2, padding=1),
            nn.ReLU(),
            nn.Conv2d(CHANNELS, CHANNELS, 3, 2, padding=1),
            nn.ReLU(),
            nn.Flatten(),
            nn.Linear(CHANNELS * (PATCH // 4) ** 2, WIDTH),
            nn.GELU(),
            nn.Linear(WIDTH, max(len(self.read_there), 1)),
        )
        for key in ("o_mean", "o_scale"):
            self.register_buffer(key, torch.from_numpy(scale[key]).float())
        self.register_buffer("lenses", lenses(), persistent=False)
        line = (torch.arange(PATCH) + 0.5) / PATCH * SIDE - SIDE / 2
        patch = torch.stack(torch.meshgrid(line, line, indexing="xy"), -1).view(-1, 2)
        patch = functional.pad(patch, (0, 1))
        self.register_buffer("patch", patch, persistent=False)

    def forward(
        self, images: Sequence[torch.Tensor]
    ) -> tuple[torch.Tensor, list[Seen]]:
        """What is seen (B, k), normal, but for places, and where each camera sees points.

        Args:
            images: Of each camera (B, 3, height, width).
        """
        seen = [eye(image) for eye, image in zip(self.eyes, images, strict=True)]
        told = [one.what[:, self.origins].flatten(1) for one in seen]
        return self.find(torch.cat(told, 1)), seen

    def closer(self, images: torch.Tensor) -> list[Seen]:
        """What is seen of each object in windows (B, cameras, K, 3, WINDOW, WINDOW)."""
        return [eye(images[:, :, k].flatten(0, 1)) for k, eye in enumerate(self.near)]

    def rays(
        self,
        pixels: Sequence[torch.Tensor],
        spread: Sequence[torch.Tensor],
        cameras: NDArray[np.float32],
    ) -> Rays:
        """Rays to what cameras see.

        Args:
            pixels: Of each look of a camera (B, points, 2); cameras take turns.
            spread: How far these are spread (B, points), in square pixels.
            cameras: Where the camera of each look is (B, looks, 4, 4).
        """
        ways, sharpness = [], []
        for nth, (there, wide) in enumerate(zip(pixels, spread, strict=True)):
            lens = self.lenses[nth % len(SIZES)].double().numpy()
            turned = cameras[:, nth, :3, :3] @ np.linalg.inv(lens)
            flat = functional.pad(there, (0, 1), value=1.0).double().numpy()
            way = flat @ turned.swapaxes(1, 2)
            ways.append(way / np.linalg.norm(way, axis=-1, keepdims=True))
            focal = math.sqrt(lens[0, 0] * lens[1, 1])
            sharpness.append(focal / np.sqrt(wide.double().numpy()))
        places = cameras[..., :3, 3].astype(np.float64)
        return Rays(places, np.stack(ways, 1), np.stack(sharpness, 1))

    def pixels(
        self, points: torch.Tensor, cameras: torch.Tensor
    ) -> list[tuple[torch.Tensor, torch.Tensor]]:
        """Pixels (B, K, 2) of points (B, K, 3) in the image of each camera, and which are in it."""
        found = []
        for nth, size in enumerate(SIZES.values()):
            turned, place = cameras[:, nth, :3, :3], cameras[:, nth, :3, 3]
            there = (points - place[:, None]) @ turned @ self.lenses[nth].T
            far = there[..., 2:]
            pixels = there[..., :2] / far.clamp(min=NEAR)
            most = torch.tensor(size[::-1]).to(pixels) - 1 - MARGIN
            within = ((pixels >= MARGIN) & (pixels <= most)).all(-1)
            found.append((pixels, within & (far[..., 0] > NEAR)))
        return found

    def read(
        self,
        images: Sequence[torch.Tensor],
        cameras: torch.Tensor,
        positions: torch.Tensor,
        rotations: torch.Tensor,
    ) -> torch.Tensor:
        """What is read on objects that were found (B, reads), normal.

        Args:
            images: Of each camera (B, 3, height, width).
            cameras: Where they are (B, cameras, 4, 4).
            positions: Of the objects that there are patches on (B, patches, 3).
            rotations: The same (B, patches, 3, 3).
        """
        points = (positions[:, :, None] + self.patch @ rotations.mT).flatten(1, 2)
        shape = (len(points), -1, PATCH, 2)
        seen = []
        for image, (pixels, _) in zip(
            images, self.pixels(points, cameras), strict=True
        ):
            at = (pixels + 0.5) / image.shape[-1] * 2 - 1
            patches = functional.grid_sample(
                image.float() / 127.5 - 1, at.view(shape), align_corners=False
            )
            patches = patches.unflatten(2, (-1, PATCH))
            seen.append(patches.transpose(1, 2).flatten(1, 2))
        how = {"dtype": torch.bfloat16, "enabled": self.training}
        with torch.autocast(points.device.type, **how):
            return self.reads(torch.cat(seen, 1)).float()
