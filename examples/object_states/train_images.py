"""Train a network of this folder to see: to find the object state in images.

Object states are what it learns to see by, in training alone: those of demonstrations, of layouts
at rest under arms that are anywhere, and of its own play. PyTorch trains it.

    python network.py exports/carry_pot acts.npz --episodes 200 --seed 0
    python train_images.py demos exports/carry_pot acts.npz sees.npz --episodes 200 --seed 0
    CHECKPOINT=sees.npz duobench eval --policy images:Images --tasks carry_pot --out runs/images
"""

from __future__ import annotations

import argparse
import hashlib
import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import learning
import network
import numpy as np
import torch
from demonstrations import Demonstrations, Rows
from frames import bodies, with_pose_noise
from images import SIGHT, USUAL, Images, on_patches
from numpy.typing import NDArray
from own_play import Trial
from pictures import Pictures, at_rest, in_play, joined, watch
from rays import Points, Usual
from sight import WINDOW, Sight, places_of_cameras
from visible import Kinds, poses, shown
from windows import Windows

from duobench.core.errors import DataError, DuoBenchError, check_known
from duobench.tasks import catalog
from duobench.world.robot.frames import robot_with

EARLY = 50
"""The n-th row of an episode is drawn with a weight of 1 / (n + `EARLY`): what is seen in the first
ones decides where hands go, and many later ones look alike."""
MOST_POSE_NOISE = 4e-3, 0.06
"""Largest standard deviations (m, rad) of where objects are told to be, and how turned, to the
network whose play is rendered; each episode draws its own up to these."""


@dataclass(frozen=True)
class Training(learning.Training):
    """How long it learns to see, and from what beside demonstrations."""

    batch: int = 32
    closer: int = 64
    """Rows of which windows are seen in a step."""
    rate: float = 2e-3
    decay: float = 1e-4
    warm_up: int = 50
    every: int = 1000
    most: int = 4000
    patience: int = 1000
    layouts: int = 2000
    """Layouts at rest."""
    played: int = 60
    """Episodes of its own play."""


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


def see(
    acts: Path, demos: Path, task: str, data: Demonstrations, how: Training
) -> Pictures:
    """Render what there is to learn from; see `watch`, `at_rest` and `in_play`."""
    return joined(
        [
            watch(demos, task, data),
            at_rest(task, data, how.layouts),
            in_play(_WithNoise(acts), task, data, how.played),
        ]
    )


class _WithNoise(network.Network):
    """Acts on object states that are a little wrong, as they are when they are seen."""

    def reset(self, instruction: str, seed: int) -> None:
        super().reset(instruction, seed)
        self._rng = np.random.default_rng(seed)
        share = self._rng.random()
        self._noise = [share * size for size in MOST_POSE_NOISE]

    def plan(self, state: Rows, objects: Rows) -> Rows:
        told = with_pose_noise(objects[None], self.names, *self._noise, self._rng)[0]
        return super().plan(state, told)


def train(
    acts: Path,
    data: Demonstrations,
    pictures: Pictures,
    task: str,
    out: Path,
    seed: int,
    how: Training | None = None,
) -> dict[str, Any]:
    """Train one network that sees object states, and write it to a file beside one that acts.

    Args:
        acts: File of a network on object states.
        data: Demonstrations.
        pictures: Images of them, and more.
        task: Their task, of which layouts of `train` are played.
        out: The file, with both.
        seed: Of the numbers at the start, and the order.
        how: How long.

    Returns:
        What is told of it: see `learning.learn`; how many images of a camera there are, and how far
        off what it does not learn from is seen, as `_Rows.errors` says.

    Raises:
        DataError: The network that acts is of another task.
    """
    check(acts, data)
    how = how or Training()
    torch.set_num_threads(1)
    torch.manual_seed(seed)
    rows = _Rows(data, pictures, how.device)
    net = rows.sight().to(how.device, memory_format=torch.channels_last)
    chosen = np.array(rows.kinds.chosen, dtype=np.int64)
    usual = {f"{USUAL}{k}": part for k, part in asdict(rows.usual).items()}
    others = dict(np.load(acts)) | usual | {"chosen": chosen}
    trial = Trial(task, how.episodes, data.gripper)

    def error() -> torch.Tensor:
        losses = rows.losses(net, rows.drawn(how.batch), rows.drawn(how.closer))
        return torch.stack(list(losses.values())).sum()

    def look(average: Sight, file: Path) -> tuple[int, float]:
        sight = {f"{SIGHT}{k}": v for k, v in network.arrays(average).items()}
        np.savez(file, **others, **sight)
        return trial.score(Images(file))

    source = f"{data.hashed()} {hashlib.sha256(acts.read_bytes()).hexdigest()[:16]}"
    told = learning.learn(net, error, how, look, out, seed, source)
    return told | {"images": len(pictures.state)} | rows.errors(Images(out))


class _Rows:
    """Images to learn from, and what is seen in them."""

    def __init__(self, data: Demonstrations, pictures: Pictures, device: str) -> None:
        self.kinds, self._names = Kinds.of(data), data.names
        self._pictures, self._device = pictures, device
        self._held_out = np.flatnonzero(pictures.held_out)
        self.learned = np.flatnonzero(~pictures.held_out)
        self._early = 1.0 / torch.from_numpy(pictures.row[self.learned] + EARLY)
        seen = shown(pictures.objects, data.names)
        self.scale = {"o_mean": seen.mean(0), "o_scale": seen.std(0) + network.LEAST}
        self._seen = torch.from_numpy(seen)
        robot = robot_with(data.gripper)
        self._cameras = torch.from_numpy(places_of_cameras(pictures.state, robot))
        there = poses(pictures.objects, data.names)
        points = Points.of(data.names)
        self._points = torch.from_numpy(points.at(*there)).float()
        self._shares = torch.from_numpy(points.shares()).float().to(device)
        self._patches = on_patches(*there, data.names)
        self.usual = Usual.of(points, *(part[self.learned] for part in there))

    def sight(self) -> Sight:
        """A network that sees them."""
        return Sight(self._names, self.scale, self.kinds.chosen)

    def drawn(self, count: int) -> NDArray[np.int64]:
        """Some rows to learn from."""
        drawn = torch.multinomial(self._early, count, replacement=True)
        return self.learned[drawn.numpy()]

    def images(self, rows: NDArray[np.int64]) -> list[torch.Tensor]:
        """Those of some rows, of each camera (B, 3, height, width)."""
        found = (torch.from_numpy(one[rows]) for one in self._pictures.images)
        return [one.permute(0, 3, 1, 2).to(self._device) for one in found]

    def losses(
        self, net: Sight, rows: NDArray[np.int64], closer: NDArray[np.int64]
    ) -> dict[str, torch.Tensor]:
        """Errors of some rows by kind: how surprising pixels are, and in standard deviations."""
        kinds, images = self.kinds, self.images(rows)
        cameras, points, seen = (
            one[rows].to(self._device)
            for one in (self._cameras, self._points, self._seen)
        )
        found, views = net(images)
        there = net.pixels(points, cameras)
        wrong = [
            (eye.surprise(view.maps, *seen_at) * self._shares).sum(1).mean()
            for eye, view, seen_at in zip(net.eyes, views, there, strict=True)
        ]
        losses = {"pixels": torch.stack(wrong).mean()}
        losses["windows"] = self._in_windows(net, closer)
        label = (seen - net.o_mean) / net.o_scale
        off = (found - label).abs()
        if kinds.axes:
            losses["axes"] = torch.stack([off[:, part] for part in kinds.axes]).mean()
        if kinds.others:
            losses["others"] = off[:, kinds.others].mean()
        if kinds.chosen:
            moved = [one[rows].to(self._device) for one in self._patches]
            moved = [
                one + network.NOISE * torch.randn(one.shape).to(one) for one in moved
            ]
            read = net.read(images, cameras, *moved)
            losses["read"] = (read - label[:, net.read_there]).abs().mean()
        return losses

    def _in_windows(self, net: Sight, rows: NDArray[np.int64]) -> torch.Tensor:
        """How surprising pixels are in windows of some rows."""
        there = net.pixels(self._points[rows], self._cameras[rows])
        windows, images = self.windows(rows)
        inside = windows.inside(torch.stack([at for at, _ in there], 1), net.things)
        within = ((inside > 0) & (inside < WINDOW - 1)).all(-1)
        lost = torch.zeros((), device=images.device)
        for k, (eye, view) in enumerate(zip(net.near, net.closer(images), strict=True)):
            own = net.things == k
            seen_at = inside[:, :, own].flatten(0, 1), within[:, :, own].flatten(0, 1)
            wrong = eye.surprise(view.maps, *seen_at) * self._shares[own]
            lost = lost + wrong.sum(1).mean()
        return lost

    def windows(self, rows: NDArray[np.int64]) -> tuple[Windows, torch.Tensor]:
        """Where windows of some rows are, and what is in them."""
        places = torch.from_numpy(self._pictures.window_places[rows])
        windows = Windows.around(places, self._cameras[rows])
        return windows, torch.from_numpy(self._pictures.near[rows]).to(self._device)

    def errors(self, sees: Images) -> dict[str, Any]:
        """How well is seen what is not learned from.

        Not all of that is of layouts that are seen nowhere: those of play that are held out are
        seen at rest, under other arms.

        Returns:
            Of each object how far off it is in millimetres: on average, in first rows, and what
            always saying the mean is; how many degrees its axes are off, in the first two; the
            share of what layouts chose that is read right.
        """
        held, true = self._held_out, self._pictures.objects[self._held_out]
        parts = np.array_split(held, math.ceil(len(held) / 64))
        found = [
            sees.found(
                self.images(rows),
                self._cameras[rows],
                lambda _, rows=rows: self.windows(rows),
            )
            for rows in parts
        ]
        found = np.concatenate(found)
        first = self._pictures.row[held] == 0
        mean = self.scale["o_mean"]
        places, turns = {}, {}
        for body, part in zip(bodies(self._names), self.kinds.places, strict=True):
            off = 1000 * np.linalg.norm(found[:, part] - true[:, part], axis=1)
            least = 1000 * np.linalg.norm(mean[part] - true[:, part], axis=1)
            places[body] = _rounded(off.mean(), off[first].mean(), least.mean())
        here, there = (shown(one, self._names) for one in (found, true))
        for part in self.kinds.axes:
            cosine = (here[:, part] * there[:, part]).sum(1).clip(-1, 1)
            off = np.degrees(np.arccos(cosine))
            name = self._names[part.start].removesuffix("_x")
            turns[name] = _rounded(off.mean(), off[first].mean())
        told: dict[str, Any] = {"off_mm": places, "off_degrees": turns}
        if self.kinds.chosen:
            right = found[:, self.kinds.chosen].round() == true[:, self.kinds.chosen]
            told["read_right"] = round(float(right[first].mean()), 4)
        return told


def _rounded(*values: float) -> list[float]:
    return [round(float(value), 1) for value in values]


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
        check_known("task", asked.export.name, catalog.names())
        demonstrations = Demonstrations.load(asked.export, asked.episodes)
        check(asked.acts, demonstrations)  # before what takes minutes
        how = Training(device=asked.device)
        task = asked.export.name
        pictures = see(asked.acts, asked.demos, task, demonstrations, how)
        told = train(
            asked.acts, demonstrations, pictures, task, asked.out, asked.seed, how
        )
        print(told)
        learning.forget(asked.out)
    except DuoBenchError as error:
        parser.exit(1, f"error: {error}\n")
