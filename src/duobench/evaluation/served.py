"""The kinds of servers of policies, by the name under which one is evaluated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from duobench.policy.serving.address import WEBSOCKET


@dataclass(frozen=True, kw_only=True, slots=True)
class ServerKind:
    """How servers of one kind are used."""

    client: str
    """Import path of the class that connects when it is called with a `RemoteServer`: a `Policy`
    that also has `batching`, None if that is unknown, and `close`."""
    schemes: tuple[str, ...] = WEBSOCKET
    """What the address of such a server may begin with."""


OPENPI = ServerKind(client="duobench.policy.serving.client:RemotePolicy")
"""Those of DuoBench, and all others that speak openpi's protocol."""
SERVED: Mapping[str, ServerKind] = MappingProxyType(
    {
        "openpi": OPENPI,
        "vla-eval": ServerKind(client="duobench.policy.serving.vla_eval:VlaEvalPolicy"),
        "vlagents": ServerKind(
            client="duobench.policy.serving.vlagents:VLAgentsPolicy", schemes=()
        ),
    }
)
"""Names of policies that somebody else serves."""
