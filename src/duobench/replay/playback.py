"""An episode as a page shows it: where everything was after each control step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from duobench.envs.sim_env import sim_of
from duobench.looks.look import Look
from duobench.sim.simulation import Simulation
from duobench.web import track
from duobench.web.geometry import Geometry

if TYPE_CHECKING:
    from duobench.envs.execution import Step
    from duobench.evaluation.rollout import Info, Observation

StageChanges = tuple[tuple[int, int], ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class Playback:
    """One episode, with all that is shown of it."""

    task: str
    """Id of the task."""
    instruction: str
    """What is to be done."""
    stages: tuple[str, ...]
    """Names of the stages 1, 2, ..."""
    subinstructions: tuple[str, ...]
    """What to do at stage 0, 1, ... to reach the next one."""
    stage_changes: StageChanges
    """Pairs (control step, stage), as in `EpisodeRecord`."""
    scene: str
    """Name of the scene; see `Geometry.name`."""
    scene_data: bytes = field(repr=False)
    """The scene file."""
    track: bytes = field(repr=False)
    """Poses of the moving bodies, after 0, 1, ... control steps; see `web.track`."""
    note: str = ""
    """What there is to say about it."""

    def poses(self) -> NDArray[np.float32]:
        """Poses (steps + 1, bodies, 7), in metres and w x y z."""
        return track.decode(self.track)

    def stage_after(self, step: int) -> int:
        """Highest stage after so many control steps."""
        return max((stage for when, stage in self.stage_changes if when <= step), default=0)

    def next_after(self, step: int) -> str:
        """What is to be done next after so many control steps; empty once all is done."""
        stage = self.stage_after(step)
        return self.subinstructions[stage] if stage < len(self.subinstructions) else ""


class SceneCache:
    """The geometry of what is shown, made again only when it changes."""

    def __init__(self) -> None:
        """Begin without any."""
        self._shown: tuple[Simulation, Mapping[str, str], Look] | None = None
        self._geometry: Geometry | None = None

    def of(self, simulation: Simulation, look: Look) -> Geometry:
        """The geometry of a simulation in its layout's variants, in a look."""
        before = self._shown
        is_same = (
            before is not None and before[0] is simulation and before[1:] == _what(simulation, look)
        )
        if self._geometry is None or not is_same:
            self._geometry = Geometry(simulation.model, look)
            self._shown = (simulation, *_what(simulation, look))
        return self._geometry


def _what(simulation: Simulation, look: Look) -> tuple[Mapping[str, str], Look]:
    return dict(simulation.variants), look


class PoseCollector:
    """Watches an episode, and keeps the poses after every control step."""

    def __init__(self, scenes: SceneCache, look: Look) -> None:
        """Collect with geometry of a cache, in a look."""
        self._scenes, self._look = scenes, look
        self._simulation: Simulation | None = None
        self._poses: list[NDArray[np.float32]] = []
        self.geometry: Geometry | None = None
        """What is shown, once the episode has begun."""
        self.subinstructions: tuple[str, ...] = ()
        """What to do at stage 0, 1, ... to reach the next one."""

    def on_episode_start(self, env: gym.Env, observation: Observation, info: Info) -> None:  # noqa: ARG002 - the protocol's signature
        """Keep the poses of the start."""
        base = sim_of(env)
        self._simulation = base.simulation
        self.geometry = self._scenes.of(base.simulation, self._look)
        self.subinstructions = tuple(text for _, text in sorted(base.subinstructions.items()))
        self._collect()

    def on_step(self, step: Step) -> None:  # noqa: ARG002 - the protocol's signature
        """Keep the poses after a step."""
        self._collect()

    def on_episode_end(self, error: BaseException | None) -> None:
        """Do nothing: what there was is shown."""

    def track(self) -> bytes:
        """All poses so far, packed."""
        return track.encode(np.array(self._poses))

    def _collect(self) -> None:
        if self.geometry is not None and self._simulation is not None:
            self._poses.append(self.geometry.poses(self._simulation.data))
