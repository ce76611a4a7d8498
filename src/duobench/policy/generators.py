"""Global random generators of a process, which policies share: Python's, NumPy's and torch's.

Torch is never imported here: where a policy imports it, its generators are seeded like the others.
"""

import importlib.util
import random
import sys
from collections.abc import Callable
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any, TypeVar

import numpy as np

T = TypeVar("T")

MAKING_SEED = 0
"""Seed of global generators while a policy is made, and for what a new one does first."""


class _TorchSeeder(MetaPathFinder):
    """Import hook that seeds torch's generators as soon as it is imported."""

    def __init__(self) -> None:
        self.seed, self._is_looking = MAKING_SEED, False

    def find_spec(self, name: str, *_where: Any) -> ModuleSpec | None:
        """Find torch by the other finders, and seed it once it is imported."""
        if name != "torch" or self._is_looking:
            return None
        self._is_looking = True
        try:
            spec = importlib.util.find_spec(name)
        finally:
            self._is_looking = False
        if spec and spec.loader:
            execute = spec.loader.exec_module

            def execute_and_seed(module: ModuleType) -> None:
                execute(module)
                self.seed_torch(self.seed)

            spec.loader.exec_module = execute_and_seed
        return spec

    def seed_torch(self, seed: int) -> None:
        """Seed the generators of the processor and of all graphics cards, now or at the import."""
        self.seed = seed
        if self not in sys.meta_path:
            sys.meta_path.insert(0, self)
        torch = _torch()
        if torch:
            torch.manual_seed(seed % 2**63)


_TORCH_SEEDER = _TorchSeeder()


def _torch() -> Any:
    """The module torch if it has been imported, else None."""
    torch = sys.modules.get("torch")
    return torch if hasattr(torch, "manual_seed") else None


def seed_generators(seed: int) -> None:
    """Seed the global generators of this process: Python's, NumPy's and torch's, if it is used."""
    random.seed(seed)
    np.random.seed(seed % 2**32)  # noqa: NPY002 - which policies share
    _TORCH_SEEDER.seed_torch(seed)


Noise = tuple[Any, Any, list[Any]]
"""States of the generators of Python, NumPy, and torch: of the processor, then of each card."""


def noise_now() -> Noise:
    """The states at this moment."""
    states = []
    torch = _torch()
    if torch:
        states = [torch.get_rng_state()]
        states += torch.cuda.get_rng_state_all() if torch.cuda.is_initialized() else []
    return random.getstate(), np.random.get_state(), states  # noqa: NPY002


def go_on_with(noise: Noise) -> None:
    """Bring the generators to these states."""
    python, numpy, states = noise
    random.setstate(python)
    np.random.set_state(numpy)  # noqa: NPY002
    if states:
        _torch().set_rng_state(states[0])
    if states[1:]:
        _torch().cuda.set_rng_state_all(states[1:])


def tried(call: Callable[[], T]) -> tuple[T, bool]:
    """Result of a call with generators of `MAKING_SEED`, and whether it has moved them.

    The first calls of an object may import torch, or make a model and take random numbers for that:
    with this seed it is the same in every process, in any order of episodes.
    """
    seed_generators(MAKING_SEED)
    given = call()
    after = noise_now()
    seed_generators(MAKING_SEED)
    before = noise_now()
    is_same = after[0] == before[0] and len(after[2]) == len(before[2])
    states = zip((*after[1], *after[2]), (*before[1], *before[2]), strict=False)
    return given, not (is_same and all(np.array_equal(*pair) for pair in states))
