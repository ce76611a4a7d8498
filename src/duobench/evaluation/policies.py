"""Policies by name for an evaluation: scripted experts, baselines, and anyone's own.

Experts and other policies never import each other; they meet here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
from numpy.typing import ArrayLike

from duobench import policy
from duobench.envs.sim_env import sim_of
from duobench.errors import UnknownNameError
from duobench.experts.registry import make_expert
from duobench.policy import BASELINES, Policy, PolicyMetadata

EXPERT = "expert"
"""The name under which each task's scripted expert is a policy."""


@dataclass(frozen=True, kw_only=True, slots=True)
class PolicySource:
    """A policy that may still have to be bound to an environment."""

    metadata: PolicyMetadata
    """What it expects; the environment is made to fit."""
    bind: Callable[[gym.Env], Policy]
    """The policy for an environment."""


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


def check_name(name: str) -> None:
    """Refuse a name that can be no policy, without making one.

    Raises:
        UnknownNameError: If there is none of that name.
    """
    if ":" not in name and name != EXPERT and name not in BASELINES:
        raise UnknownNameError("policy", name, [EXPERT, *BASELINES, "module:attribute"])


def source(name: str) -> PolicySource:
    """Look a policy up.

    Args:
        name: `expert`, a baseline's name, or `module:attribute`.

    Raises:
        UnknownNameError: If there is none of that name.
        PolicyError: If the module or its attribute is missing, or gives something else.
    """
    if name == EXPERT:
        return PolicySource(metadata=ExpertPolicy.metadata, bind=ExpertPolicy)
    check_name(name)
    made = policy.make(name)
    return PolicySource(metadata=made.metadata, bind=lambda _env: made)
