"""Rounds that an organiser of a leaderboard has played, each with a salt; see docs/hosting.md."""

import tomllib
from datetime import date
from pathlib import Path
from typing import Annotated

import msgspec

from duobench.errors import EvaluationError
from duobench.results.salt import Salt

ROUNDS = "rounds.toml"
"""The file of rounds, beside the bundles."""
_Digest = Annotated[str, msgspec.Meta(pattern="^[0-9a-f]{64}$")]


class Round(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Bundles that an organiser has played under one salt."""

    name: str
    date: date
    """When the SHA-256 of the salt was published."""
    salt_sha256: _Digest
    bundles: tuple[_Digest, ...] = ()
    """SHA-256 of each bundle."""
    salt: str | None = None
    """The salt itself in hexadecimal digits, once it is published."""

    def __post_init__(self) -> None:
        if self.salt is not None and Salt(self.salt).sha256 != self.salt_sha256:
            raise EvaluationError(f"the salt of {self.name!r} does not have its SHA-256.")


def read_rounds(path: Path) -> tuple[Round, ...]:
    """The rounds in a file; an `EvaluationError` if two have a name, salt or bundle in common."""
    try:
        rounds = msgspec.convert(
            tomllib.loads(path.read_text(encoding="utf-8"))["round"], tuple[Round, ...]
        )
        names = [each for one in rounds for each in (one.name, one.salt_sha256, *one.bundles)]
        if twice := {name for name in names if names.count(name) > 1}:
            raise EvaluationError(f"{min(twice)} is there twice, and belongs to one round.")
    except (OSError, ValueError, KeyError, EvaluationError) as error:
        raise EvaluationError(f"Cannot read the rounds in {path}: {error}") from error
    return rounds
