"""Address of a served policy, and its format: data, without a connection."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from urllib.parse import SplitResult, urlsplit

from duobench.core.errors import ServingError
from duobench.policy.batch import Batching
from duobench.policy.registry import MADE_ALONE, SCRIPTED, PolicyKind
from duobench.policy.serving import access
from duobench.policy.serving.message_format import MessageFormat

ANSWER_S = 110.0
"""Default seconds for one reply: under the limit of an evaluation, which ends the episode."""
WAIT_S = 60.0
"""Default seconds to wait for a server that is not there yet, or not there again."""
MAX_S = 86_400.0
"""Most seconds for one reply, and to wait: a day; sockets know no endless time."""
LOOPBACK = "127.0.0.1"
_SCHEMES = ("ws", "wss")
"""Schemes of the address of a server."""
_FORM = "The address of a server is ws://HOST:PORT or wss://HOST:PORT."

OPENPI = "duobench.policy.serving.client:OpenpiPolicy"
"""Client of the servers of DuoBench, and of all others that speak openpi's protocol."""
SERVED: Mapping[str, str] = {
    "openpi": OPENPI,
    "vla-eval": "duobench.policy.serving.vla_eval:VlaEvalPolicy",
}
"""Import paths of the clients, each a `ConnectedPolicy`, by the name under which a served
policy is evaluated."""
WORDS: Mapping[str, PolicyKind] = {
    **SCRIPTED,
    **MADE_ALONE,
    **dict.fromkeys(SERVED, PolicyKind.SERVED),
}
"""Every word that names a policy, and of which kind it is."""


@dataclass(frozen=True, kw_only=True, slots=True)
class PolicyAddress:
    """Address of a policy that an evaluation has started in a process of its own."""

    host: str = LOOPBACK
    port: int
    key: str
    """Key that it asks for; only those who play with it have it."""
    batching: Batching | None
    """Observations in a batch of it; None for a plain policy, which plays one episode
    at a time."""

    @property
    def url(self) -> str:
        """Address of the server."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"ws://{host}:{self.port}"


@dataclass(frozen=True, kw_only=True, slots=True)
class RemoteServer:
    """Address of a served policy, and its format; nothing of it is written to a record."""

    url: str
    """Address, such as ws://HOST:PORT, with a path if the server has one."""
    key: str | None = field(default=None, repr=False)
    message_format: MessageFormat | None = None
    """Format of a server that is not of DuoBench; None sends our own observations."""
    execute: int | None = None
    """Actions that are executed of each chunk; None takes all."""
    answer_s: float = ANSWER_S
    """Seconds for one reply."""
    wait_s: float = WAIT_S
    """Seconds to wait for a server that is not there."""

    def __post_init__(self) -> None:
        parts = self.parts
        if parts.scheme not in _SCHEMES or not _is_host(parts.hostname):
            raise ServingError(_FORM)
        if parts.username is not None or parts.query or parts.fragment:
            raise ServingError(
                "The address of a server holds no key: put it into the environment variable "
                f"{access.KEY_VARIABLE}, or into a file."
            )
        if not (0 < self.answer_s <= MAX_S and 0 <= self.wait_s <= MAX_S):
            raise ServingError(
                f"A server is waited for, and may take, up to {MAX_S:g} s; got {self.wait_s:g} and "
                f"{self.answer_s:g}."
            )
        if self.execute is not None and self.execute < 1:
            raise ServingError(
                f"At least one action of a chunk is executed, got {self.execute}."
            )

    @property
    def executed(self) -> str:
        """Executed part of each chunk, for the version of a policy."""
        count = "all" if self.execute is None else f"first {self.execute}"
        return f"{count} actions of a chunk"

    @property
    def parts(self) -> SplitResult:
        """The parts of the address."""
        try:
            parts = urlsplit(self.url)
            parts.port  # noqa: B018 - raises where it is no number
        except ValueError as error:
            raise ServingError(_FORM) from error
        return parts


def _is_host(name: str | None) -> bool:
    try:
        return bool(name) and not re.search(r"\s", name) and bool(name.encode("idna"))
    except UnicodeError:
        return False
