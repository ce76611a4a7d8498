"""The network of this folder, told by images where things are.

`sight.py` finds the object state in the images of all cameras, and the network that was trained
on object states acts on it. Object states are what it learns to see by, in training alone: those of
demonstrations, and of layouts at rest under arms that are anywhere. PyTorch trains and plays it.

    python network.py exports/carry_pot acts.npz --episodes 200 --seed 0
    python images.py demos exports/carry_pot acts.npz sees.npz --episodes 200 --seed 0
    CHECKPOINT=sees.npz duobench eval --policy images:Images --tasks carry_pot --out runs/images
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import learning
import network
import numpy as np
import torch
from demonstrations import Demonstrations, Rows
from frames import (
    QUARTERS,
    bodies,
    frames,
    places_in,
    rotations_of,
    with_pose_noise,
)
from numpy.typing import NDArray
from own_play import Trial
from pictures import Pictures, at_rest, in_play, watch
from rays import Points, Usual, meet
from sight import WINDOW, Sight, places_of_cameras, rendered_sizes, whole
from tracks import Tracks
from windows import Windows

from duobench.core.errors import DataError, DuoBenchError, PolicyError
from duobench.core.types import SIDES
from duobench.world.robot.cameras import POLICY_CAMERAS
from duobench.world.robot.frames import robot_with

EARLY = 50
"""The n-th row of an episode is drawn with a weight of 1 / (n + `EARLY`): what is seen in the first
ones decides where hands go, and many later ones look alike."""
MOST_POSE_NOISE = 4e-3, 0.06
"""Largest standard deviations (m, rad) of where objects are told to be, and how turned, to the
network whose play is rendered; each episode draws its own up to these."""
LOOKS = 2
"""How often it looks closer at what it has found."""
SIGHT, USUAL = "sight.", "usual."
"""What names of its arrays begin with in the file of a network."""
Array = NDArray[np.float64]


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


@dataclass(frozen=True)
class Kinds:
    """Which numbers of what is seen are of which kind; each has a loss of its own."""

    places: list[slice]
    """Places of objects."""
    axes: list[slice]
    """Axes of objects."""
    chosen: list[int]
    """Numbers that a layout chose, such as a wall: they are whole, and never change."""
    others: list[int]
    """All others, such as the angle of a hinge, and quarters of a turn."""

    @staticmethod
    def of(data: Demonstrations) -> Kinds:
        """Those of demonstrations."""
        first = np.repeat(np.cumsum(data.lengths) - data.lengths, data.lengths)
        still = (data.objects == data.objects[first]).all(0)
        whole = (data.objects == data.objects.round()).all(0)
        places = places_in(data.names)
        axes = [part for _, x, z in _axes(data.names) for part in (x, z)]
        known = {n for part in places + axes for n in range(part.start, part.stop)}
        vary = (data.objects != data.objects[0]).any(0)
        chosen = sorted(set(np.flatnonzero(still & whole & vary).tolist()) - known)
        quarters = range(len(data.names), len(data.names) + QUARTERS * len(axes) // 2)
        others = sorted(set(range(quarters.stop)) - known - set(chosen))
        return Kinds(places, axes, chosen, others)


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


def rotations(seen: Rows, names: tuple[str, ...]) -> NDArray[np.float64]:
    """Rotations (T, K, 3, 3) of objects whose axes were seen (T, k), those that point forwards."""
    turns = np.tile(np.eye(3), (len(seen), len(bodies(names)), 1, 1))
    for k, x, z in _axes(names):
        up = seen[:, z] / np.linalg.norm(seen[:, z], axis=1, keepdims=True)
        ahead = seen[:, x] - (seen[:, x] * up).sum(1, keepdims=True) * up
        ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
        turns[:, k - len(SIDES)] = rotations_of(ahead, up)
    return turns


def recognized(seen: Rows, names: tuple[str, ...]) -> Rows:
    """Object states (T, n) of what was seen of them (T, k)."""
    objects, quarters = seen[:, : len(names)].copy(), seen[:, len(names) :]
    turns = rotations(seen, names)
    for nth, (k, x, z) in enumerate(_axes(names)):
        ahead, aside, up = np.moveaxis(turns[:, k - len(SIDES)], -1, 0)
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


def poses(objects: Rows, names: tuple[str, ...]) -> tuple[Array, Array]:
    """Places (T, K, 3) and rotations (T, K, 3, 3) of objects, turned forwards."""
    here = frames(np.zeros((len(objects), 16), np.float32), objects, names)
    things = slice(len(SIDES), -1)
    return here.positions[:, things], here.rotations[:, things]


def on_patches(
    places: Array, turns: Array, names: tuple[str, ...]
) -> list[torch.Tensor]:
    """The poses of objects with axes: patches are laid on them."""
    things = [k - len(SIDES) for k, _, _ in _axes(names)]
    return [torch.from_numpy(part[:, things]).float() for part in (places, turns)]


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
    seen = watch(demos, task, data) + at_rest(task, data, how.layouts)
    return seen + in_play(_WithNoise(acts), task, data, how.played)


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
        off what it does not learn from is seen, as `_Rows.told` says.

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
    trial = Trial(task, how.episodes)

    def error() -> torch.Tensor:
        losses = rows.losses(net, rows.drawn(how.batch), rows.drawn(how.closer))
        return torch.stack(list(losses.values())).sum()

    def look(average: Sight, file: Path) -> tuple[int, float]:
        sight = {f"{SIGHT}{k}": v for k, v in network.arrays(average).items()}
        np.savez(file, **others, **sight)
        return trial.score(Images(file))

    told = learning.learn(net, error, how, look, out, seed)
    return told | {"images": len(pictures.state)} | rows.told(Images(out))


class _Rows:
    """Images to learn from, and what is seen in them."""

    def __init__(self, data: Demonstrations, pictures: Pictures, device: str) -> None:
        self.kinds, self._names = Kinds.of(data), data.names
        self._pictures, self._device = pictures, device
        self._held = np.flatnonzero(pictures.held)
        self.learned = np.flatnonzero(~pictures.held)
        self._early = 1.0 / torch.from_numpy(pictures.before[self.learned] + EARLY)
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
            moved = [one + network.NOISE * torch.randn_like(one) for one in moved]
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
        told = torch.from_numpy(self._pictures.told[rows])
        windows = Windows.around(told, self._cameras[rows])
        return windows, torch.from_numpy(self._pictures.near[rows]).to(self._device)

    def told(self, sees: Images) -> dict[str, Any]:
        """How well is seen what is not learned from.

        Returns:
            Of each object how far off it is in millimetres: on average, in first rows, and what
            always saying the mean is; how many degrees its axes are off, in the first two; the
            share of what layouts chose that is read right.
        """
        held, true = self._held, self._pictures.objects[self._held]
        parts = np.array_split(held, math.ceil(len(held) / 64))
        found = [
            sees.found(
                self.images(rows),
                self._pictures.state[rows],
                lambda _, rows=rows: self.windows(rows),
            )
            for rows in parts
        ]
        found = np.concatenate(found)
        first = self._pictures.before[held] == 0
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


class Images(network.Network):
    """Plays a trained network on what it sees."""

    def __init__(self, path: Path | None = None) -> None:
        """Read a file, or the one that the variable CHECKPOINT names."""
        super().__init__(path)
        if "chosen" not in self._net:
            raise PolicyError(
                "CHECKPOINT names a network that sees no images: python images.py DEMOS EXPORT "
                "NETWORK OUT trains one that does."
            )
        torch.set_num_threads(1)
        parts = {
            name.removeprefix(SIGHT): torch.from_numpy(value)
            for name, value in self._net.items()
            if name.startswith(SIGHT)
        }
        scale = {key: parts[key].numpy() for key in ("o_mean", "o_scale")}
        self._chosen = self._net["chosen"].tolist()
        self._usual = Usual(self._net[f"{USUAL}mean"], self._net[f"{USUAL}precision"])
        self._sight = Sight(self.names, scale, self._chosen).eval()
        self._sight.load_state_dict(parts)
        self._read: list[Rows] = []
        self._places = places_in(self.names)
        turned = [k - len(SIDES) for k, _, _ in _axes(self.names)]
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
        self._read.append(
            objects[0, self._chosen]
        )  # which never changes: all looks count
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

        return self.found([whole(image) for image in images], state, closer)

    def found(
        self,
        images: Sequence[torch.Tensor],
        state: Rows,
        closer: Callable[[Array], tuple[Windows, torch.Tensor]],
    ) -> Rows:
        """Object states (B, n) that are found in images of `SIZES`.

        Args:
            images: Of each camera (B, 3, height, width).
            state: Joints and openings (B, 16).
            closer: Windows around places (B, K, 3), and what is in them.
        """
        sight = self._sight
        cameras = places_of_cameras(state, self._robot)
        with torch.no_grad():
            found, views = sight(images)
            seen = (found * sight.o_scale + sight.o_mean).numpy()
            far = [one.pixels for one in views], [one.spread + 1 for one in views]
            rays = sight.rays(*far, cameras)
            turns = rotations(seen, self.names)
            places, turns = meet(rays, sight.points, self._usual, turns)
            for _ in range(LOOKS):
                near = self._closer(*closer(places))
                both = [a + b for a, b in zip(far, near, strict=True)]
                rays = sight.rays(*both, np.concatenate([cameras, cameras], 1))
                places, turns = meet(rays, sight.points, self._usual, turns)
            self._put(seen, places, turns)
            if self._chosen:
                patches = on_patches(places, turns, self.names)
                columns = sight.read_there
                read = sight.read(images, torch.from_numpy(cameras), *patches)
                read = read * sight.o_scale[columns] + sight.o_mean[columns]
                seen[:, columns] = read.numpy()
        return recognized(seen, self.names)

    def _put(self, objects: Rows, places: Array, turns: Array) -> None:
        """Write places (T, K, 3) and axes of rotations (T, K, 3, 3) into T rows of objects."""
        for place, part in zip(places.swapaxes(0, 1), self._places, strict=True):
            objects[:, part] = place
        for k, x, z in _axes(self.names):
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
        how = Training(device=asked.device)
        images = see(asked.acts, asked.demos, asked.export.name, demonstrations, how)
        print(
            train(
                asked.acts,
                demonstrations,
                images,
                asked.export.name,
                asked.out,
                asked.seed,
                how,
            )
        )
    except DuoBenchError as error:
        parser.exit(1, f"error: {error}\n")
