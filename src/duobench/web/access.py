"""Who may see a page: what an address needs, the token, and the pages that may connect."""

from __future__ import annotations

import hmac
import secrets
from collections.abc import Collection
from urllib.parse import parse_qs, urlsplit

from duobench.errors import ServingError
from duobench.machine import is_loopback
from duobench.web.certificate import Certificate

_TOKEN_BYTES = 16
_UNRESERVED = frozenset("ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-._~")
_MAX_FIELDS = 16
"""Fields of a query that are read."""


def check_address(host: str, certificate: Certificate | None) -> None:
    """Reject an address at which the token would go through the network in the clear.

    Raises:
        ServingError: Other machines reach the address, and there is no certificate.
    """
    if certificate is None and not is_loopback(host):
        raise ServingError(
            f"A page at {host or 'every address'} is reached by other machines, which needs a "
            "certificate: without one anybody in the network reads the token, and no browser lets "
            "a headset in. Make one with duobench.web.certificate.make_certificate, or stay at "
            "127.0.0.1."
        )


class Admission:
    """Decides about requests: a token in the address, and pages of this server alone."""

    def __init__(self, token: str | None, hosts: Collection[str]) -> None:
        """Remember what is asked for.

        Args:
            token: What the address must hold; None makes one up.
            hosts: Names and addresses by which other machines may know the server.

        Raises:
            ServingError: The token is none that can stand in an address as it is.
        """
        self.token = secrets.token_urlsafe(_TOKEN_BYTES) if token is None else token
        """What the address must hold."""
        if not self.token or set(self.token) - _UNRESERVED:
            raise ServingError(
                "A token consists of ASCII letters, digits, '-', '.', '_' and '~'; got another one."
            )
        self._hosts = frozenset(hosts)

    def has_token(self, query: str) -> bool:
        """Whether the query of an address holds the token."""
        try:
            given = parse_qs(query, max_num_fields=_MAX_FIELDS).get("token", [""])[0]
        except ValueError:
            return False
        return hmac.compare_digest(given.encode(), self.token.encode())

    def is_own_page(self, origin: str | None, host: str) -> bool:
        """Whether a connection comes from a page of this server, or from no page at all.

        A browser says of which origin a page is that connects. It must be the host that it
        connects to, and that must be a name of this server: a foreign name may lead here too.

        Args:
            origin: The header `Origin`; None for a program, which needs the token alone.
            host: The header `Host`.
        """
        try:
            name = urlsplit(f"//{host}").hostname or ""
            own = origin is None or urlsplit(origin).netloc == host
        except ValueError:
            return False
        return own and (is_loopback(name) or name in self._hosts)
