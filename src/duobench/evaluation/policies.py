"""Policies by name for an evaluation: scripted experts, baselines, and anyone's own.

Experts and other policies never import each other; they meet here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import gymnasium as gym
from numpy.typing import ArrayLike

from duobench import policy
from duobench.envs.sim_env import sim_of
from duobench.errors import PolicyError, UnknownNameError
from duobench.evaluation.suite import TaskInfo
from duobench.experts.registry import find_script, make_expert
from duobench.policy import BASELINES, Policy, PolicyMetadata
from duobench.policy.registry import source_version

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
        reference = "" if duo.spec is None else duo.spec.kwargs.get("task", "")
        self._expert = make_expert(duo.task, duo.simulation, reference)

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


def source(name: str, tasks: Sequence[TaskInfo] = ()) -> PolicySource:
    """Look a policy up.

    Args:
        name: `expert`, a baseline's name, or `module:attribute`.
        tasks: What it will play; an expert's version is that of the scripts of these tasks.

    Raises:
        UnknownNameError: If there is none of that name.
        PolicyError: If the module or its attribute is missing, or gives something else; if a task
            has no expert.
    """
    check_name(name)
    if name == EXPERT:
        scripts = [find_script(task.id, task.reference).__module__ for task in tasks]
        metadata = replace(ExpertPolicy.metadata, version=source_version(*scripts))
        return PolicySource(metadata=metadata, bind=ExpertPolicy, close=lambda: None)
    made = policy.make(name)
    metadata = made.metadata
    if metadata.version is None:
        modules = [name.partition(":")[0]] if ":" in name else []
        metadata = replace(metadata, version=source_version(*modules, type(made).__module__))
    close = getattr(made, "close", lambda: None)
    return PolicySource(metadata=metadata, bind=lambda _env: made, close=close)
