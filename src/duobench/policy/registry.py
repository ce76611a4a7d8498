"""From a name to a policy: baselines, checkpoints of LeRobot, or anything importable."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import MappingProxyType

from duobench.errors import DuoBenchError, PolicyError, UnknownNameError, traceback_text
from duobench.installing import install_extra
from duobench.policy.baselines import HoldPolicy, RandomPolicy, ZeroPolicy
from duobench.policy.batch import Batching, BatchPolicy, SessionPolicy
from duobench.policy.lerobot.address import SCHEME as LEROBOT
from duobench.policy.policy import Policy, PolicyMetadata
from duobench.references import load

BASELINES: Mapping[str, Callable[[], Policy]] = MappingProxyType(
    {"hold": HoldPolicy, "random": RandomPolicy, "zero": ZeroPolicy}
)
"""Factories of the policies that come with the package."""


def make(name: str) -> Policy:
    """Make a policy that plays one episode at a time.

    Args:
        name: A baseline's name; `lerobot:PATH_OR_ID`, a checkpoint of LeRobot, see
            `duobench.policy.lerobot.address`; or `module:attribute` where the attribute is a class
            or a function that gives a `Policy` or a `BatchPolicy` when called without arguments.

    Returns:
        A policy that has not been reset yet.

    Raises:
        UnknownNameError: If there is no baseline of that name.
        PolicyError: If the module or its attribute is missing, raises, or gives something else.
    """
    made = make_any(name)
    return SessionPolicy(made, Batching()) if isinstance(made, BatchPolicy) else made


def make_any(name: str) -> Policy | BatchPolicy:
    """Make a policy of either kind, as it is; arguments and errors are those of `make`."""
    if ":" in name:
        policy = _made(name)
    elif name in BASELINES:
        policy = BASELINES[name]()
    else:
        raise UnknownNameError(
            "policy", name, [*BASELINES, "lerobot:PATH_OR_ID", "module:attribute"]
        )
    is_one = isinstance(policy, Policy | BatchPolicy)
    if not is_one or not isinstance(policy.metadata, PolicyMetadata):
        raise PolicyError(
            f"{name} gave a {type(policy).__name__}, which is no policy. A policy has `metadata` "
            "(a duobench.policy.PolicyMetadata), `reset(instruction, seed)` and "
            "`act(observation)`, or `begin(instruction, seed)` and "
            "`act_batch(sessions, observations)` for many episodes at a time."
        )
    return policy


def versioned_metadata(name: str, policy: Policy | BatchPolicy) -> PolicyMetadata:
    """What a policy says about itself, with the hash of its source where it has no version.

    Args:
        name: Name that it was made by.
        policy: The policy.
    """
    if policy.metadata.version is not None:
        return policy.metadata
    modules = [name.partition(":")[0]] if ":" in name else []
    version = source_version(*modules, type(policy).__module__)
    return replace(policy.metadata, version=version)


def source_version(*modules: str) -> str | None:
    """A version made of the source files of modules; None if one of them has no file.

    Args:
        modules: Names of imported modules, in any order.
    """
    digest = hashlib.sha256()
    for name in sorted(set(modules)):
        file = getattr(sys.modules.get(name), "__file__", None)
        try:
            digest.update(Path(file or "").read_bytes())
        except OSError:
            return None
    return f"source {digest.hexdigest()[:16]}"


def _made(path: str) -> object:
    """What `scheme:name` or `module:attribute` gives."""
    scheme, _, rest = path.partition(":")
    is_ours = scheme == LEROBOT
    factory = partial(_lerobot_class(), rest) if is_ours else _factory(path)
    try:
        return factory()
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        if isinstance(error, DuoBenchError) and (is_ours or scheme.startswith("duobench.")):
            raise
        trace = traceback_text(error, skip=1).strip()
        raise PolicyError(f"Policy {path!r} cannot be made.\n{trace}") from error


def _factory(path: str) -> Callable[[], object]:
    try:
        return load(path, "class or function", callable)
    except DuoBenchError as error:
        raise PolicyError(f"Policy {path!r}: {error}") from error


def _lerobot_class() -> Callable[[str], object]:
    try:
        from duobench.policy.lerobot.policy import LeRobotPolicy
    except ImportError as error:
        raise PolicyError(
            f"Policies of LeRobot need LeRobot 0.6, which cannot be imported: {error}. "
            f"{install_extra('lerobot')}"
        ) from error
    return LeRobotPolicy
