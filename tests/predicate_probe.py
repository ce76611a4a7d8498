"""A predicate asked one moment after another, with the memory that stages have."""

from duobench.tasks.stages.logic import Predicate
from duobench.tasks.stages.progress import Progress, Stage
from duobench.world.sim.simulation import Simulation


class PredicateProbe:
    """An episode whose only stage asks a question; it begins now."""

    def __init__(self, question: Predicate, sim: Simulation) -> None:
        self._sim = sim
        self._progress = Progress((Stage(name="asked", instruction="Do it.", holds=question),))
        self._progress.reset(sim, {})

    def ask(self) -> bool:
        """Whether it holds now."""
        self._progress.update(self._sim)
        return self._progress.final_holds
