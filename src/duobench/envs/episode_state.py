"""The whole state of a running episode, as one value."""

import hashlib
import json
from dataclasses import asdict, dataclass
from typing import TypeVar

from duobench.core.errors import DuoBenchError
from duobench.core.spatial import SE3
from duobench.core.types import Array, Side
from duobench.tasks.shifts.samples import UNSCALED, PhysicsScale
from duobench.tasks.stages.progress import ProgressState
from duobench.world.looks.look import Look
from duobench.world.sim.layout import Layout

T = TypeVar("T")


class StateError(DuoBenchError):
    """A state does not fit the environment that is to continue from it."""


def required(part: T | None, wrapper: str) -> T:
    """A part of a state that a wrapper needs."""
    if part is None:
        raise StateError(
            f"This state was saved without the {wrapper} that this environment has; restore it in "
            "an environment that is made in the same way."
        )
    return part


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    eq=False,
)
class EpisodeState:
    """Everything that the rest of an episode depends on.

    Continuing from it is bit-exact in observations, stages, reward and info; noise of shifted
    sensors alone is new, and the same each time. Parts that belong to a wrapper are None where
    there is no such wrapper.
    """

    layout: Layout
    """Layout at the start; its variants decide which model is compiled."""
    physics: Array
    """Full state of the simulation (n,)."""
    scale: PhysicsScale = UNSCALED
    """Factors on the physics of the model, where an episode is shifted so."""
    instruction: str | None = None
    """The policy's; None is the task's own. No part of the hash: nothing moves by it."""
    look: Look | None = None
    """Look of images; None is the environment's own. No part of the hash either."""
    progress: ProgressState | None = None
    """Stage, and what its constraints remember."""
    steps: int | None = None
    """Control steps so far."""
    over: bool = False
    """Whether the episode has ended."""
    tool_targets: tuple[tuple[Side, SE3], ...] | None = None
    """Sum of relative Cartesian actions so far, by side."""

    @property
    def physics_hash(self) -> str:
        """SHA-256 over the physics alone."""
        return hashlib.sha256(self.physics.tobytes()).hexdigest()

    @property
    def progress_hash(self) -> str | None:
        """SHA-256 over the stage and what its constraints remember; None without stages."""
        if self.progress is None:
            return None
        text = json.dumps(asdict(self.progress), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()

    @property
    def hash(self) -> str:
        """SHA-256 over all of it but instruction and look; equal states, equal hashes."""
        digest = hashlib.sha256(self.physics.tobytes())
        targets = [
            (side, pose.tquat.tolist()) for side, pose in self.tool_targets or ()
        ]
        progress = None if self.progress is None else asdict(self.progress)
        rest = [self.layout.to_json(), progress, self.steps, self.over, targets]
        if self.scale != UNSCALED:
            rest.append(asdict(self.scale))
        digest.update(json.dumps(rest, sort_keys=True).encode())
        return digest.hexdigest()
