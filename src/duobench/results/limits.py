"""Time limits: how long a policy may take for one answer, and for one episode."""

from __future__ import annotations

from dataclasses import dataclass

from duobench.errors import EvaluationError
from duobench.policy.serving.address import MAX_S

_ENDLESS_S = 1e9
"""A limit in seconds that is as good as none, for JSON knows no infinity."""
_HEALTH_CHECK_S = 10.0
"""Seconds of a time limit that are kept for looking after a server."""


@dataclass(frozen=True, kw_only=True, slots=True)
class TimeLimits:
    """How long a policy may take; making it, with all its weights, has no limit."""

    act_s: float = 120.0
    """Seconds for one `reset` or one `act`: minutes, because a first answer may compile a model."""
    episode_s: float = 1800.0
    """Seconds for an episode; it is checked whenever the policy acts."""

    def __post_init__(self) -> None:
        """Reject limits that are not positive; infinite ones become very long."""
        if not (self.act_s > 0 and self.episode_s > 0):
            raise EvaluationError(
                f"Time limits are positive, got {self.act_s} s for an answer and {self.episode_s} "
                "s for an episode."
            )
        object.__setattr__(self, "act_s", min(self.act_s, _ENDLESS_S))
        object.__setattr__(self, "episode_s", min(self.episode_s, _ENDLESS_S))

    @property
    def served_s(self) -> float:
        """Seconds for one answer of a served policy.

        It is less than `act_s`: the rest is for finding out whether a late server still lives.
        """
        return min(max(self.act_s - _HEALTH_CHECK_S, self.act_s / 2), MAX_S)
