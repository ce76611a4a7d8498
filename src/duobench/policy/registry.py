"""Registry of policies by name: baselines, checkpoints of LeRobot, or anything importable."""

import hashlib
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from enum import StrEnum
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Self

from duobench.core.errors import (
    DuoBenchError,
    PolicyError,
    UnknownNameError,
    traceback_text,
)
from duobench.core.machine import install_extra
from duobench.core.references import load
from duobench.policy.baselines import HoldPolicy, RandomPolicy, ZeroPolicy
from duobench.policy.batch import (
    Batching,
    BatchPolicy,
    PolicyPool,
    SessionPolicy,
)
from duobench.policy.generators import MAKING_SEED, seed_generators
from duobench.policy.policy import Policy, PolicyMetadata

BASELINES: Mapping[str, Callable[[], Policy]] = MappingProxyType(
    {"hold": HoldPolicy, "random": RandomPolicy, "zero": ZeroPolicy}
)
"""Factories of the policies that come with the package."""


A_POLICY = (
    "A policy is made without arguments, and has `metadata` (a duobench.policy.PolicyMetadata), "
    "`reset(instruction, seed)` and `act(observation)`, or `begin(instruction, seed)` and "
    "`act_batch(sessions, observations)` for many episodes at a time."
)


class PolicyKind(StrEnum):
    """Origin of a policy, and what follows from it."""

    is_scripted: bool
    """Whether it reads the simulation, so that it must be where that is."""
    has_process: bool
    """Whether it is made in a process of its own, unless one process plays everything."""
    may_see: bool
    """Whether it may ask for images."""

    #           word, is_scripted, has_process, may_see
    EXPERT = "expert", True, False, False
    BLIND = "blind", True, False, False
    """Scripted policy that ignores everything that differs between episodes."""
    BASELINE = "baseline", False, True, False
    LEROBOT = "lerobot", False, True, True
    MODULE = "module", False, True, True
    """Anyone's own, from a module."""
    SERVED = "served", False, False, True

    def __new__(
        cls, word: str, is_scripted: bool, has_process: bool, may_see: bool
    ) -> Self:
        """Make a kind from its row."""
        kind = str.__new__(cls, word)
        kind._value_ = word
        kind.is_scripted = is_scripted
        kind.has_process = has_process
        kind.may_see = may_see
        return kind


MADE_ALONE: Mapping[str, PolicyKind] = MappingProxyType(
    dict.fromkeys(BASELINES, PolicyKind.BASELINE)
)
"""Words that name a policy which needs neither an environment nor a server."""
SCRIPTED: Mapping[str, PolicyKind] = MappingProxyType(
    {kind.value: kind for kind in PolicyKind if kind.is_scripted}
)
"""Words that name a policy which reads the simulation."""
_FORMS = ("lerobot:PATH_OR_ID", "module:attribute")
_LEROBOT = f"{PolicyKind.LEROBOT}:"


def kind_of(name: str, words: Mapping[str, PolicyKind] = MADE_ALONE) -> PolicyKind:
    """Return the kind of a policy, without importing anything.

    Args:
        name: A word, `expert:VARIETY`, `lerobot:PATH_OR_ID`, or `module:attribute`.
        words: Words that a name may be, with the kind of each.

    Raises:
        UnknownNameError: If there is no policy of that name.
        PolicyError: If it is nearly the name of a policy of the user's own.
    """
    if not name.isprintable():
        raise PolicyError(f"The name of a policy is printable text, got {name!a}.")
    first, is_divided, _ = name.partition(":")
    if is_divided and words.get(first) is PolicyKind.EXPERT:
        return PolicyKind.EXPERT
    if name.startswith(_LEROBOT):
        return PolicyKind.LEROBOT
    if is_divided:
        return PolicyKind.MODULE
    if name in words:
        return words[name]
    if Path(f"{name}.py").exists():
        raise PolicyError(
            f"{name!r} is a module; name a class in it, such as {name}:MyPolicy."
        )
    if "/" in name and not name.endswith(".py"):
        raise PolicyError(f"A checkpoint of LeRobot is lerobot:{name}, not {name!r}.")
    if "." in name:
        path = Path(name)
        module, attribute = path.stem, path.suffix.removeprefix(".")
        attribute = "MyPolicy" if attribute == "py" else attribute
        raise PolicyError(
            f"A policy of your own is named module:attribute, not {name!r}: "
            f"{module}:{attribute} for {attribute} in {module}.py."
        )
    raise UnknownNameError("policy", name, [*words, *_FORMS])


def reads_simulation(name: str) -> bool:
    """Whether a policy of this name reads the simulation, beside what it sees or instead of it."""
    return name in SCRIPTED or name.startswith(f"{PolicyKind.EXPERT}:")


def make(name: str) -> Policy:
    """Make a policy that plays one episode at a time.

    Args:
        name: A baseline's name; `lerobot:PATH_OR_ID`, a checkpoint of LeRobot, see
            `lerobot_checkpoint.Address`; or `module:attribute` where the attribute is a class or a
            function that gives a `Policy` or a `BatchPolicy` when called without arguments.

    Returns:
        A policy that has not been reset yet.

    Raises:
        UnknownNameError: If there is no baseline of that name.
        PolicyError: If the module or its attribute is missing, raises, or gives something else.
    """
    made = make_any(name)
    return SessionPolicy(made, Batching()) if isinstance(made, BatchPolicy) else made


def make_any(name: str) -> Policy | BatchPolicy:
    """Make a policy of either kind that is not scripted; errors are those of `make`."""
    kind = kind_of(name)
    factory = _factory(name, kind)
    try:
        policy = factory()
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        is_ours = kind is PolicyKind.LEROBOT or name.startswith("duobench.")
        if is_ours and isinstance(error, DuoBenchError):
            raise
        trace = traceback_text(error, skip=1).strip()
        if isinstance(error, TypeError) and "\n" not in trace:  # the call itself
            raise PolicyError(f"Policy {name!r}: {error}. {A_POLICY}") from error
        raise PolicyError(f"Policy {name!r} cannot be made.\n{trace}") from error
    is_policy = isinstance(policy, Policy | BatchPolicy)
    if not (is_policy and isinstance(policy.metadata, PolicyMetadata)):
        raise PolicyError(
            f"{name} gave a {type(policy).__name__}, which is no policy. {A_POLICY}"
        )
    return policy


def _factory(name: str, kind: PolicyKind) -> Callable[[], object]:
    if kind is PolicyKind.BASELINE:
        return BASELINES[name]
    reference = name.removeprefix(_LEROBOT)
    try:
        if kind is PolicyKind.MODULE:
            return load(reference, "class or function", callable)
        from duobench.policy.lerobot_model import LeRobotPolicy
    except DuoBenchError as error:
        raise PolicyError(f"Policy {reference!r}: {error}") from error
    except ImportError as error:
        raise PolicyError(
            f"Policies of LeRobot need LeRobot 0.6, which cannot be imported: {error}. "
            f"{install_extra('lerobot')}"
        ) from error
    return partial(LeRobotPolicy, reference)


def make_batched(
    name: str, batching: Batching | None = None, *, objects: int | None = None
) -> tuple[BatchPolicy, PolicyMetadata, Batching | None]:
    """Make a policy of either kind for many episodes at a time; errors are those of `make`.

    Args:
        name: That of a policy that is not scripted.
        batching: How many observations a batch of a `BatchPolicy` has; None takes the default,
            and anything else is an error for a plain policy without `objects`.
        objects: How many episodes a plain policy may play side by side, with an object for each;
            None for one of them, and no batches.

    Returns:
        The policy; its metadata, with the hash of its source where it has no version; and how many
        observations a batch has, None for a plain policy.
    """
    kind = kind_of(name)
    seed_generators(MAKING_SEED)
    _factory(name, kind)  # imports what may take random numbers for itself
    seed_generators(MAKING_SEED)
    policy = make_any(name)
    metadata = policy.metadata
    if metadata.version is None:
        modules = {type(policy).__module__}
        if kind is PolicyKind.MODULE:
            modules.add(name.partition(":")[0])
        metadata = replace(metadata, version=source_version(*modules))
    if isinstance(policy, BatchPolicy):
        return policy, metadata, batching or Batching()
    if batching is not None and objects is None:
        raise no_batches(name)
    return PolicyPool(policy, lambda: make(name), objects or 1), metadata, None


def no_batches(name: str) -> PolicyError:
    """Error about the batch of a policy that takes no batches."""
    return PolicyError(
        f"{name} answers one observation at a time, so there are no batches of it. "
        "With `begin` and `act_batch` it would be a duobench.policy.BatchPolicy."
    )


def source_version(*modules: str) -> str | None:
    """A version made of the source files of imported modules; None if one of them has no file."""
    digest = hashlib.sha256()
    for name in sorted(set(modules)):
        file = getattr(sys.modules.get(name), "__file__", None)
        try:
            digest.update(Path(file or "").read_bytes())
        except OSError:
            return None
    return f"source {digest.hexdigest()[:16]}"
