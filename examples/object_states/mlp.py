"""The smallest policy that learns: a residual network from object states to chunks of tool poses.

Trained in half a minute on one core, with PyTorch; played with NumPy.

    python mlp.py exports/bin_sort bin_sort.npz --episodes 50 --seed 0
    CHECKPOINT=bin_sort.npz duobench eval --policy mlp:MLP --tasks bin_sort --out runs/mlp
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
    features,
    openings,
    to_actions,
)

from duobench.policy import PolicyMetadata

HORIZON, WIDTH, BLOCKS = 30, 256, 3
STEPS, BATCH, RATE, WARM_UP = 3000, 128, 1e-3, 100
FURTHEST, LEAST = 5.0, 1e-4
"""Inputs are no further from their mean than so many standard deviations of at least so much."""


def train(data: Demonstrations, out: Path, seed: int, steps: int = STEPS) -> float:
    """Train one network with Adam on the mean absolute error, and write it to a file.

    The action at the end of an episode is held, and counts, so that letting go is learned.

    Returns:
        The mean error of the last 100 steps, in standard deviations of the labels.
    """
    import torch
    from torch import nn

    class Block(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.norm, self.up = nn.LayerNorm(WIDTH), nn.Linear(WIDTH, WIDTH)
            self.down = nn.Linear(WIDTH, WIDTH)

        def forward(self, x: torch.Tensor) -> torch.Tensor:
            return x + self.down(nn.functional.gelu(self.up(self.norm(x))))

    torch.set_num_threads(1)
    torch.manual_seed(seed)
    seen = features(data.state, data.objects, data.names)
    scale = {"x_mean": seen.mean(0), "x_scale": seen.std(0) + LEAST}
    scale |= {"y_mean": data.labels.mean(0), "y_scale": data.labels.std(0) + 1e-3}
    x = torch.from_numpy(_normal(seen, scale))
    y = torch.from_numpy((data.labels - scale["y_mean"]) / scale["y_scale"])
    chunks, size = torch.from_numpy(data.chunks(HORIZON)), data.labels.shape[1]
    blocks = [Block() for _ in range(BLOCKS)]
    head = nn.Linear(WIDTH, HORIZON * size)
    net = nn.Sequential(nn.Linear(x.shape[1], WIDTH), *blocks, nn.LayerNorm(WIDTH), head)
    adam = torch.optim.AdamW(net.parameters(), lr=RATE, weight_decay=1e-4)
    rate = torch.optim.lr_scheduler.LambdaLR(
        adam, lambda k: min(1.0, (k + 1) / WARM_UP) * (1 + math.cos(math.pi * k / steps)) / 2
    )
    errors = []
    for _ in range(steps):
        rows = torch.randint(0, len(x), (BATCH,))
        error = (net(x[rows]).view(BATCH, HORIZON, size) - y[chunks[rows]]).abs().mean()
        adam.zero_grad()
        error.backward()
        adam.step()
        rate.step()
        errors.append(error.item())
    weights = {name: value.numpy() for name, value in net.state_dict().items()}
    about = {"names": data.names, "openings": openings(data.labels)}
    about |= {"mode": action_mode(data.labels)}
    np.savez(out, about=json.dumps(about), **scale, **weights)
    return float(np.mean(errors[-100:]))


def _normal(seen: Rows, scale: Mapping[str, Any]) -> Rows:
    return np.clip((seen - scale["x_mean"]) / scale["x_scale"], -FURTHEST, FURTHEST)


class MLP:
    """Plays a trained network."""

    def __init__(self) -> None:
        """Read the file that the variable CHECKPOINT names."""
        path = Path(os.environ["CHECKPOINT"])
        self._net = dict(np.load(path))
        about = json.loads(str(self._net["about"]))
        self._names, self._openings = tuple(about["names"]), about["openings"]
        self._grippers = Grippers(self._openings)
        self.metadata = PolicyMetadata(
            name="MLP",
            cameras=(),
            object_state=True,
            action_mode=about["mode"],
            horizon=HORIZON,
            version=hashlib.sha256(path.read_bytes()).hexdigest()[:16],
        )

    def reset(self, instruction: str, seed: int) -> None:  # noqa: ARG002
        """Begin an episode with open hands."""
        self._grippers = Grippers(self._openings)

    def act(self, observation: Mapping[str, Any]) -> Rows:
        """The next chunk (30, 16)."""
        state, objects = observation["agent_pos"][None], observation["environment_state"][None]
        x = self._linear(_normal(features(state, objects, self._names), self._net), "0")
        for number in range(1, BLOCKS + 1):
            inner = self._linear(self._norm(x, f"{number}.norm"), f"{number}.up")
            x += self._linear(_gelu(inner), f"{number}.down")
        y = self._linear(self._norm(x, f"{BLOCKS + 1}"), f"{BLOCKS + 2}")
        chunk = y.reshape(HORIZON, -1) * self._net["y_scale"] + self._net["y_mean"]
        for label in chunk:
            self._grippers.switch(label)
        return to_actions(chunk)

    def _linear(self, x: Rows, name: str) -> Rows:
        return x @ self._net[f"{name}.weight"].T + self._net[f"{name}.bias"]

    def _norm(self, x: Rows, name: str) -> Rows:
        x = (x - x.mean()) / np.sqrt(x.var() + 1e-5)
        return x * self._net[f"{name}.weight"] + self._net[f"{name}.bias"]


def _gelu(x: Rows) -> Rows:
    return x * (1 + np.vectorize(math.erf)(x / math.sqrt(2)).astype(np.float32)) / 2


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("export", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--episodes", type=int)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    print(train(Demonstrations.load(asked.export, asked.episodes), asked.out, asked.seed))
