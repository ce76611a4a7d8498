"""An episode as a page shows it: where everything was after each control step."""

from dataclasses import dataclass, field

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from duobench.envs.execution import Step
from duobench.envs.sim_env import sim_of
from duobench.evaluation.rollouts import Info, Observation, Watcher
from duobench.tasks.task import Task
from duobench.web import track
from duobench.web.geometry import Geometry
from duobench.world.looks.look import Look
from duobench.world.robot.cameras import View
from duobench.world.sim.simulation import Simulation


@dataclass(frozen=True, kw_only=True, slots=True)
class Trajectory:
    """One episode, with all that is shown of it."""

    task: str
    instruction: str
    stages: tuple[str, ...]
    """Names of the stages 1, 2, ..."""
    subinstructions: tuple[str, ...]
    """Instruction at stage 0, 1, ... for reaching the next one."""
    stage_changes: tuple[tuple[int, int], ...]
    """Pairs (control step, stage), as in `Record`."""
    scene: str
    scene_data: bytes = field(repr=False)
    track: bytes = field(repr=False)
    """Poses of the moving bodies, after 0, 1, ... control steps; see `web.track`."""
    note: str = ""
    corrections: tuple[tuple[int, int, str], ...] = ()
    """Stretches that a person led in the place of a policy; see `Recording.corrections`."""

    def poses(self) -> NDArray[np.float32]:
        """Poses (steps + 1, bodies, 7), in metres and w x y z."""
        return track.decode(self.track)

    def stage_after(self, step: int) -> int:
        """Highest stage after so many control steps."""
        return max(
            (stage for when, stage in self.stage_changes if when <= step), default=0
        )

    def next_after(self, step: int) -> str:
        """Return the instruction after so many control steps; empty once all is done."""
        stage = self.stage_after(step)
        return self.subinstructions[stage] if stage < len(self.subinstructions) else ""


class SceneCache:
    """The geometry of what is shown, made again only when it changes.

    Args:
        view: Where a page looks from at first; None is the task's overview.
    """

    _geometry: Geometry

    def __init__(self, view: View | None = None) -> None:
        self._view = view
        self._shown: object = None

    def of(self, simulation: Simulation, look: Look) -> Geometry:
        """The geometry of a simulation in its layout's variants, in a look."""
        wanted = (simulation, dict(simulation.variants), look)
        if self._shown != wanted:
            self._geometry = Geometry(simulation.model, look, self._view)
            self._shown = wanted
        return self._geometry


class TrajectoryRecorder(Watcher):
    """Watches an episode, and keeps its trajectory, with geometry of a cache in a look."""

    _simulation: Simulation
    _task: Task
    _geometry: Geometry

    def __init__(self, scenes: SceneCache, look: Look) -> None:
        self._scenes, self._look = scenes, look
        self._instruction, self._subinstructions = "", tuple[str, ...]()
        self._poses: list[NDArray[np.float32]] = []
        self._stage_changes: list[tuple[int, int]] = []

    def begin(
        self,
        simulation: Simulation,
        task: Task,
        instruction: str,
        subinstructions: tuple[str, ...],
    ) -> None:
        """Begin an episode, which the simulation shows already; nothing of it is kept yet."""
        self._simulation, self._task = simulation, task
        self._geometry = self._scenes.of(simulation, self._look)
        self._instruction, self._subinstructions = instruction, subinstructions

    def add(self, number: int, stage: int) -> None:
        """Keep the poses after a control step, and a stage that was newly reached."""
        self._poses.append(self._geometry.poses(self._simulation.data))
        if stage > (self._stage_changes[-1][1] if self._stage_changes else 0):
            self._stage_changes.append((number, stage))

    def on_episode_start(
        self,
        env: gym.Env,
        observation: Observation,  # noqa: ARG002 - the protocol's signature
        info: Info,
    ) -> None:
        """Keep the start."""
        duo = sim_of(env)
        subinstructions = tuple(text for _, text in sorted(duo.subinstructions.items()))
        self.begin(duo.simulation, duo.definition, info["instruction"], subinstructions)
        self.add(0, info.get("stage", 0))

    def on_step(self, step: Step) -> None:
        """Keep the state after a step."""
        self.add(step.number, step.info["stage"])

    def trajectory(self, note: str = "") -> Trajectory:
        """All of it so far."""
        return Trajectory(
            task=self._task.id,
            instruction=self._instruction,
            stages=tuple(stage.name for stage in self._task.stages),
            subinstructions=self._subinstructions,
            stage_changes=tuple(self._stage_changes),
            scene=self._geometry.name,
            scene_data=self._geometry.data,
            track=track.encode(np.array(self._poses)),
            note=note,
        )
