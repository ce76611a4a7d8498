"""A task on the bench: build a state or act through a script, and see which stage is reached."""

from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from duobench.core.spatial import SE3
from duobench.core.types import CONTROL_HZ, Array, DuoCommand, Side
from duobench.tasks.experts.motion import Arms, Script
from duobench.tasks.stages.logic import Predicate
from duobench.tasks.stages.progress import Progress
from duobench.tasks.task import Task
from duobench.world.kinematics.inverse import Kinematics
from duobench.world.robot.frames import ROBOT, Robot
from duobench.world.sim import placement
from duobench.world.sim.layout import Layout
from duobench.world.sim.simulation import Simulation
from tests.predicate_probe import PredicateProbe

FAST = ("hinge_chest", "transfer_cube", "bin_sort")
"""Tasks whose whole episodes `make test` plays where all tasks have some."""


def marked(task: str, *values: object, name: str | None = None) -> Any:
    """A case of a test that plays whole episodes: slow, unless its task is one of few."""
    marks = () if task in FAST else (pytest.mark.long,)
    return pytest.param(task, *values, id=name or task, marks=marks)


MOVED = ("joints", "before", "openings", "targets", "freedom")
"""What a script changes in its arms."""


class TaskHarness:
    """One task with its simulation and its stage rule, without Gymnasium around it."""

    def __init__(self, task: Task, robot: Robot = ROBOT) -> None:
        self.task = task
        self.sim = Simulation(task.props, robot=robot)
        self.progress = Progress(task.stages)
        self.history: list[int] = []
        self._kinematics = Kinematics(robot)
        self._reached: dict[tuple[object, ...], Callable[[], None]] = {}
        self.start(0)

    def start(self, seed: int = 0, layout: Layout | None = None) -> Layout:
        """Reset to a seed's layout, or to a given one."""
        candidates = self.task.layouts(seed) if layout is None else iter([layout])
        # Through plain data, as an environment takes every layout.
        plain = (Layout.from_json(candidate.to_json()) for candidate in candidates)
        layout = placement.first_valid(self.sim, plain, self.task.id)
        self.sim.settle()
        self.progress.reset(self.sim, layout.variants)
        self.history = []
        self.arms = Arms(self.sim, self._kinematics)
        self._layout = layout
        return layout

    @property
    def stage(self) -> int:
        return self.progress.stage

    def put(self, **poses: SE3) -> None:
        """Build a state: props at poses, at rest, as no policy could; then judge it."""
        for name, pose in poses.items():
            self.sim.place(name, pose)
        self.sim.forward()
        self.judge()

    def judge(self) -> int:
        """Evaluate the stage rule on the state as it is."""
        self.history.append(self.progress.update(self.sim))
        return self.progress.stage

    def rest(self, steps: int) -> int:
        """Evaluate it for some control steps in which nothing changes."""
        for _ in range(steps):
            self.judge()
        return self.stage

    def push(self, prop: str, *velocity: float, first: int = 0) -> None:
        """Set a prop's velocity in m/s, then rad/s, from one of its six numbers on."""
        start = self.sim.model.joint(prop).dofadr[0] + first
        self.sim.data.qvel[start : start + len(velocity)] = velocity
        self.sim.forward()

    def hold(self, steps: int) -> int:
        """Let physics run with the arms where they were last told to be."""
        command = self.sim.duo.command()
        for _ in range(steps):
            self.sim.step(command)
            self.judge()
        return self.progress.stage

    def act(self, script: Callable[[Arms], Script], max_steps: int = 2000) -> int:
        """Run a script through the action space, judging every control step.

        What a script of a module has done from the start of an episode is taken up again.
        """

        def run() -> None:
            for _ in self.steps(script, max_steps=max_steps):
                pass

        self._once(script, None, run)
        return self.progress.stage

    def steps(
        self, script: Callable[[Arms], Script], *, then: int = 0, max_steps: int = 2000
    ) -> Iterator[int]:
        """Run a script through the action space, then wait for some steps; the stage after each."""
        for number, _ in enumerate(script(self.arms)):
            self.advance()
            yield self.stage
            if number >= max_steps:
                raise AssertionError(f"The script did not end within {max_steps} steps.")
        for _ in range(then):
            self.advance()
            yield self.stage

    def reach(self, script: Callable[[Arms], Script], stage: int) -> None:
        """Run a script until a stage is reached, whenever that is; fail if it never is.

        What a script of a module has reached from the start of an episode is taken up again.
        """
        self._once(script, stage, lambda: self.run_until(script, lambda: self.stage >= stage))

    def _once(
        self, script: Callable[[Arms], Script], stage: int | None, run: Callable[[], None]
    ) -> None:
        key = (repr(self._layout.to_json()), script, stage)
        named = not self.history and "<" not in getattr(script, "__qualname__", "<")
        if named and key in self._reached:
            self._reached[key]()
            return
        run()
        if named:
            self._reached[key] = self._saved()

    def _saved(self) -> Callable[[], None]:
        """Save the episode as it is now; what takes it up again."""
        physics, progress = self.sim.get_state(), self.progress.get_state()
        history = tuple(self.history)
        arms = {name: deepcopy(getattr(self.arms, name)) for name in MOVED}

        def take_up() -> None:
            self.sim.set_state(physics)
            self.progress.set_state(progress, self._layout.variants)
            self.history = list(history)
            for name, value in arms.items():
                setattr(self.arms, name, deepcopy(value))

        return take_up

    def run_until(self, script: Callable[[Arms], Script], met: Callable[[], bool]) -> None:
        """Run a script until a condition is met, whenever that is; fail if it never is."""
        assert any(met() for _ in self.steps(script)), f"never met; stage {self.stage} was reached"

    def run_for(self, script: Callable[[Arms], Script], steps: int) -> int:
        """Run a script for some control steps, or until the last stage."""
        for number, _ in enumerate(self.steps(script, then=steps), 1):
            if self.progress.success or number == steps:
                break
        return self.progress.stage

    def advance(self) -> None:
        """Send the arms' next action, and judge what came of it."""
        self.send(self.arms.action())

    def send(self, action: Array) -> None:
        """Send an action (16,), and judge what came of it."""
        # In float32, as a rollout does.
        action = np.asarray(action, dtype=np.float32)
        self.requested = action
        duo = self.sim.duo
        command = DuoCommand.from_flat(duo.clipped(action))
        if not self.sim.robot.gripper.takes_target(round(self.sim.data.time * CONTROL_HZ)):
            command = DuoCommand(joints=command.joints, openings=duo.command().openings)
        self.sim.step(command)
        self.judge()


@dataclass(frozen=True)
class Moments:
    """States of a task by letter, and what is so after a sequence of them."""

    bench: TaskHarness
    layout: Layout | None = None
    """That of the episode, if it is not the one of seed 0."""
    states: dict[str, Array] = field(default_factory=dict)

    def start(self) -> None:
        self.bench.start(layout=self.layout)

    def keep(self, letter: str) -> None:
        """Save the state as it is now."""
        self.states[letter] = self.bench.sim.get_state()

    def edit(self, letter: str, base: str, change: Callable[[Simulation], object]) -> None:
        """Save what a change makes of another one."""
        change(self.at(base))
        self.bench.sim.forward()
        self.keep(letter)

    def at(self, letter: str) -> Simulation:
        self.bench.sim.set_state(self.states[letter])
        return self.bench.sim

    def stage_after(self, *letters: str) -> int:
        self.start()
        for letter in "".join(letters):
            self.at(letter)
            self.bench.judge()
        return self.bench.stage

    def answer(
        self, letters: str, question: Predicate, before: Callable[[int], None] | None = None
    ) -> bool:
        """Whether a predicate holds at the end of a sequence, before each of which something may
        happen.
        """
        self.start()
        probe, yes = PredicateProbe(question, self.bench.sim), False
        for number, letter in enumerate(letters):
            if before:
                before(number)
            self.at(letter)
            yes = probe.ask()
        return yes


def set_hinge(sim: Simulation, hinge: str, angle: float, speed: float = 0.0) -> None:
    """Turn a lid or a door to an angle in radians, at a speed in rad/s."""
    joint = sim.model.joint(hinge)
    sim.data.qpos[joint.qposadr[0]] = angle
    sim.data.qvel[joint.dofadr[0]] = speed
    sim.forward()


def take_away(sim: Simulation, side: Side, state: Array) -> None:
    """Put one arm where it is in another state."""
    now = sim.data.qpos.copy()
    sim.set_state(state)
    there = sim.data.qpos.copy()
    sim.data.qpos[:] = now
    for joint in map(sim.model.joint, range(sim.model.njnt)):
        if joint.name.startswith(f"{side}/"):
            sim.data.qpos[joint.qposadr[0]] = there[joint.qposadr[0]]
    sim.forward()
