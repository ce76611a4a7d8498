"""A small network that learns where to go from where things are: chunks of tool poses.

Of eleven moments of a chunk it says, for each tool, to which thing it belongs (a softmax over
tools, objects and the table), its pose in the frame of that thing, and what it carries (another
softmax), whose place that is: to go 2 cm above whatever cube is next is then the same number for
every cube in every place. Trained with PyTorch, played with NumPy.

    python network.py exports/bin_sort bin_sort.npz --episodes 50 --seed 0
    CHECKPOINT=bin_sort.npz duobench eval --policy network:Network --tasks bin_sort --out runs/net
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from demonstrations import (
    Demonstrations,
    Grippers,
    Rows,
    action_mode,
    checkpoint,
    openings,
    stillness,
    to_actions,
)
from frames import Frames, bodies, columns, features, frames, with_pose_noise
from grasps import Grasps, Moves, Otherwise, moved
from learning import Training, forget, learn
from numpy.typing import NDArray
from own_play import Trial

from duobench.core.errors import DataError, DuoBenchError, PolicyError
from duobench.core.types import SIDES
from duobench.policy import PolicyMetadata
from duobench.world.robot.frames import other_robot, robot_with
from duobench.world.robot.gripper import DEFAULT_GRIPPER
from duobench.world.robot.mounts import DEFAULT_MOUNT

HORIZON, WIDTH, BLOCKS = 30, 256, 3
KNOTS = (0, 3, 6, 9, 12, 15, 18, 21, 24, 27, 29)
"""Steps of a chunk at which poses are said; between them they are interpolated."""
POSE, VECTORS = 9, 3
"""Numbers of a pose, as three vectors: a position and two axes of the tool."""
FURTHEST, LEAST = 5.0, 1e-2
"""Inputs are no further from their mean than so many standard deviations of at least so much."""
NOISE = 5e-3
"""Standard deviation of what is added to inputs in training (m, rad, and numbers without a unit):
a policy strays by millimetres from what was shown, and its goals stay where they were."""
ROWS, TIMES = 400_000, 4
"""Rows and times that demonstrations are told at least, each time otherwise (see `grasps.py`)."""
EXACT = 4
"""Every so many times they are told exactly, and else with noise on object poses: noise on each
input alone is averaged away over the many inputs that tell of one object."""
POSE_NOISE = 2e-3, 0.02
"""Standard deviations of that noise (m, rad)."""
CLOSE = 0.05
"""Metres over which is told in close-up where one thing is from another: whether a hand is 2 or
4 cm over what it grasps is little beside how far it comes."""
EMPTY = 3.0
"""Logarithm of how much likelier than with any one thing a hand is empty, before training."""
UNLIKELY = 1e-6
"""Share of what is carried that is as surprising as nought."""
KNOWN = 0.05
"""What it counts how surprising it is what hands carry, beside errors of chunks."""
METRES = 0.1
"""Size of a position in the frame of a thing, in metres, that is a 1 for the network."""


def train(
    data: Demonstrations,
    task: str,
    out: Path,
    seed: int,
    how: Training | None = None,
) -> dict[str, Any]:
    """Train one network on the mean absolute error, and write the one that plays best to a file.

    What hands carry is taught too: a hand that has not grasped yet would else be taken for one that
    holds what it grasps as far away as it still is. The action at the end of an episode is held,
    and counts, so that letting go is learned.

    Args:
        data: Demonstrations.
        task: Their task, of which layouts of `train` are played.
        out: The file.
        seed: Of the numbers at the start, and the order.
        how: How long.

    Returns:
        What is told of it; see `learn`.

    Raises:
        DataError: The actions are no tool poses.
    """
    how = how or Training()
    if action_mode(data.labels) != "cartesian":
        raise DataError(
            "The network says tool poses, and these actions are joint targets: export with "
            "--action cartesian."
        )
    import torch

    torch.set_num_threads(1)
    torch.manual_seed(seed)
    scale = _scale(data)
    shown = _Rows(data, scale, how.device, seed)
    net = module(data.names, scale).to(how.device)
    about: dict[str, Any] = {"names": data.names, "columns": data.columns}
    about |= {"close": CLOSE}
    about |= {"openings": openings(data.labels), "gripper": data.gripper}
    about |= {"still": stillness(data.labels, data.lengths)}
    about |= {"mode": action_mode(data.labels)}
    trial = Trial(task, how.episodes, data.gripper)

    def error() -> Any:
        rows = torch.randint(len(shown.labels), (how.batch,))
        return shown.error(net, rows.to(how.device))

    def look(average: Any, file: Path) -> tuple[int, float]:
        np.savez(file, about=json.dumps(about), **scale, **arrays(average))
        return trial.score(Network(file))

    return learn(net, error, how, look, out, seed, data.hashed())


def arrays(net: Any) -> dict[str, NDArray[Any]]:
    """The numbers of a network of PyTorch by their names."""
    return {name: value.cpu().numpy() for name, value in net.state_dict().items()}


def _scale(data: Demonstrations) -> dict[str, Any]:
    robot = robot_with(data.gripper)
    seen = features(data.state, data.objects, data.names, robot)
    scale = {"x_mean": seen.mean(0), "x_scale": seen.std(0) + LEAST}
    return scale | {"y_mean": data.labels.mean(0), "y_scale": data.labels.std(0) + 1e-3}


def ways(names: tuple[str, ...]) -> NDArray[np.int64]:
    """Which features are told in close-up too."""
    return np.concatenate([np.r_[part] for part in columns(names)])


def blend() -> Rows:
    """How much of each knot is in each step of a chunk (30, 11)."""
    return np.array(
        [np.interp(range(HORIZON), KNOTS, row) for row in np.eye(len(KNOTS))]
    ).T


class _Rows:
    """Demonstrations as tensors, told several times, each time otherwise."""

    def __init__(
        self, data: Demonstrations, scale: Mapping[str, Any], device: str, seed: int
    ) -> None:
        import torch

        def tensor(part: NDArray[Any]) -> Any:
            kind = np.int64 if part.dtype.kind == "i" else np.float32
            return torch.from_numpy(part.astype(kind)).to(device)

        robot = robot_with(data.gripper)
        rng = np.random.default_rng(seed)
        here = frames(data.state, data.objects, data.names, robot)
        grasps = Grasps.of(data, here)
        copies: dict[str, list[NDArray[Any]]] = {}
        self._times = max(TIMES, math.ceil(ROWS / len(data.state)))
        for n in range(self._times):
            other = Otherwise.drawn(data, here, grasps, rng)
            objects = other.objects
            if n % EXACT:
                objects = with_pose_noise(objects, data.names, *POSE_NOISE, rng)
            told = data.state, objects, data.names, robot
            parts = {"x": features(*told)} | _arrays_of(frames(*told))
            parts |= {f"goals.{k}": part for k, part in vars(other.goals).items()}
            parts |= {f"held.{k}": part for k, part in vars(other.held).items()}
            for name, part in parts.items():
                copies.setdefault(name, []).append(part.astype(np.float32))
        self._told = {k: tensor(np.concatenate(parts)) for k, parts in copies.items()}
        self.labels = tensor(data.labels)
        self._mean, self._scale = (tensor(scale[key]) for key in ("y_mean", "y_scale"))
        self._chunks = tensor(data.chunks(HORIZON))
        self._carried, self._left = tensor(grasps.carried(KNOTS)), tensor(grasps.left)

    def error(self, net: Any, rows: Any) -> Any:
        """Error of the chunks of some rows, each told at random in one of the ways."""
        import torch

        told = torch.randint(self._times, rows.shape).to(rows.device)
        told = rows + told * len(self.labels)
        part = {name: column[told] for name, column in self._told.items()}
        x = part["x"] + NOISE * torch.randn(part["x"].shape).to(part["x"])
        said, carried = net(x, part["positions"], part["rotations"])
        goals, held = (
            Moves(*(part[f"{name}.{key}"] for key in ("turns", "ways", "centres")))
            for name in ("goals", "held")
        )
        labels = self.labels[self._chunks[rows]].unflatten(-1, (len(SIDES), -1))
        poses = moved(labels[..., :POSE], goals, held, self._left[rows])
        labels = torch.cat([poses, labels[..., POSE:]], -1).flatten(2)
        off = (said - (labels - self._mean) / self._scale).abs().mean()
        known = carried.gather(-1, self._carried[rows].flatten(1)[..., None])
        return off - KNOWN * known.clamp(min=UNLIKELY).log().mean()


def _arrays_of(here: Frames) -> dict[str, NDArray[np.float64]]:
    return {"positions": here.positions, "rotations": here.rotations}


def module(names: tuple[str, ...], scale: Mapping[str, Any]) -> Any:
    """The network, as PyTorch trains it, for object states of these names."""
    import torch
    from torch import nn

    things = len(SIDES) + len(bodies(names)) + 1
    inputs = len(scale["x_mean"]) + len(ways(names))

    class Block(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.norm, self.up = nn.LayerNorm(WIDTH), nn.Linear(WIDTH, WIDTH)
            self.down = nn.Linear(WIDTH, WIDTH)

        def forward(self, x: torch.Tensor) -> torch.Tensor:
            return x + self.down(nn.functional.gelu(self.up(self.norm(x))))

    class Net(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            parts = [nn.Linear(inputs, WIDTH), *(Block() for _ in range(BLOCKS))]
            self.body = nn.Sequential(*parts, nn.LayerNorm(WIDTH))
            moments = len(SIDES) * len(KNOTS)
            self.shares = nn.Linear(WIDTH, moments * things)
            self.carried = nn.Linear(WIDTH, moments * things)
            self.poses = nn.Linear(WIDTH, moments * VECTORS * things * 3)
            self.openings = nn.Linear(WIDTH, len(SIDES) * HORIZON)
            nn.init.zeros_(self.poses.bias)
            nothing = EMPTY * torch.eye(len(SIDES), things)
            nothing = nothing.repeat_interleave(len(KNOTS), 0)
            self.carried.bias = nn.Parameter(nothing.flatten())
            mean, size = (
                scale[key].reshape(len(SIDES), 1, -1)[..., :POSE]
                for key in ("y_mean", "y_scale")
            )
            constants = {"blend": blend().astype(np.float32), "mean": mean}
            constants |= {"size": size, "ways": ways(names)}
            constants |= {key: scale[key] for key in ("x_mean", "x_scale")}
            for name, value in constants.items():
                self.register_buffer(name, torch.from_numpy(value), persistent=False)

        def forward(self, x: Any, positions: Any, rotations: Any) -> tuple[Any, Any]:
            """Normal labels (B, 30, 20), and shares of what is carried (B, moments, things)."""
            rows = len(x)
            close = torch.tanh(x[:, self.ways] / CLOSE)
            x = ((x - self.x_mean) / self.x_scale).clamp(-FURTHEST, FURTHEST)
            x = torch.cat([x, close], -1)
            how = {"dtype": torch.bfloat16, "enabled": self.training}  # a third faster
            with torch.autocast(x.device.type, **how):
                seen = self.body(x)
                heads = self.shares, self.carried, self.poses, self.openings
                told = [head(seen) for head in heads]
            shares, carried, near, opens = (one.float() for one in told)
            shares, carried = (
                one.view(rows, -1, things).softmax(-1) for one in (shares, carried)
            )
            near = near.view(rows, -1, VECTORS, things, 3) * shares[:, :, None, :, None]
            back = rotations.transpose(2, 3).reshape(rows, things * 3, 3)
            vectors = (near.view(rows, -1, things * 3) @ back).view(
                rows, -1, VECTORS, 3
            )
            place = METRES * vectors[:, :, 0] + shares @ positions
            place = place + self.held(carried, vectors, positions, rotations)
            poses = torch.cat([place, vectors[:, :, 1], vectors[:, :, 2]], -1)
            poses = self.blend @ poses.view(rows, len(SIDES), len(KNOTS), POSE)
            poses = (poses - self.mean) / self.size
            opens = opens.view(rows, len(SIDES), HORIZON, 1)
            labels = torch.cat([poses, opens], -1).transpose(1, 2).flatten(2)
            return labels, carried

        def held(
            self, carried: Any, vectors: Any, positions: Any, rotations: Any
        ) -> Any:
            """How far a tool (B, moments, 3) is from what it carries, once that is there."""
            tools = slice(len(SIDES))
            away = positions[:, tools, None] - positions[:, None]  # (B, side, thing, 3)
            back = away @ rotations[:, tools]  # in the tool, in which it stays
            mean = carried.view(len(carried), len(SIDES), len(KNOTS), -1) @ back
            x, y = (nn.functional.normalize(vectors[:, :, n], dim=-1) for n in (1, 2))
            turned = torch.stack([x, y, torch.linalg.cross(x, y)], -1)
            return (turned @ mean.flatten(1, 2)[..., None])[..., 0]

    return Net()


class Network:
    """Plays a trained network."""

    sees = False
    """Whether it sees images."""

    def __init__(self, path: Path | None = None) -> None:
        """Read a file, or the one that the variable CHECKPOINT names.

        The variable GRIPPER names what is on the arms, where that is not what it learned with.
        """
        path = path or checkpoint()
        if path.is_dir() or not path.exists():
            raise PolicyError(
                f"There is no file of a network {path}; python network.py EXPORT bin_sort.npz "
                "trains one."
            )
        self._net = dict(np.load(path))
        if "about" not in self._net:
            raise PolicyError(
                f"{path} is no file of a network: python network.py EXPORT OUT trains one."
            )
        if "chosen" in self._net and not self.sees:
            raise PolicyError(
                f"{path} is of a network that sees images: play it as images:Images."
            )
        about = json.loads(str(self._net["about"]))
        if about.get("close") != CLOSE or "still" not in about:
            raise PolicyError(
                f"{path} is of an earlier state of this example, and would be played otherwise: "
                "train it again."
            )
        self.names = tuple(about["names"])
        self._hands = about["openings"], about["still"]
        self._ways = ways(self.names)
        self._columns = about["columns"]
        self._grippers = Grippers(*self._hands)
        gripper = about.get("gripper", DEFAULT_GRIPPER)
        self._robot = robot_with(os.environ.get("GRIPPER", gripper))
        self._blend = blend()
        self.metadata = PolicyMetadata(
            name="frames of things",
            cameras=(),
            object_state=True,
            action_mode=about["mode"],
            robot=other_robot(gripper, DEFAULT_MOUNT),
            horizon=HORIZON,
            version=hashlib.sha256(path.read_bytes()).hexdigest()[:16],
        )

    def reset(self, instruction: str, seed: int) -> None:  # noqa: ARG002
        """Begin an episode with open hands."""
        self._grippers = Grippers(*self._hands)

    def act(self, observation: Mapping[str, Any]) -> Rows:
        """The next chunk (30, 16)."""
        objects = observation["environment_state"][self._columns]
        return self.plan(observation["agent_pos"], objects)

    def plan(self, state: Rows, objects: Rows) -> Rows:
        """The next chunk (30, 16) of joints and openings (16,) and an object state (n,)."""
        now = state[None], objects[None], self.names, self._robot
        chunk = self.chunk(features(*now)[0], frames(*now))
        for label in chunk:
            self._grippers.switch(label)
        return to_actions(chunk)

    def chunk(self, seen: Rows, here: Frames) -> Rows:
        """Labels (30, 20) of the features (k,) and the frames of one state."""
        x = (seen - self._net["x_mean"]) / self._net["x_scale"]
        x = np.clip(x, -FURTHEST, FURTHEST)
        x = np.concatenate([x, np.tanh(seen[self._ways] / np.float32(CLOSE))])
        x = self._linear(x, "body.0")
        for number in range(1, BLOCKS + 1):
            inner = self._linear(
                self._norm(x, f"body.{number}.norm"), f"body.{number}.up"
            )
            x = x + self._linear(_gelu(inner), f"body.{number}.down")
        x = self._norm(x, f"body.{BLOCKS + 1}")
        moments, things = len(SIDES) * len(KNOTS), here.positions.shape[1]
        shares, carried = (
            _softmax(self._linear(x, name).reshape(moments, things))
            for name in ("shares", "carried")
        )
        near = self._linear(x, "poses").reshape(moments, VECTORS, things, 3)
        vectors = np.einsum("mckj,mk,kij->mci", near, shares, here.rotations[0])
        vectors[:, 0] = METRES * vectors[:, 0] + shares @ here.positions[0]
        vectors[:, 0] += _held(carried, vectors, here)
        poses = self._blend @ vectors.reshape(len(SIDES), len(KNOTS), POSE)
        size, mean = (
            self._net[key].reshape(len(SIDES), 1, -1)[..., POSE:]
            for key in ("y_scale", "y_mean")
        )
        opens = (
            self._linear(x, "openings").reshape(len(SIDES), HORIZON, 1) * size + mean
        )
        chunk = np.concatenate([poses, opens], axis=-1).swapaxes(0, 1)
        return chunk.reshape(HORIZON, -1).astype(np.float32)

    def _linear(self, x: Rows, name: str) -> Rows:
        return x @ self._net[f"{name}.weight"].T + self._net[f"{name}.bias"]

    def _norm(self, x: Rows, name: str) -> Rows:
        x = (x - x.mean()) / np.sqrt(x.var() + 1e-5)
        return x * self._net[f"{name}.weight"] + self._net[f"{name}.bias"]


def _held(carried: Rows, vectors: Rows, here: Frames) -> NDArray[np.floating]:
    """How far a tool (moments, 3) is from what it carries, once that is there."""
    tools = slice(len(SIDES))
    positions, rotations = here.positions[0], here.rotations[0, tools]
    away = positions[tools, None] - positions
    back = np.einsum("sij,ski->skj", rotations, away)  # in the tool, in which it stays
    mean = carried.reshape(len(SIDES), len(KNOTS), -1) @ back
    x, y = (
        one / np.linalg.norm(one, axis=-1, keepdims=True)
        for one in (vectors[:, 1], vectors[:, 2])
    )
    turned = np.stack([x, y, np.cross(x, y)], axis=-1)
    return np.einsum("mij,mj->mi", turned, mean.reshape(-1, 3))


def _softmax(x: Rows) -> Rows:
    shares = np.exp(x - x.max(-1, keepdims=True))
    return shares / shares.sum(-1, keepdims=True)


_erf = np.vectorize(math.erf)


def _gelu(x: Rows) -> NDArray[np.floating]:
    return x * (1 + _erf(x / math.sqrt(2)).astype(np.float32)) / 2


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("export", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--episodes", type=int)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--device", default="cpu")
    asked = parser.parse_args()
    try:
        demonstrations = Demonstrations.load(asked.export, asked.episodes)
        how = Training(device=asked.device)
        print(train(demonstrations, asked.export.name, asked.out, asked.seed, how))
        forget(asked.out)
    except DuoBenchError as error:
        parser.exit(1, f"error: {error}\n")
