"""Policies that answer many episodes at a time: the state of an episode is not in the policy."""

from __future__ import annotations

import copy
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any, Literal, Protocol, get_args, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from duobench.errors import PolicyError
from duobench.policy.policy import PolicyMetadata, as_chunk

Observation = Mapping[str, Any]
Chunk = NDArray[np.float32]
BatchMode = Literal["fixed", "dynamic"]

MAX_BATCH = 8
"""Observations that are answered together, at most."""
NOISE_STREAM = 0x6E6F697365
"""Separates a policy's noise from everything else that is sampled with the same seed."""
_PADDING_SEED = 0
"""Seed of the sessions that fill a batch up; nobody sees what they sample."""


@dataclass(kw_only=True, slots=True)
class Session:
    """One episode of a policy; a subclass adds what else the policy remembers of it."""

    instruction: str
    """What to do, in words."""
    seed: int
    """Seed of whatever is sampled in it."""
    call: int = 0
    """Answers that were given in it; whoever calls `act_batch` counts them, not the policy."""


def noise(seed: int, call: int, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Standard normal noise for one answer: a pure function of its arguments.

    Neither the other episodes of a batch, nor the order in which observations arrive, nor a
    repeated request changes it.

    Args:
        seed: Seed that the episode was begun with: `Session.seed`.
        call: Number of the answer within the episode, from 0: `Session.call`.
        shape: Shape of the noise.
    """
    generator = np.random.default_rng((NOISE_STREAM, seed, call))
    return generator.standard_normal(shape, dtype=np.float32)


@runtime_checkable
class BatchPolicy(Protocol):
    """A policy that answers the observations of several episodes with one call of its model.

    All of its methods are called from one thread. It may also have `end(session)`, called once
    nobody will ask for a session any more, and `close()`.
    """

    @property
    def metadata(self) -> PolicyMetadata:
        """What the policy expects of the environment."""
        ...

    def begin(self, instruction: str, seed: int) -> Session:
        """Begin an episode, beside those that are under way.

        Args:
            instruction: What to do, in words.
            seed: Seed of whatever is sampled in it, which follows from seed and `call`; a hash of
                the seed of the layout, as in `Policy.reset`.

        Returns:
            All that is remembered of the episode; small.
        """
        ...

    def act_batch(
        self, sessions: Sequence[Any], observations: Sequence[Any]
    ) -> Sequence[ArrayLike] | NDArray[Any]:
        """Decide on the next actions in each episode.

        Args:
            sessions: What `begin` returned, one for each observation. A session is changed only
                when nothing can fail any more: after an error, each is answered again by itself.
            observations: As in `Policy.act`, one for each session.

        Returns:
            One chunk of actions (H, n) for each session, in their order.
        """
        ...


@dataclass(frozen=True, kw_only=True, slots=True)
class Batching:
    """How many observations are answered together."""

    mode: BatchMode = "fixed"
    """ "fixed" fills every batch up to `size`, so that an answer does not depend on how many others
    were waiting; "dynamic" takes what is there, which is faster."""
    size: int = MAX_BATCH
    """Most observations in a batch."""

    def __post_init__(self) -> None:
        """Reject other modes and sizes."""
        if self.mode not in get_args(BatchMode):
            raise PolicyError(f"A batch is 'fixed' or 'dynamic', got {self.mode!r}.")
        if self.size < 1:
            raise PolicyError(f"A batch has at least one observation, got {self.size}.")


def answer(
    policy: BatchPolicy,
    sessions: Sequence[Session],
    observations: Sequence[Observation],
    batching: Batching,
) -> list[Chunk]:
    """Have a policy answer, and count the answers.

    Args:
        policy: The policy.
        sessions: At least one and at most `batching.size` sessions.
        observations: One for each; the policy gets copies, which it may change.
        batching: A fixed batch is filled up with the first observation in sessions of its own.

    Returns:
        One chunk (H, n) for each session.

    Raises:
        PolicyError: If it does not return one chunk of finite numbers for each session.
    """
    missing = batching.size - len(sessions) if batching.mode == "fixed" else 0
    shown = [*observations, *[observations[0]] * missing]
    seen = [copy.deepcopy(dict(observation)) for observation in shown]
    filled = list(sessions)
    with ExitStack() as padding:
        for _ in range(missing):
            filled.append(begin(policy, sessions[0].instruction, _PADDING_SEED))
            padding.callback(end, policy, filled[-1])
        if len(set(map(id, filled))) < len(filled):
            raise PolicyError("`begin` returned one session twice; each episode has its own.")
        chunks = _listed(policy.act_batch(filled, seen))
        if len(chunks) != len(filled):
            raise PolicyError(
                f"A policy was asked for {len(filled)} chunks and returned {len(chunks)}."
            )
        checked = [as_chunk(chunk, width=None) for chunk in chunks[: len(sessions)]]
    for session in sessions:
        session.call += 1
    return checked


def _listed(chunks: Any) -> list[Any]:
    """The chunks that `act_batch` returned, whatever they are in."""
    if isinstance(chunks, Iterable) and not isinstance(chunks, Mapping):
        return list(chunks)
    raise PolicyError(
        f"`act_batch` returned a {type(chunks).__name__}; it returns a list or an array with one "
        "chunk of actions (H, n) for each session."
    )


def begin(policy: BatchPolicy, instruction: str, seed: int) -> Session:
    """Begin an episode.

    Raises:
        PolicyError: If the policy returns no new session.
    """
    session = policy.begin(instruction, seed)
    if not isinstance(session, Session):
        raise PolicyError(
            f"`begin` returned a {type(session).__name__}; it returns a duobench.policy.Session or "
            "an instance of a subclass."
        )
    if session.call:
        raise PolicyError(
            f"`begin` returned a session with {session.call} answers already; each episode has a "
            "new one."
        )
    return session


def end(policy: BatchPolicy, session: Session) -> None:
    """Tell a policy that wants to know that a session is over."""
    getattr(policy, "end", lambda _session: None)(session)


class SessionPolicy:
    """A batch policy as a plain one, which plays one episode at a time."""

    def __init__(self, policy: BatchPolicy, batching: Batching) -> None:
        """Wrap a policy.

        Args:
            policy: The policy.
            batching: Like everywhere else: a fixed batch is filled up here too.
        """
        self._policy = policy
        self._batching = batching
        self._session: Session | None = None
        self.metadata = policy.metadata
        """That of the policy."""

    def reset(self, instruction: str, seed: int) -> None:
        """Begin an episode, and end the one before."""
        last, self._session = self._session, None
        if last is not None:
            end(self._policy, last)
        self._session = begin(self._policy, instruction, seed)

    def act(self, observation: Observation) -> Chunk:
        """The next actions (H, n).

        Raises:
            PolicyError: If `reset` was not called, or the answer is no chunk.
        """
        if self._session is None:
            raise PolicyError("A policy is reset before it acts.")
        return answer(self._policy, [self._session], [observation], self._batching)[0]

    @property
    def intended_action(self) -> ArrayLike | None:
        """What a plain policy in it wanted its last action to be, if it has disturbed it."""
        return getattr(self._session, "intended", None)

    def close(self) -> None:
        """Close the policy."""
        getattr(self._policy, "close", lambda: None)()
