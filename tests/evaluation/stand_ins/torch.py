"""A stand-in for torch: generators of a processor and two graphics cards, not seeded at first."""

import pickle
import random
import secrets
from collections.abc import Sequence

import numpy as np

State = np.ndarray


class Tensor:
    """What other libraries ask whether a value is one."""


def _state(generator: random.Random) -> State:
    return np.frombuffer(pickle.dumps(generator.getstate()), np.uint8)


def _go_on(generator: random.Random, state: State) -> None:
    generator.setstate(pickle.loads(state.tobytes()))


def _normal(generator: random.Random, size: int) -> np.ndarray:
    return np.array([generator.gauss() for _ in range(size)])


_processor = random.Random(secrets.randbits(64))


class Cuda:
    """Graphics cards, which wake up when something is sampled on one; a seed waits for that."""

    def __init__(self) -> None:
        self._cards: list[random.Random] = []
        self._seed = secrets.randbits(64)

    def is_initialized(self) -> bool:
        return bool(self._cards)

    def randn(self, size: int) -> np.ndarray:
        if not self._cards:
            self._cards = [random.Random(self._seed + card) for card in range(2)]
        return np.sum([_normal(card, size) for card in self._cards], axis=0)

    def manual_seed_all(self, seed: int) -> None:
        self._seed = seed
        for number, card in enumerate(self._cards):
            card.seed(seed + number)

    def get_rng_state_all(self) -> list[State]:
        return [_state(card) for card in self._cards]

    def set_rng_state_all(self, states: Sequence[State]) -> None:
        for card, state in zip(self._cards, states, strict=True):
            _go_on(card, state)


cuda = Cuda()


def randn(size: int) -> np.ndarray:
    return _normal(_processor, size)


def manual_seed(seed: int) -> None:
    """Seed all generators, with a seed of 64 bits."""
    if not -(2**63) <= seed < 2**64:
        raise RuntimeError("Overflow when unpacking long")
    _processor.seed(seed)
    cuda.manual_seed_all(seed)


def get_rng_state() -> State:
    return _state(_processor)


def set_rng_state(state: State) -> None:
    _go_on(_processor, state)
