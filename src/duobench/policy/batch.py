"""Policies that act in many episodes at a time: the state of an episode is not in the policy."""

import copy
from collections.abc import (
    Callable,
    Iterable,
    Iterator,
    Mapping,
    Sequence,
)
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial
from typing import (
    Any,
    Literal,
    Protocol,
    get_args,
    runtime_checkable,
)

import numpy as np
from numpy.typing import ArrayLike, NDArray

from duobench.core.errors import (
    MachineryError,
    PolicyError,
    PolicyFailedError,
    foreign_traceback,
    is_machinery,
)
from duobench.policy.generators import (
    MAKING_SEED,
    Noise,
    go_on_with,
    noise_now,
    seed_generators,
    tried,
)
from duobench.policy.policy import Policy, PolicyMetadata, as_chunk

Observation = Mapping[str, Any]
Chunk = NDArray[np.float32]
BatchMode = Literal["fixed", "dynamic"]

MAX_BATCH = 8
"""Default for the most observations in a batch."""
NOISE_STREAM = 0x6E6F697365
"""Separates a policy's noise from everything else that is sampled with the same seed."""
_PADDING_SEED = 0
"""Seed of the sessions that fill a batch up."""


@dataclass(kw_only=True, slots=True)
class Session:
    """One episode of a policy; a subclass adds what else the policy remembers of it."""

    instruction: str
    """Instruction in words."""
    seed: int
    """Seed of what is sampled in it."""
    call: int = 0
    """Chunks that were returned in it; counted by the caller of `act_batch`, not by the policy."""
    intended: ArrayLike | None = None
    """Action that the policy intended last, if it has disturbed it."""


def noise(
    seed: int,
    call: int,
    shape: tuple[int, ...],
) -> NDArray[np.float32]:
    """Standard normal noise for one chunk: a pure function of its arguments.

    Neither the other episodes of a batch, nor the order in which observations arrive, nor a
    repeated request changes it.

    Args:
        seed: Seed that the episode was begun with: `Session.seed`.
        call: Number of the chunk within the episode, from 0: `Session.call`.
        shape: Shape of the noise.
    """
    generator = np.random.default_rng((NOISE_STREAM, seed, call))
    return generator.standard_normal(shape, dtype=np.float32)


@runtime_checkable
class BatchPolicy(Protocol):
    """A policy that acts in several episodes with one call of its model.

    All of its methods are called from one thread. It may also have `end(session)`, called when
    a session is over, and `close()`.
    """

    @property
    def metadata(self) -> PolicyMetadata:
        """Expectations of the policy on the environment."""
        ...

    def begin(self, instruction: str, seed: int) -> Session:
        """Begin an episode, beside those that are under way.

        Args:
            instruction: What to do, in words.
            seed: Seed of what is sampled in it, which follows from seed and `call`; a hash of
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
                when nothing can fail any more: after an error, each is asked again by itself.
            observations: As in `Policy.act`, one for each session.

        Returns:
            One chunk of actions (H, n) for each session, in their order.
        """
        ...


@dataclass(frozen=True, kw_only=True, slots=True)
class Batching:
    """Number of observations in a batch."""

    mode: BatchMode = "fixed"
    """ "fixed" fills every batch up to `size`; "dynamic" takes what is there, which is faster."""
    size: int = MAX_BATCH
    """Most observations in a batch."""

    def __post_init__(self) -> None:
        if self.mode not in get_args(BatchMode):
            raise PolicyError(f"A batch is 'fixed' or 'dynamic', got {self.mode!r}.")
        if self.size < 1:
            raise PolicyError(f"A batch has at least one observation, got {self.size}.")


ONE_BY_ONE = Batching(mode="dynamic", size=1)
"""Batches of a plain policy."""


def act_together(
    policy: BatchPolicy,
    sessions: Sequence[Session],
    observations: Sequence[Observation],
    batching: Batching,
) -> list[Chunk | PolicyError]:
    """Return one chunk (H, n) for each of at most `batching.size` sessions, which count them.

    An invalid chunk is an error in its place: it is no fault of the other sessions, which
    the policy may have moved on. The policy gets copies of the observations, which it may change.
    A fixed batch is filled up with the first one, in sessions of its own.
    """
    missing = batching.size - len(sessions) if batching.mode == "fixed" else 0
    padded = [*observations, *[observations[0]] * missing]
    copies = [copy.deepcopy(dict(observation)) for observation in padded]
    filled = [*sessions]
    with ExitStack() as padding:
        for _ in range(missing):
            filled.append(begin(policy, sessions[0].instruction, _PADDING_SEED))
            padding.callback(end, policy, filled[-1])
        if len(set(map(id, filled))) < len(filled):
            raise PolicyError(
                "`begin` returned one session twice; each episode has its own."
            )
        given: Any = policy.act_batch(filled, copies)
        if isinstance(given, Mapping) or not isinstance(given, Iterable):
            raise PolicyError(
                f"`act_batch` returned a {type(given).__name__}; it returns a list or an array "
                "with one chunk of actions (H, n) for each session."
            )
        chunks = [*given]
        if len(chunks) != len(filled):
            raise PolicyError(
                f"A policy was asked for {len(filled)} chunks and returned {len(chunks)}."
            )
        checked = [_checked(chunk) for chunk in chunks[: len(sessions)]]
    for session, chunk in zip(sessions, checked, strict=True):
        session.call += not isinstance(chunk, PolicyError)
    return checked


def _checked(chunk: Any) -> Chunk | PolicyError:
    try:
        return as_chunk(chunk, width=None)
    except PolicyError as error:
        return error


def begin(
    policy: BatchPolicy,
    instruction: str,
    seed: int,
) -> Session:
    """Begin an episode, in a session that is new."""
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
    """Say that a session is over, if the policy has a method for that."""
    getattr(policy, "end", lambda _session: None)(session)


class SessionPolicy:
    """A batch policy as a plain one, which plays one episode at a time.

    Args:
        policy: The batch policy.
        batching: How its chunks are computed; a fixed batch is filled up here too.
        is_contained: Whether anything that the policy raises is a `PolicyFailedError` with its
            traceback, as it is from a policy in another process.
    """

    def __init__(
        self,
        policy: BatchPolicy,
        batching: Batching = ONE_BY_ONE,
        *,
        is_contained: bool = False,
    ) -> None:
        self._policy = policy
        self._batching = batching
        self._containing = contained if is_contained else nullcontext
        self._session: Session | None = None
        self.metadata = policy.metadata

    def reset(self, instruction: str, seed: int) -> None:
        """Begin an episode, and end the one before."""
        with self._containing():
            last, self._session = self._session, None
            if last is not None:
                end(self._policy, last)
            self._session = begin(self._policy, instruction, seed)

    def act(self, observation: Observation) -> Chunk:
        """Return the next actions (H, n).

        Raises:
            PolicyError: If `reset` was not called, or the policy returns no chunk.
        """
        with self._containing():
            if self._session is None:
                raise PolicyError("A policy is reset before it acts.")
            (chunk,) = act_together(
                self._policy, [self._session], [observation], self._batching
            )
            if isinstance(chunk, PolicyError):
                raise chunk
            return chunk

    @property
    def intended_action(self) -> ArrayLike | None:
        """Action that the policy intended last, if it has disturbed it."""
        return None if self._session is None else self._session.intended

    def close(self) -> None:
        """Close the policy."""
        getattr(self._policy, "close", lambda: None)()


@contextmanager
def contained() -> Iterator[None]:
    """Make anything that a policy raises in the block, `sys.exit` included, its failure."""
    try:
        yield
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        if is_machinery(error):
            raise
        raise PolicyFailedError(foreign_traceback(error)) from error


class PolicyPool:
    """Plain policies as a batch policy: each episode under way has an object for itself.

    Args:
        first: A policy that plays no episode. For policies that use global generators, these get
            the seed of each episode, and go on in each where they were; see `generators`.
        make: Makes another one, when more episodes are played side by side.
        size: Most objects at a time.
    """

    def __init__(
        self, first: Policy, make: Callable[[], Policy], size: int = 1
    ) -> None:
        self._make = make
        self.size = size
        self._all = [first]
        self._idle = [first]
        self._playing: dict[int, tuple[Policy, Noise]] = {}
        """Object of each session, by its id, and the states of the global generators in it."""
        self._known: set[int] = set()
        """Ids of the objects that have acted before."""
        self.metadata = first.metadata

    def begin(self, instruction: str, seed: int) -> Session:
        """Begin an episode with an object that no other episode has; an error if all play."""
        if not self._idle:
            if len(self._all) == self.size:
                raise MachineryError(
                    f"All {self.size} objects of this policy are playing."
                )
            seed_generators(MAKING_SEED)
            self._idle.append(self._make())
            self._all.append(self._idle[-1])
        policy = self._idle[-1]
        session = Session(instruction=instruction, seed=seed)
        if id(policy) not in self._known:
            tried(partial(policy.reset, instruction, seed))
        noise = _reset(policy, session)
        self._idle.pop()
        self._playing[id(session)] = policy, noise
        return session

    def act_batch(
        self, sessions: Sequence[Session], observations: Sequence[Observation]
    ) -> list[ArrayLike]:
        """Ask one object after the other."""
        chunks = []
        for session, observation in zip(sessions, observations, strict=True):
            policy, _ = self._playing[id(session)]
            act = self._act if id(policy) in self._known else self._first_act
            chunks.append(act(session, observation))
            self._known.add(id(policy))
            session.intended = getattr(policy, "intended_action", None)
        return chunks

    def _act(self, session: Session, observation: Observation) -> ArrayLike:
        policy, noise = self._playing[id(session)]
        seed_generators(session.seed)  # also those that are new since the last chunk
        go_on_with(noise)
        chunk = policy.act(observation)
        self._playing[id(session)] = policy, noise_now()
        return chunk

    def _first_act(self, session: Session, observation: Observation) -> ArrayLike:
        """Return the first chunk of an object; one that moves generators is made once more."""
        policy, _ = self._playing[id(session)]
        copied = copy.deepcopy(dict(observation))
        chunk, has_moved = tried(partial(policy.act, copied))
        if not has_moved:
            return chunk
        self._playing[id(session)] = policy, _reset(policy, session)
        return self._act(session, observation)

    def end(self, session: Session) -> None:
        """Take the object of an episode back."""
        policy, _ = self._playing.pop(id(session))
        self._idle.append(policy)

    def close(self) -> None:
        """Close all objects, also those whose episodes were not ended."""
        with ExitStack() as closing:
            for policy in self._all:
                closing.callback(getattr(policy, "close", lambda: None))


def _reset(policy: Policy, session: Session) -> Noise:
    seed_generators(session.seed)
    policy.reset(session.instruction, session.seed)
    return noise_now()
