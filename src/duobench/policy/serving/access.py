"""Access to a server: the keys, and the hosts that need one."""

import hmac
import os
from pathlib import Path

from duobench.core.errors import ServingError
from duobench.core.files import read_text, reading
from duobench.core.machine import is_loopback

KEY_VARIABLE = "DUOBENCH_API_KEY"
"""Environment variable with a key; a command line would show it to everybody on the machine."""
_SCHEMES = ("Api-Key", "Bearer")


def read_key(file: Path | None = None) -> str | None:
    """The key of a server, from a file that holds nothing else or the environment, or None."""
    if file is None:
        key = os.environ.get(KEY_VARIABLE, "").strip()
        where = KEY_VARIABLE
    else:
        where = str(file)
        with reading(f"the key in {where}", ServingError):
            key = read_text(file).strip()
        if not key:
            raise ServingError(f"{where} holds no key.")
    if not all("!" <= letter <= "~" for letter in key):
        raise ServingError(f"The key in {where} is no single word of ASCII characters.")
    return key or None


def check_access(host: str, key: str | None) -> None:
    """Reject a server that other machines reach without a key."""
    if key is None and not is_loopback(host):
        raise ServingError(
            f"A server at {host or 'every address'} could be used by everyone who reaches it. Give "
            f"it a key, in {KEY_VARIABLE} or a file, or serve at 127.0.0.1."
        )


def headers(key: str | None) -> dict[str, str]:
    """Headers of a client's first request."""
    return {} if key is None else {"Authorization": f"{_SCHEMES[0]} {key}"}


def is_allowed(authorization: str | None, key: str | None) -> bool:
    """Whether the header of a request holds the key."""
    if key is None:
        return True
    scheme, _, given = (authorization or "").partition(" ")
    is_known = scheme.lower() in {name.lower() for name in _SCHEMES}
    return hmac.compare_digest(given.strip().encode(), key.encode()) and is_known
