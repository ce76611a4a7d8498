"""Time limits: how long a policy may take for one answer, and for one episode."""

from dataclasses import dataclass

from duobench.errors import EvaluationError
from duobench.policy.serving.address import MAX_S

_ENDLESS_S = 1e9  # a limit in seconds that is as good as none, for JSON knows no infinity
_HEALTH_CHECK_S = 10.0  # seconds of a time limit that are kept for looking after a server


@dataclass(frozen=True, kw_only=True, slots=True)
class TimeLimits:
    """How long a policy may take; making it, with all its weights, has no limit."""

    act_timeout: float = 120.0
    """Seconds for one reset or one chunk of actions: minutes, for a first may compile a model."""
    episode_timeout: float = 1800.0
    """Seconds for an episode, looked at whenever the policy acts."""

    def __post_init__(self) -> None:
        if not (self.act_timeout > 0 and self.episode_timeout > 0):
            raise EvaluationError(
                f"Time limits are positive, got {self.act_timeout} s for an answer and "
                f"{self.episode_timeout} s for an episode."
            )
        object.__setattr__(self, "act_timeout", min(self.act_timeout, _ENDLESS_S))
        object.__setattr__(self, "episode_timeout", min(self.episode_timeout, _ENDLESS_S))

    @property
    def served_s(self) -> float:
        """Seconds for one answer of a served policy.

        The rest of `act_timeout` is for finding out whether a late server lives.
        """
        return min(max(self.act_timeout - _HEALTH_CHECK_S, self.act_timeout / 2), MAX_S)
