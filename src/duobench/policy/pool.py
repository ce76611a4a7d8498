"""Plain policies beside each other: one object for each episode under way, never shared."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from duobench.errors import PolicyError
from duobench.policy.batch import Observation, Session
from duobench.policy.policy import Policy


@dataclass(kw_only=True, slots=True)
class _PlainSession(Session):
    policy: Policy
    intended: ArrayLike | None = None
    """What the policy wanted its last action to be, if it has disturbed it."""


class PolicyPool:
    """Plain policies as a batch policy: each episode under way has an object for itself."""

    def __init__(
        self, first: Policy, make: Callable[[], Policy] | None = None, size: int = 1
    ) -> None:
        """Begin with one object; more are made when more episodes are played side by side.

        Args:
            first: A policy that plays no episode. If it stays the only one, Python's and NumPy's
                global generators get the seed of its episodes, for policies that use them.
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
        if not self._idle and (self._make is None or len(self._all) == self._size):
            raise PolicyError(
                f"This policy keeps the state of an episode in itself, and {self._size} objects of "
                "it are playing, as many as it may have. Wait until one of them is done."
            )
        if not self._idle and self._make is not None:
            self._idle.append(self._make())
            self._all.append(self._idle[-1])
        if self._size == 1:
            seed_global_generators(seed)
        policy = self._idle[-1]
        policy.reset(instruction, seed)
        self._idle.pop()
        return _PlainSession(instruction=instruction, seed=seed, policy=policy)

    def act_batch(
        self, sessions: Sequence[_PlainSession], observations: Sequence[Observation]
    ) -> list[ArrayLike]:
        """Ask one object after the other."""
        chunks = []
        for session, observation in zip(sessions, observations, strict=True):
            chunks.append(session.policy.act(observation))
            session.intended = getattr(session.policy, "intended_action", None)
        return chunks

    def end(self, session: _PlainSession) -> None:
        """Take the object of an episode back."""
        self._idle.append(session.policy)

    def close(self) -> None:
        """Close all objects, also those whose episodes nobody has ended."""
        with ExitStack() as closing:
            for policy in self._all:
                closing.callback(getattr(policy, "close", lambda: None))


def seed_global_generators(seed: int) -> None:
    """Give Python's and NumPy's global generators the seed of a policy's episode."""
    random.seed(seed)
    np.random.seed(seed)  # noqa: NPY002 - the generator that policies share
