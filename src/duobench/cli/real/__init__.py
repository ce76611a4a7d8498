"""`duobench real`: real arms, or the simulated drivers in their place."""

from __future__ import annotations


def verbs() -> None:
    """Lead, record and evaluate on real arms; not yet tried on an arm."""
