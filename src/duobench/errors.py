"""The error family: everything DuoBench raises on purpose derives from `DuoBenchError`.

A message says what was wrong, what was given, what would have worked, and what to try next.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class DuoBenchError(Exception):
    """Base of every error that DuoBench raises on purpose."""


class AssetError(DuoBenchError):
    """A data file is missing, damaged, or not of its format."""


class UnknownNameError(DuoBenchError, LookupError):
    """A name (task, object, camera, option, policy) is not known; the message lists near misses."""

    def __init__(self, kind: str, name: object, known: Iterable[str]) -> None:
        """Compose the message.

        Args:
            kind: What the name should have named, such as "task".
            name: The name that was given.
            known: Every name that would have worked.
        """
        names = sorted(known)
        near = difflib.get_close_matches(str(name), names, n=3)
        hint = f" Did you mean {' or '.join(map(repr, near))}?" if near else ""
        super().__init__(f"Unknown {kind} {name!r}.{hint} Known: {', '.join(names) or '(none)'}.")


class OptionError(DuoBenchError, ValueError):
    """An option of an environment has a value that cannot be."""


class LayoutError(DuoBenchError):
    """A layout is incomplete, overlapping or out of reach, or none could be drawn."""


class ActionError(DuoBenchError, ValueError):
    """An action has the wrong shape or holds NaN or infinity; the environment stays usable."""


class BackendError(DuoBenchError):
    """The arms cannot go on; the episode is over."""


class SimulationError(BackendError):
    """The physics became invalid: diverged, or a buffer of the engine overflowed."""


class RenderingError(DuoBenchError):
    """No off-screen OpenGL backend works; the message says what to install."""


class PolicyError(DuoBenchError):
    """A policy does not fit the environment, or it returned something that is no action chunk."""


class EvaluationError(DuoBenchError):
    """A run folder belongs to another evaluation, or a record in it cannot be read."""
