"""Where a policy is served, and how it is asked: data, without a connection."""

from __future__ import annotations

from dataclasses import dataclass, field
from urllib.parse import SplitResult, urlsplit

from duobench.errors import ServingError
from duobench.policy.serving import access
from duobench.policy.serving.layout import Layout

ANSWER_S = 110.0
"""Default seconds for one answer: under the limit of an evaluation, which ends the episode."""
WAIT_S = 60.0
"""Default seconds to wait for a server that is not there yet, or not there again."""
WEBSOCKET = ("ws", "wss")
"""What the address of a WebSocket begins with."""


@dataclass(frozen=True, kw_only=True, slots=True)
class RemoteServer:
    """Where a policy is served, and how it is asked; nothing of it is written to a record."""

    url: str
    """Address, such as ws://HOST:PORT, with a path if the server has one."""
    key: str | None = field(default=None, repr=False)
    """What the server asks for."""
    layout: Layout | None = None
    """How a server that is not ours is asked; None sends our own observations."""
    execute: int | None = None
    """Actions that are executed of each chunk; None takes all."""
    answer_s: float = ANSWER_S
    """Seconds for one answer."""
    wait_s: float = WAIT_S
    """Seconds to wait for a server that is not there."""
    schemes: tuple[str, ...] = WEBSOCKET
    """What the address may begin with, which the kind of the server decides; of a kind without
    any, the address is HOST:PORT."""

    def __post_init__(self) -> None:
        """Reject what is no address, or holds more than one."""
        parts = self.parts
        if parts.scheme not in (self.schemes or ("",)) or not parts.hostname:
            raise ServingError(f"The address of a server is {self._form}.")
        if not self.schemes and (parts.path or parts.port is None):
            raise ServingError(f"The address of this kind of server is {self._form}.")
        if parts.username is not None or parts.query or parts.fragment:
            raise ServingError(
                "The address of a server holds no key: put it into the environment variable "
                f"{access.KEY_VARIABLE}, or into a file."
            )
        if not (self.answer_s > 0 and self.wait_s >= 0 and (self.execute or 1) >= 1):
            raise ServingError(
                "Times are positive, and at least one action of a chunk is executed."
            )

    @property
    def parts(self) -> SplitResult:
        """The parts of the address."""
        try:
            parts = urlsplit(self.url if self.schemes else f"//{self.url}")
            parts.port  # noqa: B018 - raises where it is no number
        except ValueError as error:
            raise ServingError(f"The address of a server is {self._form}.") from error
        return parts

    @property
    def _form(self) -> str:
        return " or ".join(f"{scheme}://HOST:PORT" for scheme in self.schemes) or "HOST:PORT"
