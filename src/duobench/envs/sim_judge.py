"""The judge of a simulated episode: the task's constraints, asked of the simulation."""

from __future__ import annotations

from collections.abc import Callable

from duobench.sim.layout import Layout
from duobench.sim.simulation import Simulation
from duobench.stages.progress import Progress, ProgressState, check_names
from duobench.tasks.task import Task


class SimJudge:
    """Judges by the task's constraints, from the state of the simulation."""

    def __init__(self, task: Task, simulation: Simulation, layout: Callable[[], Layout]) -> None:
        """Check that the simulation and its layouts have everything that the stages name.

        Args:
            task: The task.
            simulation: The physics.
            layout: Gives the layout of the running episode.

        Raises:
            UnknownNameError: A stage names what is not there; near misses are listed.
            LayoutError: The task does not place all of its objects.
        """
        self._simulation, self._layout = simulation, layout
        sampled = next(task.layouts(0))
        task.instruct(sampled)
        task.subinstructions(sampled)
        options = {name: choice.options for name, choice in task.variants.items()}
        check_names(task.stages, simulation, sampled.variants, options)
        self._progress = Progress(task.stages)

    def begin(self) -> None:
        """Begin at stage 0, and remember where everything is."""
        self._progress.reset(self._simulation, self._layout().variants)

    def judge(self) -> None:
        """Evaluate the stage rule."""
        self._progress.update(self._simulation)

    @property
    def stage(self) -> int:
        """The highest stage so far."""
        return self._progress.stage

    @property
    def final_holds(self) -> bool:
        """Whether the last stage's constraints hold right now."""
        return self._progress.final_holds

    @property
    def unmet(self) -> tuple[str, ...]:
        """Why the next stage is not reached, in words, since `explain` asked for it."""
        return self._progress.unmet

    def explain(self, on: bool = True) -> None:
        """Say why, from the next step on, or stop it."""
        self._progress.explain(on)

    def get_state(self) -> ProgressState:
        """Stage and memories."""
        return self._progress.get_state()

    def set_state(self, state: ProgressState) -> None:
        """Continue from a state."""
        self._progress.set_state(state, self._layout().variants)
