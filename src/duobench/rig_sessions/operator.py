"""The operator at a terminal: what is said, what is asked, and keys that count at once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

QUIT = "q"
"""Key that ends a session."""


class Operator(Protocol):
    """A person beside the arms, or a program in that place."""

    def say(self, text: str) -> None:
        """Show some lines."""
        ...

    def ask(self, text: str, keys: str) -> str:
        """Ask for a key, and wait for it.

        Args:
            text: The question.
            keys: The keys that answer it.

        Returns:
            One of them; `QUIT` if nobody can answer any more.
        """
        ...

    def listen(self, call: Callable[[str], None] | None) -> None:
        """Have every key given to a call at once, from any thread; None ends it.

        One who has gone gives an empty text.
        """
        ...
