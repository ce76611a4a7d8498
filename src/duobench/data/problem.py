"""What `duobench data check` finds."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, kw_only=True, slots=True)
class Problem:
    """Something that is wrong with a file."""

    path: Path
    """The file."""
    what: str
    """What is wrong, as a sentence."""
