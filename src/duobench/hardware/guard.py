"""The guard: our own simulation of the arms, asked before anything moves.

The control boxes of two arms know nothing of each other, nor of the table. MuJoCo is loaded at
first use.
"""

from __future__ import annotations

from duobench.types import Array


class Guard:
    """Keeps the arms apart, and off the table and their mount."""

    def problem(self, joints: Array) -> str | None:
        """What is too near at joint positions (2, 7) in radians; None if nothing is."""
        del joints
        return None

    def way(self, start: Array, end: Array) -> list[Array]:
        """Joint positions (2, 7) to go through, the end last, each straight from the one before.

        Raises:
            BackendError: None was found.
        """
        del start
        return [end]

    def close(self) -> None:
        """Free what images need."""
