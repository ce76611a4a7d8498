"""What shows how far an evaluation or a recording is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, TypeVar

from duobench.results.run import Run

Played_contra = TypeVar("Played_contra", contravariant=True)
"""What there is of a finished episode: an `EpisodeRecord`, or an `Attempt` at a demonstration."""


class Observer(Protocol[Played_contra]):
    """Something that shows how far a run is."""

    def on_run_start(self, run: Run, finished: Sequence[Played_contra]) -> None:
        """The run begins, or goes on with some episodes already finished."""
        ...

    def on_episode(self, played: Played_contra) -> None:
        """One more episode is finished, and written."""
        ...
