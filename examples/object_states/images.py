"""The network of this folder, told by images where things are.

Three small convolutional networks, one a camera, look for places in the images (the centres of
mass of maps). From these and the robot's own state follows where the objects are, and from that, as
in `network.py`, where the tools go: in the frames of the tools, of these places and of the table.
Object states teach it where things are, in training alone. Trained and played with PyTorch.

    python images.py demos exports/carry_pot carry_pot.pt --episodes 200 --seed 0
    CHECKPOINT=carry_pot.pt duobench eval --policy images:Images --tasks carry_pot --out runs/images
"""

from __future__ import annotations

import argparse
import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import network
import numpy as np
import torch
from demonstrations import Demonstrations, Grippers, Rows, checkpoint, openings, to_actions
from frames import bodies, frames
from numpy.typing import NDArray
from torch import nn

from duobench.data import DataSet, ImageSource
from duobench.errors import DataError, DuoBenchError, PolicyError
from duobench.policy import PolicyMetadata
from duobench.types import POLICY_CAMERAS, SIDES

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
PER_METRE = 10.0
"""Ways between things are scaled by this, so that a decimetre is a 1."""
Pixels = NDArray[np.uint8]


@dataclass(frozen=True)
class Training:
    """How long a network learns."""

    batch: int = 128
    rate: float = 1e-3
    passes: int = 20
    """Over the images of all demonstrations; the rate falls to zero over them."""
    warm_up: int = 200
    """Steps."""


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
        with torch.autocast("cpu", dtype=torch.bfloat16, enabled=self.training):  # twice as fast
            maps = self.layers(images.float() / 127.5 - 1)
        return (maps.float().flatten(2).softmax(-1) @ self.grid).flatten(1)


class Sight(nn.Module):
    """From images and the robot's state to a chunk of tool poses."""

    def __init__(self, objects: int, scale: Mapping[str, NDArray[Any]]) -> None:
        super().__init__()
        self.eyes = nn.ModuleList(Eye(stride) for stride in STRIDES)
        places, state = len(STRIDES) * PLACES * 2, scale["x_mean"].shape[0]
        self.find = nn.Sequential(
            nn.Linear(places + state, network.WIDTH),
            nn.GELU(),
            nn.Linear(network.WIDTH, objects * 3),
        )
        self.objects = objects
        things = len(SIDES) + objects + 1
        ways = 3 * things * (len(SIDES) + 1)
        self.net = network.module(state + places + ways, things, scale)
        for key in ("p_mean", "p_scale"):
            self.register_buffer(key, torch.from_numpy(scale[key]).float())

    def forward(
        self, images: Sequence[torch.Tensor], state: Any, tools: Any, turns: Any
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Normal labels (B, 30, 20), and where the objects are (B, n, 3) in metres.

        Args:
            images: One of each camera (B, 3, SIZE, SIZE).
            state: What the robot says of itself (B, k), normal.
            tools: Positions of both tools (B, 2, 3), in the table frame.
            turns: Their rotations (B, 2, 3, 3).
        """
        rows = len(state)
        seen = torch.cat([*(eye(i) for eye, i in zip(self.eyes, images, strict=True)), state], 1)
        where = self.find(seen).view(rows, self.objects, 3) * self.p_scale + self.p_mean
        table = torch.zeros(rows, 1, 3)
        positions = torch.cat([tools, where, table], 1)
        still = torch.eye(3).expand(rows, self.objects + 1, 3, 3)
        ways = positions[:, :, None] - torch.cat([tools, table], 1)[:, None]
        x = torch.cat([seen, PER_METRE * ways.flatten(1)], 1)
        return self.net(x, positions, torch.cat([turns, still], 1)), where


def robot_state(state: Rows) -> tuple[Rows, Rows, Rows]:
    """Numbers of the robot (T, k), tool positions (T, 2, 3) and rotations (T, 2, 3, 3)."""
    here = frames(state, np.zeros((len(state), 0), np.float32), ())
    tools, turns = here.positions[:, : len(SIDES)], here.rotations[:, : len(SIDES)]
    rows = len(state)
    numbers = np.hstack([state, tools.reshape(rows, -1), turns[..., :2].reshape(rows, -1)])
    return numbers.astype(np.float32), tools.astype(np.float32), turns.astype(np.float32)


def train(
    data: Demonstrations,
    images: Sequence[Pixels],
    out: Path,
    seed: int,
    how: Training | None = None,
) -> dict[str, Any]:
    """Train one network with Adam on the mean absolute error, and write it to a file.

    Args:
        data: Demonstrations.
        images: What `watch` renders of them.
        out: The file.
        seed: Of the numbers at the start, and the order.
        how: How long.

    Returns:
        What is told of it: passes over the demonstrations, steps, and how far off objects were seen
        in the end, in millimetres.
    """
    how = how or Training()
    torch.set_num_threads(1)
    torch.manual_seed(seed)
    shown = _Rows(data, images)
    net = Sight(shown.objects, shown.scale).to(memory_format=torch.channels_last)  # as pictures are
    adam = torch.optim.AdamW(net.parameters(), lr=how.rate, weight_decay=1e-4, fused=True)
    steps = how.passes * math.ceil(len(shown.where) / how.batch)
    off = math.nan
    for k in range(steps):
        for group in adam.param_groups:
            group["lr"] = how.rate * min(1.0, (k + 1) / how.warm_up) * (1 - k / steps)
        acts, sees, metres = shown.errors(net, torch.randint(len(shown.where), (how.batch,)))
        adam.zero_grad()
        (acts + sees).backward()
        adam.step()
        if k % 200 == 0 or k == steps - 1:
            off = 1000 * float(metres)
            print(f"step {k + 1} of {steps}: error {acts:.3f}, {off:.1f} mm off", flush=True)
    about = {"names": data.names, "openings": openings(data.labels), "objects": shown.objects}
    tensors = {name: torch.from_numpy(value) for name, value in shown.scale.items()}
    torch.save({"about": about, "scale": tensors, "net": net.state_dict()}, out)
    return {"passes": how.passes, "steps": steps, "objects_off_mm": round(off, 1)}


class _Rows:
    """Every third row of demonstrations as tensors, and what is seen in it."""

    def __init__(self, data: Demonstrations, images: Sequence[Pixels]) -> None:
        rows = np.arange(0, len(data.state), EVERY)
        numbers, tools, turns = robot_state(data.state)
        columns = [data.names.index(f"{thing}_x") for thing in bodies(data.names)]
        where = np.stack([data.objects[:, c : c + 3] for c in columns], 1)
        scale = {"x_mean": numbers.mean(0), "x_scale": numbers.std(0) + network.LEAST}
        scale |= {"y_mean": data.labels.mean(0), "y_scale": data.labels.std(0) + 1e-3}
        scale |= {"p_mean": where.mean(0), "p_scale": where.std(0) + network.LEAST}
        self.scale, self.objects = scale, len(columns)
        self.where = torch.from_numpy(where[rows])
        self._pictures = [torch.from_numpy(one).permute(0, 3, 1, 2) for one in images]
        self._labels = torch.from_numpy((data.labels - scale["y_mean"]) / scale["y_scale"])
        self._chunks = torch.from_numpy(data.chunks(network.HORIZON)[rows])
        self._state = torch.from_numpy(((numbers - scale["x_mean"]) / scale["x_scale"])[rows])
        self._noise = torch.from_numpy(network.NOISE / scale["x_scale"]).float()
        self._tools = [torch.from_numpy(part[rows]) for part in (tools, turns)]

    def errors(self, net: Sight, rows: torch.Tensor) -> tuple[torch.Tensor, ...]:
        """Mean errors of chunks and of places, both normal, and that of places in metres."""
        state = self._state[rows]
        state = state + self._noise * torch.randn_like(state)
        images, tools = ([one[rows] for one in part] for part in (self._pictures, self._tools))
        told, found = net(images, state, *tools)
        off = found - self.where[rows]
        acts = (told - self._labels[self._chunks[rows]]).abs().mean()
        return acts, (off / net.p_scale).abs().mean(), off.detach().norm(dim=-1).mean()


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
        if (
            recording is None
            or len(recording) < length
            or not np.allclose(recording.agent_pos[:length], state, atol=1e-5)
        ):
            raise DataError(f"Episode {number} of {task} in {demos} is not that of the export.")
        for row in range(-first % EVERY, length, EVERY):
            shown = source.images(recording, row)
            for all_of_it, camera in zip(images, POLICY_CAMERAS, strict=True):
                all_of_it[place] = shown[camera]
            place += 1
        first += length
        if number % 20 == 0:
            print(f"{task}: {number + 1} of {len(data.lengths)} episodes rendered", flush=True)
    source.close()
    return images


class Images:
    """Plays a trained network."""

    def __init__(self) -> None:
        """Read the file that the variable CHECKPOINT names."""
        path = checkpoint()
        if path.is_dir() or not path.exists():
            raise PolicyError(
                f"There is no file of a network {path}; python images.py DEMOS EXPORT carry_pot.pt "
                "trains one."
            )
        torch.set_num_threads(1)
        content = torch.load(path)
        about = content["about"]
        self._scale = {name: value.numpy() for name, value in content["scale"].items()}
        self._net = Sight(about["objects"], self._scale).eval()
        self._net.load_state_dict(content["net"])
        self._openings = about["openings"]
        self._grippers = Grippers(self._openings)
        self.metadata = PolicyMetadata(
            name="frames of things, from images",
            cameras=POLICY_CAMERAS,
            image_size=(SIZE, SIZE),
            action_mode="cartesian",
            horizon=network.HORIZON,
            version=hashlib.sha256(path.read_bytes()).hexdigest()[:16],
        )

    def reset(self, instruction: str, seed: int) -> None:  # noqa: ARG002
        """Begin an episode with open hands."""
        self._grippers = Grippers(self._openings)

    def act(self, observation: Mapping[str, Any]) -> Rows:
        """The next chunk (30, 16)."""
        numbers, tools, turns = robot_state(observation["agent_pos"][None])
        state = (numbers - self._scale["x_mean"]) / self._scale["x_scale"]
        pixels = (observation["pixels"][camera] for camera in POLICY_CAMERAS)
        images = [torch.tensor(one.transpose(2, 0, 1))[None] for one in pixels]
        with torch.no_grad():
            parts = (torch.from_numpy(part) for part in (state, tools, turns))
            told = self._net(images, *parts)[0][0].numpy()
        chunk = (told * self._scale["y_scale"] + self._scale["y_mean"]).astype(np.float32)
        for label in chunk:
            self._grippers.switch(label)
        return to_actions(chunk)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("demos", type=Path, help="folder of recordings")
    parser.add_argument("export", type=Path, help="what was exported of them, of one task")
    parser.add_argument("out", type=Path)
    parser.add_argument("--episodes", type=int)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    try:
        demonstrations = Demonstrations.load(asked.export, asked.episodes)
        pictures = watch(asked.demos, asked.export.name, demonstrations)
        print(train(demonstrations, pictures, asked.out, asked.seed))
    except DuoBenchError as error:
        parser.exit(1, f"error: {error}\n")
