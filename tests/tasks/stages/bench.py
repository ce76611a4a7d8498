"""Facts that a test switches on and off, and the progress of stages made of them."""

from __future__ import annotations

from collections.abc import Iterable

from duobench.tasks.stages.logic import Predicate
from duobench.tasks.stages.progress import Progress, Stage
from duobench.world.sim.simulation import Simulation


class Bench:
    """Facts that a test switches on and off, one letter each; a step is the facts that hold."""

    def __init__(self, sim: Simulation) -> None:
        self.sim = sim
        self.true: set[str] = set()
        self.asked: list[str] = []

    def fact(self, name: str) -> Predicate:
        def test(_moment: object) -> bool:
            self.asked.append(name)
            return name in self.true

        return Predicate(name, test)

    def begin(self, *constraints: Predicate, **variants: str) -> Progress:
        progress = Progress(
            tuple(Stage(name=p.name, instruction=f"do {p.name}", holds=p) for p in constraints)
        )
        progress.reset(self.sim, variants)
        return progress

    def play(self, progress: Progress, *steps: str) -> list[int]:
        """Stage after each step."""
        stages = []
        for step in steps:
            self.true = set(step)
            stages.append(progress.update(self.sim))
        return stages

    def answers(self, question: Predicate, steps: Iterable[str]) -> list[bool]:
        """Whether a predicate holds at each step of an episode."""
        progress, answers = self.begin(question), []
        for step in steps:
            self.play(progress, step)
            answers.append(progress.final_holds)
        return answers
