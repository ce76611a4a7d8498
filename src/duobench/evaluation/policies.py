"""Policies by name for an evaluation: scripted experts, baselines, and anyone's own.

Experts and other policies never import each other; they meet here.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pkgutil import resolve_name
from typing import Any

import gymnasium as gym

from duobench.core.errors import (
    PolicyError,
    check_known,
)
from duobench.data import Actor, ActorKind
from duobench.envs.sim_env import sim_of
from duobench.policy import (
    Batching,
    Policy,
    PolicyMetadata,
    SessionPolicy,
)
from duobench.policy.batch import ONE_BY_ONE
from duobench.policy.registry import (
    PolicyKind,
    kind_of,
    make_batched,
    no_batches,
    source_version,
)
from duobench.policy.serving.address import (
    MAX_S,
    OPENPI,
    SERVED,
    WORDS,
    PolicyAddress,
    RemoteServer,
)
from duobench.results.run import TimeLimits
from duobench.results.suite import TaskInfo
from duobench.tasks.experts.expert import Expert, find_script
from duobench.tasks.experts.motion import wait
from duobench.tasks.experts.scripts import blind
from duobench.tasks.experts.variety import NONE, VARIETIES, Variety

_ANSWERING_S = 5.0
"""Seconds to wait for a process that has said that it answers."""


@dataclass(frozen=True, kw_only=True, slots=True)
class PolicyChoice:
    """A policy by its name, and whether it plays in batches or at a server.

    Raises:
        UnknownNameError: If there is no policy of that name, or no such variety.
        PolicyError: If the name is no text, or does not go with the rest.
    """

    name: str
    """`expert`, `expert:VARIETY`, `blind`, a baseline's name, `lerobot:PATH_OR_ID`,
    `module:attribute`, or a name of `SERVED`."""
    batching: Batching | None = None
    """Observations in a batch of a `BatchPolicy`; None takes the default."""
    server: RemoteServer | None = None
    """Address of the server of a served policy."""
    address: PolicyAddress | None = None
    """Address of the process of its own that it is in, if there is one."""

    @property
    def kind(self) -> PolicyKind:
        """Kind of the policy."""
        return kind_of(self.name, WORDS)

    @property
    def variety(self) -> Variety:
        """Variety of an expert; `NONE` for every other policy."""
        _, is_divided, variety = self.name.partition(":")
        if self.kind is not PolicyKind.EXPERT or not is_divided:
            return NONE
        check_known("variety", variety, VARIETIES)
        return VARIETIES[variety]

    def __post_init__(self) -> None:
        self.variety  # noqa: B018 - raises where it is unknown
        if self.kind is not PolicyKind.SERVED:
            return
        if self.server is None:
            raise PolicyError(
                f"The policy {self.name!r} is served somewhere: it needs an address."
            )
        if self.batching is not None:
            raise PolicyError(
                "How many observations are answered together is up to the server."
            )


def parse_choice(name: str) -> PolicyChoice:
    """The policy of a name as `PolicyChoice` takes it, or of `NAME@URL` where it is served."""
    plain, is_served, url = name.partition("@")
    if is_served and url.startswith(("ws://", "wss://")):
        return PolicyChoice(
            name=plain,
            server=RemoteServer(url=url),
        )
    return PolicyChoice(name=name)


def actor_of(choice: PolicyChoice, metadata: PolicyMetadata) -> Actor:
    """The actor that recordings name for a policy."""
    is_expert = choice.kind is PolicyKind.EXPERT
    kind = ActorKind.EXPERT if is_expert else ActorKind.POLICY
    return Actor(
        kind=kind,
        name=choice.name,
        version=metadata.version,
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class PolicySource:
    """A policy that may still have to be bound to an environment."""

    metadata: PolicyMetadata
    """Expectations of the policy, and its version; the environment is made to fit."""
    bind: Callable[[gym.Env], Policy]
    close: Callable[[], None] = lambda: None
    batching: Batching | None = None
    """Observations in a batch; None if that is one, or unknown."""
    waits_for_others: bool = False
    """Whether it may have to wait for others, for which it is not to blame."""


class ExpertPolicy(Expert):
    """The scripted expert of an environment's task, as a policy; it reads the privileged state.

    Args:
        env: The environment that it will act in.
        variety: How its episodes differ from the plain script.

    Raises:
        PolicyError: The task has no expert.
    """

    def __init__(self, env: gym.Env, variety: Variety = NONE) -> None:
        duo = sim_of(env)
        script = find_script(duo.definition)
        super().__init__(
            duo.simulation, script, variety=variety, task_id=duo.definition.id
        )
        self.metadata = _expert_metadata(variety)


class BlindPolicy(Expert):
    """A fixed sequence of motions where a task has one, see `blind.SCRIPTS`; else it holds still.

    It reads where to grasp from the simulator, and nothing else of the layout.
    """

    metadata = PolicyMetadata(name=PolicyKind.BLIND.value, cameras=())

    def __init__(self, env: gym.Env) -> None:
        duo = sim_of(env)
        super().__init__(
            duo.simulation, blind.SCRIPTS.get(duo.definition.id, lambda _: wait(0))
        )


def _expert_metadata(variety: Variety) -> PolicyMetadata:
    name = PolicyKind.EXPERT.value + ("" if variety is NONE else f":{variety.name}")
    return PolicyMetadata(name=name, cameras=())


def source(
    name: str, tasks: Sequence[TaskInfo] = (), batching: Batching | None = None
) -> PolicySource:
    """Look a policy up.

    Args:
        name: See `parse_choice`.
        tasks: Tasks that it will play; an expert's version is that of the scripts of these tasks.
        batching: How many observations a batch of a `BatchPolicy` has; None takes the default.

    Raises:
        UnknownNameError: If the name or its variety is unknown.
        PolicyError: If the module or its attribute is missing, or gives something else; if a task
            has no expert.
    """
    choice = replace(parse_choice(name), batching=batching)
    return find_source(choice, tasks, TimeLimits())


def find_source(
    choice: PolicyChoice, tasks: Sequence[TaskInfo], limits: TimeLimits
) -> PolicySource:
    """Make the policy of a choice, or connect to it."""
    if choice.address is not None:
        return _apart(choice.address)
    if choice.server is not None:
        return _served(choice, choice.server, limits)
    if choice.kind.is_scripted:
        return _scripted(choice, tasks)
    made, metadata, batching = make_batched(choice.name, choice.batching)
    policy = SessionPolicy(made, batching or ONE_BY_ONE, is_contained=True)
    return _for_any(policy, metadata, batching)


def _scripted(choice: PolicyChoice, tasks: Sequence[TaskInfo]) -> PolicySource:
    if choice.kind is PolicyKind.EXPERT:
        variety = choice.variety
        modules = {find_script(task.reference).__module__ for task in tasks}
        if variety is not NONE:
            modules.add(Variety.__module__)
        metadata = _expert_metadata(variety)
        bind = partial(ExpertPolicy, variety=variety)
    else:
        modules = {script.__module__ for script in blind.SCRIPTS.values()}
        modules |= {find_script(task).__module__ for task in blind.SCRIPTS}
        metadata = BlindPolicy.metadata
        bind = BlindPolicy
    if choice.batching is not None:
        raise no_batches(choice.name)
    return PolicySource(
        metadata=replace(metadata, version=source_version(*modules)), bind=bind
    )


def _served(
    choice: PolicyChoice, server: RemoteServer, limits: TimeLimits
) -> PolicySource:
    path = SERVED.get(choice.name, OPENPI)
    remote = resolve_name(path)(replace(server, answer_s=limits.served_s))
    return _for_any(remote, remote.metadata, remote.batching)


def _apart(address: PolicyAddress) -> PolicySource:
    """A policy in a process of its own, which its parent looks after: here is no time limit."""
    from duobench.policy.serving.client import OwnPolicy

    remote = OwnPolicy(
        RemoteServer(
            url=address.url, key=address.key, answer_s=MAX_S, wait_s=_ANSWERING_S
        )
    )
    return replace(
        _for_any(remote, remote.metadata, address.batching), waits_for_others=True
    )


def _for_any(
    policy: Any, metadata: PolicyMetadata, batching: Batching | None
) -> PolicySource:
    return PolicySource(
        metadata=metadata,
        bind=lambda _env: policy,
        close=policy.close,
        batching=batching,
    )
