"""Policies by name for an evaluation: scripted experts, baselines, and anyone's own.

Experts and other policies never import each other; they meet here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import gymnasium as gym
from numpy.typing import ArrayLike

from duobench.envs.sim_env import sim_of
from duobench.errors import PolicyError, UnknownNameError
from duobench.evaluation.suite import TaskInfo
from duobench.experts.registry import find_script, make_expert
from duobench.policy import (
    BASELINES,
    Batching,
    BatchPolicy,
    Policy,
    PolicyMetadata,
    SessionPolicy,
)
from duobench.policy.registry import make_any, source_version, versioned_metadata

EXPERT = "expert"
"""The name under which each task's scripted expert is a policy."""


@dataclass(frozen=True, kw_only=True, slots=True)
class PolicySource:
    """A policy that may still have to be bound to an environment."""

    metadata: PolicyMetadata
    """What it expects, and its version; the environment is made to fit."""
    bind: Callable[[gym.Env], Policy]
    """The policy for an environment."""
    close: Callable[[], None]
    """Frees what the policy holds."""
    name: str
    """Name under which it was asked for."""
    batching: Batching | None = None
    """How many observations it answers together; None if that is one, or nobody knows."""
    batch_policy: BatchPolicy | None = None
    """The policy itself, if it answers many episodes at a time."""


class ExpertPolicy:
    """The scripted expert of an environment's task, as a policy."""

    metadata = PolicyMetadata(name=EXPERT)

    def __init__(self, env: gym.Env) -> None:
        """Find the expert.

        Args:
            env: The environment that it will act in; it reads the privileged state.

        Raises:
            PolicyError: If the task has no expert.
        """
        duo = sim_of(env)
        self._expert = make_expert(duo.definition, duo.simulation)

    def reset(self, instruction: str, seed: int) -> None:
        """Begin an episode."""
        self._expert.reset(instruction, seed)

    def act(self, observation: Mapping[str, Any]) -> ArrayLike:
        """The expert's next actions (H, 16)."""
        return self._expert.act(observation)


def is_expert(name: str) -> bool:
    """Whether a name is that of the scripted experts."""
    return name.partition(":")[0] == EXPERT


def check_name(name: str) -> None:
    """Reject a name that cannot be a policy's, without making one.

    Raises:
        UnknownNameError: If there is none of that name.
        PolicyError: If the name is no text that can be written down.
    """
    if not name.isprintable():
        raise PolicyError(f"The name of a policy is printable text, got {name!a}.")
    if ":" not in name and name != EXPERT and name not in BASELINES:
        raise UnknownNameError("policy", name, [EXPERT, *BASELINES, "module:attribute"])


def source(
    name: str, tasks: Sequence[TaskInfo] = (), batching: Batching | None = None
) -> PolicySource:
    """Look a policy up.

    Args:
        name: `expert`, a baseline's name, or `module:attribute`.
        tasks: What it will play; an expert's version is that of the scripts of these tasks.
        batching: How many observations a `BatchPolicy` answers together; None takes the default.

    Raises:
        UnknownNameError: If there is none of that name.
        PolicyError: If the module or its attribute is missing, or gives something else; if a task
            has no expert.
    """
    check_name(name)
    if name == EXPERT:
        scripts = [find_script(task.reference).__module__ for task in tasks]
        metadata = replace(ExpertPolicy.metadata, version=source_version(*scripts))
        return PolicySource(name=name, metadata=metadata, bind=ExpertPolicy, close=lambda: None)
    made = make_any(name)
    metadata = versioned_metadata(name, made)
    close = getattr(made, "close", lambda: None)
    if not isinstance(made, BatchPolicy):
        if batching is not None:
            raise PolicyError(
                f"{name} answers one observation at a time, so there are no batches of it. With "
                "`begin` and `act_batch` it would be a duobench.policy.BatchPolicy."
            )
        return PolicySource(name=name, metadata=metadata, bind=lambda _env: made, close=close)
    batching = batching or Batching()
    alone = SessionPolicy(made, batching)
    return PolicySource(
        name=name,
        metadata=metadata,
        bind=lambda _env: alone,
        close=close,
        batching=batching,
        batch_policy=made,
    )
