"""Plain policies beside each other: one object for each episode under way, never shared."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass

from numpy.typing import ArrayLike

from duobench.errors import PolicyError
from duobench.policy.batch import Observation, Session
from duobench.policy.policy import Policy


@dataclass(kw_only=True, slots=True)
class _PlainSession(Session):
    policy: Policy


class PolicyPool:
    """Plain policies as a batch policy: each episode under way has an object for itself."""

    def __init__(self, first: Policy, make: Callable[[], Policy], size: int) -> None:
        """Begin with one object; more are made when more episodes are played side by side.

        Args:
            first: A policy that plays no episode.
            make: Makes another one.
            size: Most objects at a time.
        """
        self._make = make
        self._size = size
        self._all = [first]
        self._idle = [first]
        self.metadata = first.metadata
        """What the policies expect."""

    def begin(self, instruction: str, seed: int) -> Session:
        """Begin an episode with an object that no other episode has.

        Raises:
            PolicyError: If all objects are playing.
        """
        if not self._idle and len(self._all) == self._size:
            raise PolicyError(
                f"This policy keeps the state of an episode in itself, and {self._size} objects of "
                "it are playing, as many as it may have. Wait until one of them is done."
            )
        if not self._idle:
            self._idle.append(self._make())
            self._all.append(self._idle[-1])
        policy = self._idle[-1]
        policy.reset(instruction, seed)
        self._idle.pop()
        return _PlainSession(instruction=instruction, seed=seed, policy=policy)

    def act_batch(
        self, sessions: Sequence[_PlainSession], observations: Sequence[Observation]
    ) -> list[ArrayLike]:
        """Ask one object after the other."""
        return [
            session.policy.act(observation)
            for session, observation in zip(sessions, observations, strict=True)
        ]

    def end(self, session: _PlainSession) -> None:
        """Take the object of an episode back."""
        self._idle.append(session.policy)

    def close(self) -> None:
        """Close all objects, also those whose episodes nobody has ended."""
        with ExitStack() as closing:
            for policy in self._all:
                closing.callback(getattr(policy, "close", lambda: None))
