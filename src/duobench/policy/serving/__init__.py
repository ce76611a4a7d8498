"""Policies at the other end of a WebSocket: a server and clients, in the protocols of the field.

Importing this loads neither `websockets` nor `msgpack`; its modules do.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from duobench.errors import ServingError
from duobench.installing import install_extra

_PACKAGES = ("msgpack", "websockets")


@contextmanager
def importing() -> Iterator[None]:
    """Say what to install where a module of this package cannot be imported.

    Raises:
        ServingError: In place of the error about a package that is missing.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in _PACKAGES:
            raise
        raise ServingError(
            f"Serving policies, and asking served ones, needs the package {error.name!r}. "
            f"{install_extra('serve')}"
        ) from error
