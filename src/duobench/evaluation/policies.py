"""Policies by name for an evaluation: scripted experts, baselines, and anyone's own.

Experts and other policies never import each other; they meet here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import gymnasium as gym

from duobench.envs.sim_env import sim_of
from duobench.errors import PolicyError, UnknownNameError, check_known
from duobench.evaluation.suite import TaskInfo
from duobench.experts.expert import Expert, find_script
from duobench.experts.motion import wait
from duobench.experts.scripts import blind
from duobench.experts.variety import NONE, VARIETIES, Variety
from duobench.policy import BASELINES, Batching, BatchPolicy, Policy, PolicyMetadata, SessionPolicy
from duobench.policy.registry import make_any, source_version, versioned_metadata
from duobench.policy.serving.address import SERVED

EXPERT = "expert"
"""The name under which each task's scripted expert is a policy; `expert:NAME` has a variety."""
BLIND = "blind"
"""The name of the baseline that plays without a look at what changes from episode to episode."""


@dataclass(frozen=True, kw_only=True, slots=True)
class PolicySource:
    """A policy that may still have to be bound to an environment."""

    metadata: PolicyMetadata
    """What it expects, and its version; the environment is made to fit."""
    bind: Callable[[gym.Env], Policy]
    """The policy for an environment."""
    close: Callable[[], None] = lambda: None
    """Frees what the policy holds."""
    name: str
    """Name of the policy, as the user gave it."""
    batching: Batching | None = None
    """How many observations it answers together; None if that is one, or unknown."""
    batch_policy: BatchPolicy | None = None
    """The policy itself, if it answers many episodes at a time."""


class ExpertPolicy(Expert):
    """The scripted expert of an environment's task, as a policy."""

    def __init__(self, env: gym.Env, variety: Variety = NONE) -> None:
        """Find the expert.

        Args:
            env: The environment that it will act in; it reads the privileged state.
            variety: How its episodes differ from the plain script.

        Raises:
            PolicyError: If the task has no expert.
        """
        duo = sim_of(env)
        script = find_script(duo.definition)
        super().__init__(duo.simulation, script, variety=variety, task_id=duo.definition.id)
        self.metadata = _expert_metadata(variety)


class BlindPolicy(Expert):
    """A fixed sequence of motions where a task has one, see `blind.SCRIPTS`; else it holds still.

    It reads where to grasp from the simulator, and nothing else of the layout.
    """

    metadata = PolicyMetadata(name=BLIND, cameras=())

    def __init__(self, env: gym.Env) -> None:
        """Find the sequence.

        Args:
            env: The environment that it will act in.
        """
        duo = sim_of(env)
        super().__init__(duo.simulation, blind.SCRIPTS.get(duo.definition.id, lambda _: wait(0)))


def expert_variety(name: str) -> Variety | None:
    """The variety of the expert that a name asks for; None if it is that of another policy.

    Raises:
        UnknownNameError: There is no such variety.
    """
    first, is_varied, variety = name.partition(":")
    if first != EXPERT:
        return None
    if not is_varied:
        return NONE
    check_known("variety", variety, VARIETIES)
    return VARIETIES[variety]


def _expert_metadata(variety: Variety) -> PolicyMetadata:
    name = EXPERT if variety is NONE else f"{EXPERT}:{variety.name}"
    return PolicyMetadata(name=name, cameras=())


def check_name(name: str) -> None:
    """Reject a name that cannot be a policy's, without making one.

    Raises:
        UnknownNameError: If there is none of that name.
        PolicyError: If the name is no text that can be written down.
    """
    if not name.isprintable():
        raise PolicyError(f"The name of a policy is printable text, got {name!a}.")
    if expert_variety(name) is None and ":" not in name and name not in (BLIND, *BASELINES):
        experts = [EXPERT, *(f"{EXPERT}:{variety}" for variety in VARIETIES)]
        known = [*experts, BLIND, *BASELINES, *SERVED, "lerobot:PATH_OR_ID", "module:attribute"]
        raise UnknownNameError("policy", name, known)


def source(
    name: str, tasks: Sequence[TaskInfo] = (), batching: Batching | None = None
) -> PolicySource:
    """Look a policy up.

    Args:
        name: `expert`, `expert:VARIETY`, `blind`, a baseline's name, `lerobot:PATH_OR_ID`, or
            `module:attribute`.
        tasks: What it will play; an expert's version is that of the scripts of these tasks.
        batching: How many observations a `BatchPolicy` answers together; None takes the default.

    Raises:
        UnknownNameError: If there is none of that name, or no such variety.
        PolicyError: If the module or its attribute is missing, or gives something else; if a task
            has no expert.
    """
    check_name(name)
    variety = expert_variety(name)
    if variety is not None:
        modules = {find_script(task.reference).__module__ for task in tasks}
        if variety is not NONE:
            modules.add(Variety.__module__)
        metadata = replace(_expert_metadata(variety), version=source_version(*modules))
        bind = partial(ExpertPolicy, variety=variety)
        policy = PolicySource(name=name, metadata=metadata, bind=bind)
    elif name == BLIND:
        modules = {script.__module__ for script in blind.SCRIPTS.values()}
        modules |= {find_script(task).__module__ for task in blind.SCRIPTS}
        metadata = replace(BlindPolicy.metadata, version=source_version(*modules))
        policy = PolicySource(name=name, metadata=metadata, bind=BlindPolicy)
    else:
        policy = _made(name, batching or Batching())
    if batching is not None and policy.batching is None:
        raise PolicyError(
            f"{name} answers one observation at a time, so there are no batches of it. With "
            "`begin` and `act_batch` it would be a duobench.policy.BatchPolicy."
        )
    return policy


def _made(name: str, batching: Batching) -> PolicySource:
    """A policy that is no expert; `batching` is for one that answers many episodes."""
    made = make_any(name)
    metadata = versioned_metadata(name, made)
    close = getattr(made, "close", lambda: None)
    if not isinstance(made, BatchPolicy):
        return PolicySource(name=name, metadata=metadata, bind=lambda _env: made, close=close)
    alone = SessionPolicy(made, batching)
    return PolicySource(
        name=name,
        metadata=metadata,
        bind=lambda _env: alone,
        close=close,
        batching=batching,
        batch_policy=made,
    )
