import random
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Any

import numpy as np
import pytest

from duobench.core.errors import MachineryError, PolicyError
from duobench.policy import (
    Batching,
    BatchPolicy,
    PolicyMetadata,
    Session,
    SessionPolicy,
    inference as inference_module,
    noise,
)
from duobench.policy.batch import ONE_BY_ONE, PolicyPool, answer
from duobench.policy.inference import BusyError, InferenceLoop
from duobench.policy.serving.host import make_served

OBSERVATION = {"agent_pos": np.zeros(16, np.float32)}
TIMEOUT_S = 30
WIDTH = 64


class Network:
    """A small random network over proprioception and noise; rows depend on the batch's size."""

    metadata = PolicyMetadata(name="network", horizon=2)

    def __init__(self) -> None:
        generator = np.random.default_rng(0)
        self._first = generator.standard_normal((48, WIDTH), dtype=np.float32)
        self._second = generator.standard_normal((WIDTH, 32), dtype=np.float32)
        self.sizes: list[int] = []

    def begin(self, instruction: str, seed: int) -> Session:
        return Session(instruction=instruction, seed=seed)

    def act_batch(
        self, sessions: Sequence[Session], observations: Sequence[dict[str, Any]]
    ) -> np.ndarray:
        self.sizes.append(len(sessions))
        drawn = np.stack([noise(session.seed, session.call, (32,)) for session in sessions])
        seen = np.stack([observation["agent_pos"] for observation in observations])
        for observation in observations:
            observation["agent_pos"] *= np.nan  # what it gets belongs to it
        hidden = np.tanh(np.hstack([seen, drawn]) @ self._first)
        return (hidden @ self._second).reshape(-1, 2, 16)


class Refuses(Network):
    """Cannot answer an observation of ones, alone or in a batch."""

    def act_batch(
        self, sessions: Sequence[Session], observations: Sequence[dict[str, Any]]
    ) -> np.ndarray:
        if any(observation["agent_pos"][0] == 1 for observation in observations):
            raise ZeroDivisionError("ones")
        return super().act_batch(sessions, observations)


Start = Callable[..., InferenceLoop]


@pytest.fixture
def start() -> Iterator[Start]:
    """Runs a loop in a thread, as long as the test lasts."""
    running: list[InferenceLoop] = []

    def run(policy: BatchPolicy | InferenceLoop, **batching: Any) -> InferenceLoop:
        is_loop = isinstance(policy, InferenceLoop)
        running.append(policy if is_loop else InferenceLoop(policy, Batching(**batching)))
        threading.Thread(target=running[-1].run, daemon=True).start()
        return running[-1]

    yield run
    for loop in running:
        loop.stop()


@contextmanager
def threads(*targets: Callable[[], Any]) -> Iterator[None]:
    """Runs functions in threads until the block has ended and they have, too."""
    running = [threading.Thread(target=target, daemon=True) for target in targets]
    for thread in running:
        thread.start()
    yield
    for thread in running:
        thread.join(TIMEOUT_S)


def observations(seed: int, count: int = 6) -> list[dict[str, Any]]:
    drawn = np.random.default_rng(seed).standard_normal((count, 16), dtype=np.float32)
    return [{"agent_pos": row} for row in drawn]


def played(loop: InferenceLoop, seed: int) -> bytes:
    """All chunks of an episode of six calls."""
    session = loop.begin("Do it.", seed).result(TIMEOUT_S)
    return b"".join(
        loop.act(session, observation).result(TIMEOUT_S).tobytes()
        for observation in observations(seed)
    )


def test_noise_follows_from_seed_and_call_alone() -> None:
    first = noise(3, 0, (5, 2))
    assert first.dtype == np.float32
    np.testing.assert_array_equal(first, noise(3, 0, (5, 2)))
    assert not np.array_equal(first, noise(3, 1, (5, 2)))
    assert not np.array_equal(first, noise(4, 0, (5, 2)))
    assert abs(float(noise(0, 0, (10_000,)).std()) - 1) < 0.05


def test_fixed_batches_give_the_same_bits_however_many_wait(start: Start) -> None:
    alone = SessionPolicy(Network(), Batching(size=4))
    expected = {}
    for seed in range(8):
        alone.reset("Do it.", seed)
        chunks = [alone.act(observation) for observation in observations(seed)]
        expected[seed] = b"".join(chunk.tobytes() for chunk in chunks)
    assert len(set(expected.values())) == 8
    policy, results = Network(), dict[int, bytes]()
    loop = start(policy, size=4)

    def play(seed: int) -> None:
        results[seed] = played(loop, seed)

    with threads(*(partial(play, seed) for seed in range(8))):
        pass
    assert results == expected
    assert set(policy.sizes) == {4}


def test_dynamic_batches_hold_what_waits_and_no_more_than_fits(start: Start) -> None:
    policy, held = Network(), threading.Event()
    loop = start(policy, mode="dynamic", size=3)
    sessions = [loop.begin("Do it.", seed).result(TIMEOUT_S) for seed in range(5)]
    begin = policy.begin
    policy.begin = lambda *words: held.wait() and begin(*words)  # type: ignore[method-assign]
    loop.begin("Hold the loop.", 0)
    futures = [loop.act(session, OBSERVATION) for session in sessions]
    assert futures[1].cancel()
    held.set()
    assert all(future.result(TIMEOUT_S).any() for future in futures if not future.cancelled())
    assert policy.sizes == [3, 1]
    assert [session.call for session in sessions] == [1, 0, 1, 1, 1]


Pair = tuple[InferenceLoop, Network, list[Session]]


@pytest.fixture
def pair(start: Start, monkeypatch: pytest.MonkeyPatch) -> Pair:
    """A loop that waits as long as a test may take, and two sessions that it answered together."""
    monkeypatch.setattr(inference_module, "PATIENCE", float("inf"))
    monkeypatch.setattr(inference_module, "LONGEST_WAIT_S", 2.0 * TIMEOUT_S)
    policy = Network()
    loop = InferenceLoop(policy, Batching(mode="dynamic", size=8))
    sessions = [Session(instruction="Do it.", seed=seed) for seed in range(2)]
    futures = [loop.act(session, OBSERVATION) for session in sessions]
    start(loop)
    for future in futures:
        future.result(TIMEOUT_S)
    assert policy.sizes == [2]
    return loop, policy, sessions


def test_batch_waits_for_the_episodes_of_the_last_one(pair: Pair) -> None:
    loop, policy, (first, second) = pair
    early = loop.act(first, OBSERVATION)
    loop.begin("Begin meanwhile.", 2).result(TIMEOUT_S)
    assert not early.done()
    loop.act(second, OBSERVATION).result(TIMEOUT_S)
    early.result(TIMEOUT_S)
    assert policy.sizes == [2, 2]


def test_nobody_waits_for_an_episode_that_is_over(pair: Pair) -> None:
    loop, policy, (first, second) = pair
    early = loop.act(first, OBSERVATION)
    loop.end(second)
    early.result(TIMEOUT_S)
    assert policy.sizes == [2, 1]


def test_wait_for_a_silent_episode_ends(pair: Pair, monkeypatch: pytest.MonkeyPatch) -> None:
    loop, policy, (first, second) = pair
    monkeypatch.setattr(inference_module, "LONGEST_WAIT_S", 0.01)
    for future in [loop.act(session, OBSERVATION) for session in (first, second)]:
        future.result(TIMEOUT_S)
    loop.act(first, OBSERVATION).result(TIMEOUT_S)
    assert policy.sizes == [2, 2, 1]


def test_bad_observation_fails_alone_and_changes_no_other(start: Start) -> None:
    good = played(start(Network(), size=4), seed=1)
    loop, stop, reasons = start(Refuses(), size=4), threading.Event(), set[str]()

    def disturb() -> None:
        session = loop.begin("Do it.", 2).result(TIMEOUT_S)
        while not (reasons and stop.is_set()):
            error = loop.act(session, {"agent_pos": np.ones(16, np.float32)}).exception(TIMEOUT_S)
            assert isinstance(error, PolicyError)
            reasons.add(str(error))

    with threads(disturb, disturb):
        found = played(loop, seed=1)
        stop.set()
    assert found == good
    (reason,) = reasons
    assert reason.endswith("ZeroDivisionError: ones")


def test_too_many_requests_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inference_module, "MAX_WAITING", 2)
    loop = InferenceLoop(Network(), Batching())
    waiting = [loop.begin("Do it.", 0) for _ in range(2)]
    with pytest.raises(BusyError, match="2 requests waiting"):
        loop.begin("Do it.", 0)
    loop.stop()
    loop.run()
    assert all(future.cancelled() for future in waiting)
    with pytest.raises(BusyError, match="has ended"):
        loop.act(Session(instruction="", seed=0), OBSERVATION)


@pytest.mark.parametrize(
    ("returned", "message"),
    [
        (np.zeros((3, 2, 16)), "asked for 2 chunks and returned 3"),
        (np.zeros((2, 16)), r"shape \(H, n\)"),
        (np.full((2, 1, 16), np.nan), "returned nan"),
        (["left", "right"], "array of numbers"),
        (None, "returned a NoneType; it returns a list or an array"),
        ({0: [[0.0]], 1: [[0.0]]}, "returned a dict"),
        (iter([[[0.0]]]), "asked for 2 chunks and returned 1"),
        (np.full(2, None), "shape"),
    ],
)
def test_answer_that_is_no_chunks_is_refused(returned: Any, message: str) -> None:
    policy = Network()
    policy.act_batch = lambda *_: returned  # type: ignore[method-assign]
    sessions = [policy.begin("Do it.", seed) for seed in (0, 1)]
    with pytest.raises(PolicyError, match=message):  # noqa: PT012 - all of it, or each chunk
        for each in answer(policy, sessions, [OBSERVATION] * 2, Batching(mode="dynamic")):
            assert isinstance(each, PolicyError)
            raise each
    assert [session.call for session in sessions] == [0, 0]


class Spoils(Network):
    """Answers with how often a session was answered; where it sees ones, with what is no number."""

    def act_batch(
        self, sessions: Sequence[Session], observations: Sequence[dict[str, Any]]
    ) -> np.ndarray:
        for session in sessions:
            session.instruction += "."
        chunks = [np.full((1, 16), len(session.instruction), float) for session in sessions]
        for chunk, observation in zip(chunks, observations, strict=True):
            chunk[0, observation["agent_pos"] == 1] = np.nan
        return np.stack(chunks)


def together(
    loop: InferenceLoop, busy: threading.Event, *asked: tuple[Session, dict[str, Any]]
) -> list[Any]:
    """What is answered to observations that all wait while the loop is busy: chunk or error."""
    busy.clear()
    free = loop.begin("wait", 9)
    futures = [loop.act(session, observation) for session, observation in asked]
    busy.set()
    loop.end(free.result(TIMEOUT_S))
    return [future.exception(TIMEOUT_S) or future.result() for future in futures]


ONES = {"agent_pos": np.ones(16, np.float32)}


def test_chunk_that_is_none_makes_nobody_be_answered_twice(start: Start) -> None:
    policy, busy = Spoils(), threading.Event()
    policy.begin = partial(_begun, busy)  # type: ignore[method-assign]
    loop = start(policy, mode="dynamic", size=2)
    good, bad = (loop.begin("", seed).result(TIMEOUT_S) for seed in (0, 1))
    seen: list[float] = []
    for number in range(4):
        ones = ONES if number == 1 else OBSERVATION
        chunk, other = together(loop, busy, (good, OBSERVATION), (bad, ones))
        seen.append(chunk[0, 0])
        assert isinstance(other, PolicyError) == (number == 1)
    assert seen == [1, 2, 3, 4]


def _begun(busy: threading.Event, instruction: str, seed: int) -> Session:
    assert not instruction or busy.wait(TIMEOUT_S)
    return Session(instruction="", seed=seed)


class Remembers:
    """A plain policy that answers with how often it was asked; ones break it."""

    metadata = PolicyMetadata(name="remembers")

    busy = threading.Event()

    def reset(self, instruction: str, seed: int) -> None:  # noqa: ARG002 - as policies have it
        assert not instruction or self.busy.wait(TIMEOUT_S)
        self._asked = 0

    def act(self, observation: dict[str, Any]) -> np.ndarray:
        if observation["agent_pos"][0] == 1:
            raise ZeroDivisionError
        self._asked += 1
        return np.full((1, 16), self._asked, float)


def test_served_plain_policy_is_asked_once_for_what_another_episode_breaks_at(start: Start) -> None:
    made, _, batching = make_served(f"{__name__}:Remembers", Batching(mode="dynamic", size=3))
    loop = start(InferenceLoop(made, batching))
    good, bad = (loop.begin("", seed).result(TIMEOUT_S) for seed in (0, 1))
    asked = [together(loop, Remembers.busy, (good, OBSERVATION), (bad, ONES)) for _ in range(3)]
    assert [chunk[0, 0] for chunk, _ in asked] == [1, 2, 3]
    assert all(isinstance(error, PolicyError) for _, error in asked)


def test_session_of_another_kind_is_refused() -> None:
    policy = Network()
    policy.begin = lambda *_: 3  # type: ignore[method-assign,assignment]
    with pytest.raises(PolicyError, match=r"returned a int.*duobench\.policy\.Session"):
        SessionPolicy(policy, Batching()).reset("Do it.", 0)


class Ends(Network):
    """Notes which sessions are under way."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[Session] = []

    def begin(self, instruction: str, seed: int) -> Session:
        self.open.append(super().begin(instruction, seed))
        return self.open[-1]

    def end(self, session: Session) -> None:
        self.open.remove(session)


def test_padding_is_ended_also_where_the_policy_fails() -> None:
    policy = Ends()
    session = policy.begin("Do it.", 0)
    policy.act_batch = lambda *_: 1 / 0  # type: ignore[method-assign]
    with pytest.raises(ZeroDivisionError):
        answer(policy, [session], [OBSERVATION], Batching(size=4))
    assert policy.open == [session]


def test_session_that_two_episodes_would_share_is_refused() -> None:
    policy, only = Network(), Session(instruction="Do it.", seed=0)
    policy.begin = lambda *_: only  # type: ignore[method-assign]
    with pytest.raises(PolicyError, match="one session twice"):
        answer(policy, [only], [OBSERVATION], Batching(size=2))
    alone = SessionPolicy(policy, Batching(size=1))
    alone.reset("Do it.", 0)
    alone.act(OBSERVATION)
    with pytest.raises(PolicyError, match="1 answers already"):
        alone.reset("Do it.", 0)


def test_session_is_ended_once_also_where_that_fails() -> None:
    policy = Ends()
    alone = SessionPolicy(policy, Batching(size=1))
    alone.reset("Do it.", 0)
    policy.open.clear()
    with pytest.raises(ValueError, match="not in list"):
        alone.reset("Do it.", 1)
    alone.reset("Do it.", 1)


@pytest.mark.parametrize("fields", [{"mode": "static"}, {"size": 0}])
def test_impossible_batching_is_refused(fields: dict[str, Any]) -> None:
    with pytest.raises(PolicyError):
        Batching(**fields)


class Counts:
    """A plain policy that counts its calls: shared, it would count those of others."""

    metadata = PolicyMetadata(name="counts")

    def reset(self, instruction: str, seed: int) -> None:  # noqa: ARG002 - the protocol
        self._count = 100 * seed

    def act(self, observation: Any) -> np.ndarray:  # noqa: ARG002 - the protocol
        self._count += 1
        return np.full((1, 16), self._count)


def test_plain_policies_keep_their_episodes_apart() -> None:
    pool = PolicyPool(Counts(), Counts, size=2)
    assert isinstance(pool, BatchPolicy)
    batching = Batching(mode="dynamic", size=8)
    first, second = pool.begin("Do it.", 1), pool.begin("Do it.", 2)
    for number in (1, 2):
        chunks = answer(pool, [second, first], [OBSERVATION] * 2, batching)
        assert [chunk[0, 0] for chunk in chunks] == [200 + number, 100 + number]
    with pytest.raises(MachineryError, match="All 2 objects of this policy are playing"):
        pool.begin("Do it.", 3)
    for size in (1, 2):
        made, _, batching = make_served("hold", Batching(mode="dynamic", size=size))
        assert (made.size, batching.size) == (size, 1)  # type: ignore[attr-defined]
    pool.end(first)
    third = pool.begin("Do it.", 3)
    assert answer(pool, [third], [OBSERVATION], batching)[0][0, 0] == 301


class Noisy(Counts):
    """Samples from generators that all policies share."""

    def act(self, observation: Any) -> np.ndarray:  # noqa: ARG002 - the protocol
        return np.full((1, 16), random.random() + np.random.random())  # noqa: NPY002


def test_noise_of_an_episode_is_that_of_its_seed_whoever_plays_beside_it() -> None:
    alone, pool = PolicyPool(Noisy(), Noisy), PolicyPool(Noisy(), Noisy, size=2)
    session = alone.begin("Do it.", 5)
    wanted = [answer(alone, [session], [OBSERVATION], ONE_BY_ONE)[0][0, 0] for _ in range(3)]
    first, second = pool.begin("Do it.", 5), pool.begin("Do it.", 2**40)
    batching = Batching(mode="dynamic", size=2)
    found = [answer(pool, [second, first], [OBSERVATION] * 2, batching)[1][0, 0] for _ in range(3)]
    assert found == wanted
    assert len({*wanted}) == 3


def test_plain_policy_that_cannot_be_reset_is_kept_and_all_are_closed() -> None:
    made: list[Counts] = []

    class Closes(Counts):
        closed = 0

        def __init__(self) -> None:
            made.append(self)

        def reset(self, instruction: str, seed: int) -> None:
            if not instruction:
                raise ZeroDivisionError
            super().reset(instruction, seed)

        def close(self) -> None:
            self.closed += 1

    pool = PolicyPool(Closes(), Closes, size=2)
    for _ in range(3):
        with pytest.raises(ZeroDivisionError):
            pool.begin("", 1)
    assert len(made) == 1
    pool.end(pool.begin("Do it.", 1))
    pool.begin("Do it.", 1), pool.begin("Do it.", 2)
    pool.close()
    assert [one.closed for one in made] == [1, 1]
