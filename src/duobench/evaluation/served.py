"""The kinds of servers that a policy may be asked at, by the name under which one is evaluated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pkgutil import resolve_name
from types import MappingProxyType
from typing import Any

from duobench.policy.serving import importing
from duobench.policy.serving.address import WEBSOCKET, RemoteServer


@dataclass(frozen=True, kw_only=True, slots=True)
class ServerKind:
    """How servers of one kind are asked."""

    client: str
    """Import path of the class that connects when it is called with a `RemoteServer`."""
    schemes: tuple[str, ...] = WEBSOCKET
    """What the address of such a server may begin with."""

    def connect(self, server: RemoteServer) -> Any:
        """Connect to a server of this kind.

        Returns:
            The policy there: a `Policy` with `batching` (None if unknown) and `close`.

        Raises:
            ServingError: If the server cannot be asked, or a package is missing.
            MachineryError: If there is no server.
        """
        with importing():
            client = resolve_name(self.client)
        return client(server)


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
