"""What a comparison is: policies, rows, and what tests say about any two runs."""

from __future__ import annotations

from dataclasses import dataclass

from duobench.results.comparison.entrants import Entrant, Group
from duobench.results.comparison.pairs import Pair
from duobench.results.comparison.rows import Row


@dataclass(frozen=True, kw_only=True, slots=True)
class Comparison:
    """What two or more policies are against each other."""

    entrants: tuple[Entrant, ...]
    """Column by column, group by group."""
    rows: tuple[Row, ...]
    """Rows, category by category."""
    pairs: tuple[Pair, ...]
    """What tests say about any two of them."""

    @property
    def groups(self) -> list[tuple[Group, list[Entrant]]]:
        """Every group that has a policy, with its policies."""
        each = [(group, [one for one in self.entrants if one.group is group]) for group in Group]
        return [(group, members) for group, members in each if members]

    def is_best(self, row: Row, entrant: Entrant) -> bool:
        """Whether tests say that a policy is better than every other of its group."""
        others = [
            one.key
            for one in self.entrants
            if one.group is entrant.group and one is not entrant and one.cell(row.tasks)
        ]
        beaten = {pair.loser(row) for pair in self.pairs if pair.winner(row) == entrant.key}
        return bool(others) and beaten.issuperset(others)
