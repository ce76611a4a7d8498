"""The network of this folder, told by images where things are.

Three small convolutional networks, one a camera, look for places in the images (the centres of
mass of maps). From these follows the object state, which the network takes. Object states teach it
where things are, in training alone. Trained and played with PyTorch.

What the robot says of itself is not among what it sees by: in demonstrations a hand is where its
object is, so that a hand that went astray would be told that its object is there too.

    python network.py exports/carry_pot acts.npz --episodes 200 --seed 0
    python images.py demos exports/carry_pot acts.npz sees.npz --episodes 200 --seed 0
    CHECKPOINT=sees.npz duobench eval --policy images:Images --tasks carry_pot --out runs/images
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import network
import numpy as np
import torch
from demonstrations import Demonstrations, Rows
from frames import QUARTERS, bodies, frames
from numpy.typing import NDArray
from torch import nn

from duobench.core.errors import DataError, DuoBenchError, PolicyError
from duobench.core.types import SIDES
from duobench.data import DataSet, ImageSource
from duobench.world.robot.cameras import POLICY_CAMERAS

SIZE = 96
"""Height and width of images, in pixels."""
PLACES = 32
"""Places that are looked for in an image."""
STRIDES = (2, 4, 4)
"""Pixels from one of the cells in which they are looked for to the next, of each camera: more of
those on the wrists, which are near."""
CHANNELS = 32
EVERY = 3
"""Rows of a demonstration from one image that is learned from to the next."""
SIGHT = "sight."
"""What names of its arrays begin with in the file of a network."""
Pixels = NDArray[np.uint8]


@dataclass(frozen=True)
class Training:
    """How long it learns to see."""

    batch: int = 64
    rate: float = 3e-3
    passes: int = 30
    """Over the images of all demonstrations; the rate falls to zero over them."""
    warm_up: int = 200
    """Steps."""
    held_out: int = 10
    """Every n-th demonstration is not learned from."""
    early: int = 10
    """The n-th row of a demonstration is drawn with a weight of 1 / (n + `early`): what is seen in
    the first ones decides where hands go, and many later ones look alike."""
    device: str = "cpu"
    """What PyTorch trains on; it plays on the processor."""


class Eye(nn.Module):
    """Where one camera sees what it looks for."""

    def __init__(self, stride: int) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Conv2d(3, CHANNELS, 2 * stride + 1, stride, padding=stride),
            nn.ReLU(),
            nn.Conv2d(CHANNELS, CHANNELS, 3, padding=1),
            nn.ReLU(),
            nn.Conv2d(CHANNELS, PLACES, 3, padding=1),
        )
        line = torch.linspace(-1, 1, SIZE // stride)
        grid = torch.stack(torch.meshgrid(line, line, indexing="ij"), -1).view(-1, 2)
        self.register_buffer("grid", grid, persistent=False)

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        """Places (B, 2·PLACES), from -1 to 1, in images (B, 3, SIZE, SIZE) of 0 to 255."""
        how = {"dtype": torch.bfloat16, "enabled": self.training}  # twice as fast
        with torch.autocast(images.device.type, **how):
            maps = self.layers(images.float() / 127.5 - 1)
        return (maps.float().flatten(2).softmax(-1) @ self.grid).flatten(1)


class Sight(nn.Module):
    """From images to what `shown` makes of the object state."""

    def __init__(self, scale: Mapping[str, NDArray[Any]]) -> None:
        super().__init__()
        self.eyes = nn.ModuleList(Eye(stride) for stride in STRIDES)
        self.find = nn.Sequential(
            nn.Linear(len(STRIDES) * PLACES * 2, network.WIDTH),
            nn.GELU(),
            nn.Linear(network.WIDTH, network.WIDTH),
            nn.GELU(),
            nn.Linear(network.WIDTH, len(scale["o_mean"])),
        )
        for key in ("o_mean", "o_scale"):
            self.register_buffer(key, torch.from_numpy(scale[key]).float())

    def forward(self, images: Sequence[torch.Tensor]) -> torch.Tensor:
        """What is seen (B, k), normal, in one image of each camera (B, 3, SIZE, SIZE)."""
        return self.find(
            torch.cat([eye(i) for eye, i in zip(self.eyes, images, strict=True)], 1)
        )


def shown(objects: Rows, names: tuple[str, ...]) -> Rows:
    """What there is to be seen of object states (T, n): the same, but objects turned forwards.

    A cube looks the same after a quarter turn, so which of its axes is x cannot be seen. It is
    told apart, as quarters of a turn (four numbers an object), and guessed where nothing shows it.
    """
    here = frames(np.zeros((len(objects), 16), np.float32), objects, names)
    seen, quarters = objects.copy(), []
    for k, x, z in _axes(names):
        seen[:, x], seen[:, z] = (here.rotations[:, k, :, axis] for axis in (0, 2))
        quarters.append(np.eye(QUARTERS, dtype=np.float32)[here.quarters[:, k]])
    return np.hstack([seen, *quarters])


def recognized(seen: Rows, names: tuple[str, ...]) -> Rows:
    """Object states (T, n) of what was seen of them (T, k)."""
    objects, quarters = seen[:, : len(names)].copy(), seen[:, len(names) :]
    for nth, (_, x, z) in enumerate(_axes(names)):
        up = objects[:, z] / np.linalg.norm(objects[:, z], axis=1, keepdims=True)
        ahead = objects[:, x] - (objects[:, x] * up).sum(1, keepdims=True) * up
        ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
        aside = np.cross(up, ahead)
        turn = quarters[:, QUARTERS * nth : QUARTERS * (nth + 1)].argmax(1)
        objects[:, x] = np.choose(turn, (ahead.T, aside.T, -ahead.T, -aside.T)).T
        objects[:, z] = up
    return objects


def _axes(names: tuple[str, ...]) -> list[tuple[int, slice, slice]]:
    """Of objects with axes: which of the things they are, and where x and z axes stand."""
    found = []
    for k, body in enumerate(bodies(names), len(SIDES)):
        name = f"{body}_x_axis_x"
        if name in names:
            x, z = names.index(name), names.index(f"{body}_z_axis_x")
            found.append((k, slice(x, x + 3), slice(z, z + 3)))
    return found


def check(acts: Path, data: Demonstrations) -> None:
    """Refuse a network that acts on other object states than those of demonstrations.

    Raises:
        DataError: It does.
        PolicyError: There is none.
    """
    if network.Network(acts).names != data.names:
        raise DataError(
            f"{acts} acts on object states of another task: train one on this export."
        )


def train(
    acts: Path,
    data: Demonstrations,
    images: Sequence[Pixels],
    out: Path,
    seed: int,
    how: Training | None = None,
) -> dict[str, Any]:
    """Train one network that sees object states, and write it to a file beside one that acts.

    Args:
        acts: File of a network on object states.
        data: Demonstrations.
        images: What `watch` renders of them.
        out: The file, with both.
        seed: Of the numbers at the start, and the order.
        how: How long.

    Returns:
        What is told of it: passes over the images, steps, and how far off objects are seen in
        demonstrations held out, in millimetres.

    Raises:
        DataError: There are too few demonstrations, or the network that acts is of another task.
    """
    check(acts, data)
    how = how or Training()
    torch.set_num_threads(1)
    torch.manual_seed(seed)
    rows = _Rows(data, images, how)
    net = Sight(rows.scale).to(
        how.device, memory_format=torch.channels_last
    )  # as pictures are
    adam = torch.optim.AdamW(
        net.parameters(), lr=how.rate, weight_decay=1e-4, fused=True
    )
    steps = how.passes * math.ceil(len(rows.learned) / how.batch)
    for k in range(steps):
        for group in adam.param_groups:
            group["lr"] = how.rate * min(1.0, (k + 1) / how.warm_up) * (1 - k / steps)
        drawn = torch.multinomial(rows.shares, how.batch, replacement=True)
        error = rows.errors(net, rows.learned[drawn]).abs().mean()
        adam.zero_grad()
        error.backward()
        adam.step()
        if k % 200 == 0:
            print(f"step {k + 1} of {steps}: error {error:.3f}", flush=True)
    off = rows.millimetres(net.eval())
    sight = {
        f"{SIGHT}{name}": value.cpu().numpy()
        for name, value in net.state_dict().items()
    }
    np.savez(out, **dict(np.load(acts)) | sight)
    return {"passes": how.passes, "steps": steps, "objects_off_mm": round(off, 1)}


class _Rows:
    """Every third row of demonstrations as tensors, and what is seen in it."""

    def __init__(
        self, data: Demonstrations, images: Sequence[Pixels], how: Training
    ) -> None:
        seen = shown(data.objects, data.names)[::EVERY]
        self.scale = {"o_mean": seen.mean(0), "o_scale": seen.std(0) + network.LEAST}
        held = np.repeat(data.held_out(how.held_out), data.lengths)[::EVERY]
        self.learned, self._held = (
            torch.from_numpy(np.flatnonzero(rows)).to(how.device)
            for rows in (~held, held)
        )
        before = np.concatenate([np.arange(length) for length in data.lengths])[::EVERY]
        self.shares = 1 / (torch.from_numpy(before[~held]).to(how.device) + how.early)
        pictures = (torch.from_numpy(one).to(how.device) for one in images)
        self._pictures = [one.permute(0, 3, 1, 2) for one in pictures]
        self._seen = torch.from_numpy(seen).to(how.device)
        places = [data.names.index(f"{body}_x") for body in bodies(data.names)]
        self._places = torch.tensor([[x, x + 1, x + 2] for x in places])

    def errors(self, net: Sight, rows: torch.Tensor) -> torch.Tensor:
        """Errors of what is seen in some rows (B, k), normal."""
        seen = (self._seen[rows] - net.o_mean) / net.o_scale
        return net([one[rows] for one in self._pictures]) - seen

    def millimetres(self, net: Sight) -> float:
        """How far off objects are seen on average in demonstrations that are not learned from."""
        with torch.no_grad():
            parts = [self.errors(net, rows) for rows in self._held.split(256)]
        off = (torch.cat(parts) * net.o_scale).cpu()[:, self._places]
        return 1000 * float(off.norm(dim=-1).mean())


def watch(demos: Path, task: str, data: Demonstrations) -> list[Pixels]:
    """Render every third row of demonstrations.

    Args:
        demos: Folder of the recordings that the export was made of.
        task: Their task.
        data: The demonstrations, which say how many.

    Returns:
        Images (T / EVERY, SIZE, SIZE, 3) of each camera.

    Raises:
        DataError: The recordings are others.
    """
    rows = len(range(0, len(data.state), EVERY))
    images = [np.empty((rows, SIZE, SIZE, 3), np.uint8) for _ in POLICY_CAMERAS]
    recordings = DataSet.open(demos, create=False).recordings(task)
    source = ImageSource(task, size=(SIZE, SIZE))
    first, place = 0, 0
    for number, length in enumerate(data.lengths.tolist()):
        recording, state = next(recordings, None), data.state[first : first + length]
        recorded = data.recorded[first : first + length]
        if (
            recording is None
            or len(recording) <= recorded.max()
            or not np.allclose(recording.agent_pos[recorded], state, atol=1e-5)
        ):
            raise DataError(
                f"Episode {number} of {task} in {demos} is not that of the export."
            )
        for row in range(-first % EVERY, length, EVERY):
            shown = source.images(recording, recorded[row])
            for all_of_it, camera in zip(images, POLICY_CAMERAS, strict=True):
                all_of_it[place] = shown[camera]
            place += 1
        first += length
        if number % 20 == 0:
            print(
                f"{task}: {number + 1} of {len(data.lengths)} episodes rendered",
                flush=True,
            )
    source.close()
    return images


class Images(network.Network):
    """Plays a trained network on what it sees."""

    def __init__(self) -> None:
        """Read the file that the variable CHECKPOINT names."""
        super().__init__()
        scale = {
            k.removeprefix(SIGHT): v
            for k, v in self._net.items()
            if k.startswith(SIGHT)
        }
        if not scale:
            raise PolicyError(
                "CHECKPOINT names a network that sees no images: python images.py DEMOS EXPORT "
                "NETWORK OUT trains one that does."
            )
        torch.set_num_threads(1)
        self._sight = Sight(scale).eval()
        self._sight.load_state_dict(
            {name: torch.from_numpy(a) for name, a in scale.items()}
        )
        self.metadata = replace(
            self.metadata,
            name="frames of things, from images",
            cameras=POLICY_CAMERAS,
            image_size=(SIZE, SIZE),
            object_state=False,
        )

    def act(self, observation: Mapping[str, Any]) -> Rows:
        """The next chunk (30, 16)."""
        return super().act(
            {**observation, "environment_state": self.objects(observation)}
        )

    def objects(self, observation: Mapping[str, Any]) -> Rows:
        """The object state (n,) as it is seen."""
        pixels = (observation["pixels"][camera] for camera in POLICY_CAMERAS)
        images = [torch.tensor(one.transpose(2, 0, 1))[None] for one in pixels]
        with torch.no_grad():
            seen = self._sight(images) * self._sight.o_scale + self._sight.o_mean
        return recognized(seen.numpy(), self.names)[0]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("demos", type=Path, help="folder of recordings")
    parser.add_argument(
        "export", type=Path, help="what was exported of them, of one task"
    )
    parser.add_argument(
        "acts", type=Path, help="network that network.py made of the same"
    )
    parser.add_argument("out", type=Path)
    parser.add_argument("--episodes", type=int)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--device", default="cpu", help="what PyTorch trains on")
    asked = parser.parse_args()
    try:
        demonstrations = Demonstrations.load(asked.export, asked.episodes)
        check(asked.acts, demonstrations)  # before what takes minutes
        pictures = watch(asked.demos, asked.export.name, demonstrations)
        how = Training(device=asked.device)
        print(train(asked.acts, demonstrations, pictures, asked.out, asked.seed, how))
    except DuoBenchError as error:
        parser.exit(1, f"error: {error}\n")
