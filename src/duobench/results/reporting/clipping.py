"""How often limits of the arms changed what a policy wanted to send."""

from __future__ import annotations

from dataclasses import dataclass

from duobench.results.metrics import TaskResult


@dataclass(frozen=True, kw_only=True, slots=True)
class Clipping:
    """How often that was, in the episodes of a task whose records know it."""

    steps: int
    """Control steps at which limits changed a number of the command."""
    all_steps: int
    """All control steps."""
    episodes: int
    """Episodes with such a step."""
    all_episodes: int
    """All episodes."""


def clipping(result: TaskResult) -> Clipping | None:
    """How often limits changed commands of a task; None if no record knows it."""
    known = [
        (record.clipped, record.steps) for record in result.records if record.clipped is not None
    ]
    if not known:
        return None
    return Clipping(
        steps=sum(clipped for clipped, _ in known),
        all_steps=sum(steps for _, steps in known),
        episodes=sum(clipped > 0 for clipped, _ in known),
        all_episodes=len(known),
    )
