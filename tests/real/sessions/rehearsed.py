"""Three policies that play what experts do: to the end, until a seeded step, and badly."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, ClassVar

import numpy as np

from duobench.core.randomness import policy_seed
from duobench.core.types import OPENING_SLOTS, Array
from duobench.envs.action_modes import JOINT
from duobench.policy import PolicyMetadata
from duobench.real.sessions.recording import TEMPO, slowed
from tests.real.rigs import shown

MODULE = "tests.real.sessions.rehearsed"
CHUNK = 15
RAMP = 30
"""Control steps over which an arm is led into the table."""


class Expert:
    """Plays the commands of an expert, whatever happens."""

    commands: ClassVar[dict[int, Array]] = {}
    """Commands (n, 16) of episodes by the seed that a policy gets in them."""
    name = "expert"

    def __init__(self) -> None:
        self.metadata = PolicyMetadata(
            name=self.name, cameras=(), version="1", action_mode=JOINT.name
        )

    def reset(self, instruction: str, seed: int) -> None:
        assert instruction
        self._next = 0
        self.plan = self.changed(self.commands[seed].copy(), np.random.default_rng(seed))

    def act(self, observation: Mapping[str, Any]) -> Array:
        assert "agent_pos" in observation
        places = np.minimum(self._next + np.arange(CHUNK), len(self.plan) - 1)
        self._next += CHUNK
        return self.plan[places]

    def changed(self, commands: Array, random: np.random.Generator) -> Array:
        assert random
        return commands


class Cut(Expert):
    """Stops at a seeded step; in half of the episodes it opens its hands then."""

    name = "cut"

    def changed(self, commands: Array, random: np.random.Generator) -> Array:
        end = int(random.uniform(0.3, 0.9) * len(commands))
        commands = commands[: end + 1]
        if random.random() < 0.5:
            commands = np.vstack([commands, commands[-1:]])
            commands[-1, OPENING_SLOTS] = 1.0
        return commands


class Noisy(Expert):
    """Sways about the expert's way; in half of the episodes it leads an arm into the table."""

    name = "noisy"

    def changed(self, commands: Array, random: np.random.Generator) -> Array:
        joints = np.setdiff1d(np.arange(commands.shape[1]), OPENING_SLOTS)
        steps = np.arange(len(commands))[:, None]
        size = random.uniform(0.005, 0.04)
        periods = random.uniform(20.0, 90.0, len(joints))
        commands[:, joints] += size * np.sin(2.0 * np.pi * steps / periods)
        if random.random() < 0.5:
            start = int(random.uniform(0.3, 0.8) * len(commands))
            push = np.clip((steps[:, 0] - start) / RAMP, 0.0, 1.0)
            commands[:, int(random.choice([1, 9]))] += 0.8 * push
        return commands


POLICIES = tuple((f"{MODULE}:{each.__name__}", "real") for each in (Expert, Cut, Noisy))


def learn(task: str, seeds: Iterable[int]) -> int:
    """Have experts show their commands; the number of the longest ones."""
    seeds = tuple(seeds)
    learned = [slowed(commands, TEMPO) for commands, _ in shown(task, seeds)]
    Expert.commands.update(zip((policy_seed(task, seed) for seed in seeds), learned, strict=True))
    return max(map(len, learned))
