"""A certificate for a page that other machines in the network open.

Browsers give WebXR to secure pages only, and a token is a secret only where nobody listens. A
certificate that nobody has signed protects from listeners; a browser still asks once whether to
trust it.
"""

from __future__ import annotations

import socket
import ssl
from collections.abc import Collection
from contextlib import suppress
from dataclasses import dataclass

from duobench.errors import ServingError
from duobench.machine import install_extra, is_loopback

_ELSEWHERE = "192.0.2.1"
"""An address for documentation [RFC 5737]; nothing is sent to it."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Certificate:
    """What a server shows to browsers."""

    context: ssl.SSLContext
    """How connections are encrypted."""
    hosts: tuple[str, ...]
    """Names and addresses that it holds for; the first one goes into the address of the page."""


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

    Raises:
        ServingError: The package that makes certificates is not installed, or a host is no name.
    """
    try:
        import trustme  # pyright: ignore[reportMissingImports] - an extra
    except ImportError as error:
        raise ServingError(
            "A page for other machines needs a certificate, which trustme makes; it is not "
            f"installed. {install_extra('teleop')}"
        ) from error
    names = tuple(hosts) or own_hosts()
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    try:
        trustme.CA(organization_name="DuoBench").issue_cert(*names).configure_cert(context)
    except ValueError as error:
        raise ServingError(f"There is no certificate for {', '.join(names)}: {error}.") from error
    others = [name for name in names if not is_loopback(name)]
    return Certificate(context=context, hosts=tuple(dict.fromkeys([*others, *names])))
