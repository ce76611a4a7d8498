"""Where the verbs print."""

from __future__ import annotations

from rich.console import Console

PLAIN_WIDTH = 130
"""Columns when the output goes to a file or another program, which never wraps."""


def console() -> Console:
    """Standard output: coloured and as wide as the terminal, or plain and of one width.

    Text is printed as it is: `[name]` and `:name:` come from people, not from us, and only a
    terminal breaks its lines.
    """
    out = Console(highlight=False, markup=False, emoji=False, soft_wrap=True)
    if not out.is_terminal:
        out.width = PLAIN_WIDTH
    return out


def counted(count: int, noun: str) -> str:
    """A number and what it counts, such as "1 task" and "2 tasks"."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"
