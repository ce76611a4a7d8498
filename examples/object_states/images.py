"""The network of this folder, told by images where things are.

`sight.py` finds the object state in the images of all cameras, and the network that was trained
on object states acts on it. `train_images.py` trains it; PyTorch plays it.

    CHECKPOINT=sees.npz duobench eval --policy images:Images --tasks carry_pot --out runs/images
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import network
import numpy as np
import torch
from demonstrations import Rows
from frames import frames, places_in
from numpy.typing import NDArray
from rays import Usual, meet
from sight import Sight, places_of_cameras, rendered_sizes, whole
from tracks import Tracks
from visible import axes_in, recognized, rotations_seen
from windows import Windows

from duobench.core.errors import PolicyError
from duobench.core.types import SIDES
from duobench.world.robot.cameras import POLICY_CAMERAS

LOOKS = 2
"""How often it looks closer at what it has found."""
SIGHT, USUAL = "sight.", "usual."
"""What names of its arrays begin with in the file of a network."""
Array = NDArray[np.float64]


def on_patches(
    places: Array, turns: Array, names: tuple[str, ...]
) -> list[torch.Tensor]:
    """The poses of objects with axes: patches are laid on them."""
    things = [k - len(SIDES) for k, _, _ in axes_in(names)]
    return [torch.from_numpy(part[:, things]).float() for part in (places, turns)]


class Images(network.Network):
    """Plays a trained network on what it sees."""

    sees = True

    def __init__(self, path: Path | None = None) -> None:
        """Read a file, or the one that the variable CHECKPOINT names."""
        super().__init__(path)
        if "chosen" not in self._net:
            raise PolicyError(
                "CHECKPOINT names a network that sees no images: python train_images.py DEMOS "
                "EXPORT NETWORK OUT trains one that does."
            )
        torch.set_num_threads(1)
        parts = {
            name.removeprefix(SIGHT): torch.from_numpy(value)
            for name, value in self._net.items()
            if name.startswith(SIGHT)
        }
        self._chosen = self._net["chosen"].tolist()
        try:
            scale = {key: parts[key].numpy() for key in ("o_mean", "o_scale")}
            usual = (self._net[f"{USUAL}{part}"] for part in ("mean", "precision"))
            self._usual = Usual(*usual)
            self._sight = Sight(self.names, scale, self._chosen).eval()
            self._sight.load_state_dict(parts)
        except (KeyError, RuntimeError) as error:
            raise PolicyError(
                "CHECKPOINT names a network that sees as in an earlier state of this example: "
                "train it again."
            ) from error
        self._read: list[Rows] = []
        self._places = places_in(self.names)
        turned = [k - len(SIDES) for k, _, _ in axes_in(self.names)]
        self._turned = np.isin(np.arange(len(self._places)), turned)
        self._tracks = Tracks(self._turned)
        self.metadata = replace(
            self.metadata,
            name="frames of things, from images",
            cameras=POLICY_CAMERAS,
            image_sizes=rendered_sizes(),
            object_state=False,
        )

    def reset(self, instruction: str, seed: int) -> None:
        """Begin an episode, of which nothing was seen."""
        super().reset(instruction, seed)
        self._read = []
        self._tracks = Tracks(self._turned)

    def act(self, observation: Mapping[str, Any]) -> Rows:
        """The next chunk (30, 16)."""
        images = (observation["pixels"][camera] for camera in POLICY_CAMERAS)
        images = [torch.tensor(one.transpose(2, 0, 1))[None] for one in images]
        state = observation["agent_pos"]
        objects = self.look(images, state[None])
        # what the layout chose never changes: all looks count
        self._read.append(objects[0, self._chosen])
        objects[0, self._chosen] = np.mean(self._read, axis=0).round()
        here = frames(state[None], objects, self.names, self._robot)
        places, turns = self._tracks.follow(here)
        self._put(objects, places[None], turns[None])
        return self.plan(state, objects[0])

    def look(self, images: Sequence[torch.Tensor], state: Rows) -> Rows:
        """Object states (B, n) as they are seen; what the layout chose is not yet whole.

        Args:
            images: Of each camera, as rendered (B, 3, height, width).
            state: Joints and openings (B, 16).
        """
        cameras = torch.from_numpy(places_of_cameras(state, self._robot))

        def closer(places: Array) -> tuple[Windows, torch.Tensor]:
            windows = Windows.around(torch.from_numpy(places).float(), cameras)
            return windows, windows.cut(images)

        return self.found([whole(image) for image in images], cameras, closer)

    def found(
        self,
        images: Sequence[torch.Tensor],
        cameras: torch.Tensor,
        closer: Callable[[Array], tuple[Windows, torch.Tensor]],
    ) -> Rows:
        """Object states (B, n) that are found in images of `SIZES`.

        Args:
            images: Of each camera (B, 3, height, width).
            cameras: Where these are (B, cameras, 4, 4).
            closer: Windows around places (B, K, 3), and what is in them.
        """
        sight = self._sight
        seen_from = cameras.numpy()
        with torch.no_grad():
            found, views = sight(images)
            seen = (found * sight.o_scale + sight.o_mean).numpy()
            far = [one.pixels for one in views], [one.spread + 1 for one in views]
            rays = sight.rays(*far, seen_from)
            turns = rotations_seen(seen, self.names)
            places, turns = meet(rays, sight.points, self._usual, turns)
            for _ in range(LOOKS):
                near = self._closer(*closer(places))
                both = [a + b for a, b in zip(far, near, strict=True)]
                rays = sight.rays(*both, np.concatenate([seen_from] * 2, 1))
                places, turns = meet(rays, sight.points, self._usual, turns)
            self._put(seen, places, turns)
            if self._chosen:
                patches = on_patches(places, turns, self.names)
                columns = sight.read_there
                read = sight.read(images, cameras, *patches)
                read = read * sight.o_scale[columns] + sight.o_mean[columns]
                seen[:, columns] = read.numpy()
        return recognized(seen, self.names)

    def _put(self, objects: Rows, places: Array, turns: Array) -> None:
        """Write places (T, K, 3) and axes of rotations (T, K, 3, 3) into T rows of objects."""
        for place, part in zip(places.swapaxes(0, 1), self._places, strict=True):
            objects[:, part] = place
        for k, x, z in axes_in(self.names):
            turn = turns[:, k - len(SIDES)]
            objects[:, x], objects[:, z] = turn[..., 0], turn[..., 2]

    def _closer(
        self, windows: Windows, images: torch.Tensor
    ) -> tuple[list[torch.Tensor], list[torch.Tensor]]:
        """Pixels of points in windows for each camera, and how far they are spread, in images."""
        seen, things = self._sight.closer(images), self._sight.things
        shape = windows.scale.shape[:2]
        inside = torch.cat([one.pixels.unflatten(0, shape) for one in seen], 2)
        spread = torch.cat([one.spread.unflatten(0, shape) for one in seen], 2)
        spread = (spread + 1) * windows.scale[:, :, things].square()
        return list(windows.outside(inside, things).unbind(1)), list(spread.unbind(1))
