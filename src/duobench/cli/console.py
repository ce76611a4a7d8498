"""Where the verbs print."""

from __future__ import annotations

from rich.console import Console

PLAIN_WIDTH = 130
"""Columns when the output goes to a file or another program, which never wraps."""


def console() -> Console:
    """Standard output: coloured and as wide as the terminal, or plain and of one width."""
    out = Console(highlight=False)
    return out if out.is_terminal else Console(highlight=False, width=PLAIN_WIDTH)
