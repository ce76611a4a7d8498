"""From a name to a policy: baselines, checkpoints of LeRobot, or anything importable."""

import hashlib
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial
from pathlib import Path
from types import MappingProxyType

from duobench.core.errors import DuoBenchError, PolicyError, UnknownNameError, traceback_text
from duobench.core.machine import install_extra
from duobench.core.references import load
from duobench.policy.baselines import HoldPolicy, RandomPolicy, ZeroPolicy
from duobench.policy.batch import Batching, BatchPolicy, PolicyPool, SessionPolicy
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
    """Where a policy comes from: the first two read the simulation, a baseline needs nothing."""

    EXPERT = "expert"
    BLIND = "blind"
    """The scripted policy without a look at what changes from episode to episode."""
    BASELINE = "baseline"
    LEROBOT = "lerobot"
    MODULE = "module"
    """Anyone's own, from a module."""
    SERVED = "served"


MADE_ALONE: Mapping[str, PolicyKind] = MappingProxyType(
    dict.fromkeys(BASELINES, PolicyKind.BASELINE)
)
"""Words that name a policy which needs neither an environment nor a server."""
SCRIPTED: Mapping[str, PolicyKind] = MappingProxyType(
    {kind.value: kind for kind in (PolicyKind.EXPERT, PolicyKind.BLIND)}
)
"""Words that name a policy which reads the simulation."""
_FORMS = ("lerobot:PATH_OR_ID", "module:attribute")


@dataclass(frozen=True, kw_only=True, slots=True)
class PolicyName:
    """The name of a policy, taken apart."""

    text: str
    """The name as the user gave it."""
    kind: PolicyKind
    reference: str
    """What is made: a word, `module:attribute`, or what follows `lerobot:`."""
    variety: str | None = None
    """Name of the expert's variety, if there is one in the name."""

    @classmethod
    def parse(cls, text: str, words: Mapping[str, PolicyKind] = MADE_ALONE) -> "PolicyName":
        """Take a name apart, without importing anything.

        Args:
            text: A word, `expert:VARIETY`, `lerobot:PATH_OR_ID`, or `module:attribute`.
            words: What a word may be, and what it names.
        """
        if not text.isprintable():
            raise PolicyError(f"The name of a policy is printable text, got {text!a}.")
        first, is_divided, rest = text.partition(":")
        kind, reference, variety = words.get(text), text, None
        if is_divided and words.get(first) is PolicyKind.EXPERT:
            kind, reference, variety = PolicyKind.EXPERT, first, rest
        elif is_divided and first == PolicyKind.LEROBOT:
            kind, reference = PolicyKind.LEROBOT, rest
        elif is_divided:
            kind = PolicyKind.MODULE
        if kind is None and Path(f"{text}.py").exists():
            raise PolicyError(f"{text!r} is a module; name a class in it, such as {text}:MyPolicy.")
        if kind is None and "/" in text and not text.endswith(".py"):
            raise PolicyError(f"A checkpoint of LeRobot is lerobot:{text}, not {text!r}.")
        if kind is None and "." in text:
            path = Path(text)
            module, attribute = path.stem, path.suffix.removeprefix(".")
            attribute = "MyPolicy" if attribute == "py" else attribute
            raise PolicyError(
                f"A policy of your own is named module:attribute, not {text!r}: "
                f"{module}:{attribute} for {attribute} in {module}.py."
            )
        if kind is None:
            raise UnknownNameError("policy", text, [*words, *_FORMS])
        return cls(text=text, kind=kind, reference=reference, variety=variety)


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
    made = make_any(PolicyName.parse(name))
    return SessionPolicy(made, Batching()) if isinstance(made, BatchPolicy) else made


def make_any(name: PolicyName) -> Policy | BatchPolicy:
    """Make a policy of either kind that is not scripted; errors are those of `make`."""
    factory = _factory(name)
    try:
        policy = factory()
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        is_ours = name.kind is PolicyKind.LEROBOT or name.reference.startswith("duobench.")
        if is_ours and isinstance(error, DuoBenchError):
            raise
        trace = traceback_text(error, skip=1).strip()
        if isinstance(error, TypeError) and "\n" not in trace:  # the call itself
            raise PolicyError(f"Policy {name.text!r}: {error}. {A_POLICY}") from error
        raise PolicyError(f"Policy {name.text!r} cannot be made.\n{trace}") from error
    is_policy = isinstance(policy, Policy | BatchPolicy)
    if not (is_policy and isinstance(policy.metadata, PolicyMetadata)):
        raise PolicyError(
            f"{name.text} gave a {type(policy).__name__}, which is no policy. {A_POLICY}"
        )
    return policy


def _factory(name: PolicyName) -> Callable[[], object]:
    if name.kind is PolicyKind.BASELINE:
        return BASELINES[name.text]
    try:
        if name.kind is not PolicyKind.LEROBOT:
            return load(name.reference, "class or function", callable)
        from duobench.policy.lerobot_model import LeRobotPolicy
    except DuoBenchError as error:
        raise PolicyError(f"Policy {name.reference!r}: {error}") from error
    except ImportError as error:
        raise PolicyError(
            f"Policies of LeRobot need LeRobot 0.6, which cannot be imported: {error}. "
            f"{install_extra('lerobot')}"
        ) from error
    return partial(LeRobotPolicy, name.reference)


def make_batched(
    name: PolicyName, batching: Batching | None = None, *, objects: int | None = None
) -> tuple[BatchPolicy, PolicyMetadata, Batching | None]:
    """Make a policy of either kind for many episodes at a time; errors are those of `make`.

    Args:
        name: That of a policy that is not scripted.
        batching: How many observations a `BatchPolicy` answers together; None takes the default,
            and anything else is an error for a plain policy without `objects`.
        objects: How many episodes a plain policy may play side by side, with an object for each;
            None for one of them, and no batches.

    Returns:
        The policy; its metadata, with the hash of its source where it has no version; and how many
        observations it answers together, None for a plain policy.
    """
    seed_generators(MAKING_SEED)
    _factory(name)  # imports what may take random numbers for itself
    seed_generators(MAKING_SEED)
    policy = make_any(name)
    metadata = policy.metadata
    if metadata.version is None:
        own = [name.reference.partition(":")[0]] if name.kind is PolicyKind.MODULE else []
        metadata = replace(metadata, version=source_version(type(policy).__module__, *own))
    if isinstance(policy, BatchPolicy):
        return policy, metadata, batching or Batching()
    if batching is not None and objects is None:
        raise no_batches(name)
    return PolicyPool(policy, lambda: make(name.text), objects or 1), metadata, None


def no_batches(name: PolicyName) -> PolicyError:
    """The error about batches of a policy that has none."""
    return PolicyError(
        f"{name.text} answers one observation at a time, so there are no batches of it. "
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
