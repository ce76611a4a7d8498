"""Access to a page: allowed addresses, certificate, token, and origins that may connect.

Browsers give WebXR to secure pages only, and a token is a secret only where no one listens. A
certificate without a signature protects from listeners; a browser still asks once whether to
trust it.
"""

import hashlib
import hmac
import secrets
import socket
import ssl
from collections.abc import Collection
from contextlib import suppress
from dataclasses import dataclass
from urllib.parse import parse_qs, urlsplit

from duobench.core.errors import ServingError
from duobench.core.machine import is_loopback, load_extra

_TOKEN_BYTES = 16
_ELSEWHERE = "192.0.2.1"
"""An address for documentation [RFC 5737]; nothing is sent to it."""
_MAX_FIELDS = 16
"""Fields of a query that are read."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Certificate:
    """Certificate that a server shows to browsers."""

    context: ssl.SSLContext
    """Encryption of connections."""
    hosts: tuple[str, ...]
    """Names and addresses that it holds for; the first one goes into the address of the page."""
    fingerprint: str
    """SHA-256 of it, as browsers show it: 32 numbers in hexadecimal, such as `1F:0A:...`."""


def own_hosts() -> tuple[str, ...]:
    """Address and name of this machine in its network, and those that it has for itself."""
    found = []
    with suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.connect((_ELSEWHERE, 9))  # chooses an interface, and sends nothing
        found.append(probe.getsockname()[0])
    name = socket.gethostname()
    found += [name, f"{name}.local"] if name else []
    return tuple(dict.fromkeys([*found, "127.0.0.1", "localhost"]))


def make_certificate(hosts: Collection[str] = ()) -> Certificate:
    """Make a certificate for this machine, which lives as long as this process.

    Args:
        hosts: Names and addresses that it holds for; none means those of `own_hosts`.
    """
    needed = "A page for other machines needs a certificate, which trustme makes"
    trustme = load_extra("trustme", "teleop", needed, ServingError)
    names = tuple(hosts) or own_hosts()
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    try:
        made = trustme.CA(organization_name="DuoBench").issue_cert(*names)
    except ValueError as error:
        raise ServingError(
            f"There is no certificate for {', '.join(names)}: {error}."
        ) from error
    made.configure_cert(context)
    content = ssl.PEM_cert_to_DER_cert(made.cert_chain_pems[0].bytes().decode())
    fingerprint = hashlib.sha256(content).digest().hex(":").upper()
    others = [name for name in names if not is_loopback(name)]
    hosts = tuple(dict.fromkeys([*others, *names]))
    return Certificate(context=context, hosts=hosts, fingerprint=fingerprint)


def check_address(host: str, certificate: Certificate | None) -> None:
    """Reject an address at which the token would go through the network in the clear."""
    if certificate is None and not is_loopback(host):
        raise ServingError(
            f"A page at {host or 'every address'} is reached by other machines, which needs a "
            "certificate: without one anybody in the network reads the token, and no browser lets "
            "a headset in. Make one with duobench.web.access.make_certificate, or stay at "
            "127.0.0.1."
        )


class Admission:
    """Decides about requests: a token in the address, and pages of this server alone.

    Other machines may know the server by the names and addresses that are its hosts.
    """

    def __init__(self, hosts: Collection[str]) -> None:
        self.token = secrets.token_urlsafe(_TOKEN_BYTES)
        """Token that the address must hold."""
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
