"""A salt: the secret that the seeds of the split "salted" follow from; and an organiser's rounds.

It never leaves the process that reads it: runs hold its SHA-256, workers and policies get seeds. An
organiser publishes its SHA-256 before a round and itself afterwards; see duobench docs hosting.
"""

import hashlib
import hmac
import os
import re
import secrets
import tomllib
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import date
from pathlib import Path
from typing import Annotated

import msgspec

from duobench.core.errors import EvaluationError
from duobench.core.files import read_text, reading, writing
from duobench.core.randomness import SUITE_VERSION

SALT_BYTES = 32
"""Fewest bytes of a salt: as many as its SHA-256 has, so that trying does not find it."""
ROUNDS = "rounds.toml"
"""The file of an organiser's rounds, beside the bundles of a leaderboard."""
Seeds = tuple[int, int]
"""Seeds of the reset and of the policy in an episode, 32 bits each."""
_Digest = Annotated[str, msgspec.Meta(pattern=r"^[0-9a-f]{64}\Z")]


@dataclass(frozen=True, slots=True)
class Salt:
    """A secret in hexadecimal digits, which no text of this object or of an error shows."""

    digits: str = field(repr=False)

    def __post_init__(self) -> None:
        if not re.fullmatch(rf"([0-9a-f]{{2}}){{{SALT_BYTES},}}", self.digits):
            raise EvaluationError(f"A salt is {2 * SALT_BYTES} hexadecimal digits or more.")

    @property
    def sha256(self) -> str:
        """SHA-256 of its bytes, in hexadecimal digits."""
        return hashlib.sha256(bytes.fromhex(self.digits)).hexdigest()

    def seeds(self, task_id: str, episode: int) -> Seeds:
        """Seeds of the n-th episode of a task in this suite version; neither tells the other.

        They are HMAC-SHA256 modulo 2^32, with the salt as key, of "episode" or "policy", task,
        suite version and index, joined by the character 0x1f.
        """
        return self._number("episode", task_id, episode), self._number("policy", task_id, episode)

    def _number(self, *words: str | int) -> int:
        text = "\x1f".join(map(str, (*words[:2], SUITE_VERSION, *words[2:])))
        digest = hmac.digest(bytes.fromhex(self.digits), text.encode(), "sha256")
        return int.from_bytes(digest, "big") % 2**32


def read_salt(path: Path) -> Salt:
    """The salt in a file of one line; an `EvaluationError` that shows none of it if it is none."""
    try:
        return Salt(read_text(path).strip().lower())
    except (OSError, ValueError, EvaluationError) as error:
        reason = (
            getattr(error, "strerror", None) or f"it has no {2 * SALT_BYTES} hexadecimal digits"
        )
        raise EvaluationError(f"Cannot read a salt from {path}: {reason}.") from None


def make_salt(path: Path) -> bool:
    """Write a new salt into a file that its owner alone may read, unless there is a file."""
    with writing(path), suppress(FileExistsError):
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(handle, "w") as file:
            file.write(f"{secrets.token_hex(SALT_BYTES)}\n")
        return True
    return False


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
        if self.salt is None:
            return
        msgspec.structs.force_setattr(self, "salt", self.salt.lower())
        if Salt(self.salt).sha256 != self.salt_sha256:
            raise EvaluationError(f"The salt of {self.name!r} does not have its SHA-256.")


def read_rounds(path: Path) -> tuple[Round, ...]:
    """The rounds in a file; an `EvaluationError` if two have a name, salt or bundle in common."""
    with reading(f"the rounds in {path}", EvaluationError):
        content = tomllib.loads(read_text(path))
        if content.keys() != {"round"}:
            raise ValueError("it holds rounds, each below a line [[round]], and nothing else")
        try:
            rounds = msgspec.convert(content["round"], tuple[Round, ...])
        except EvaluationError as error:
            raise ValueError(str(error)) from error
        names = [each for one in rounds for each in (one.name, one.salt_sha256, *one.bundles)]
        twice = {name for name in names if names.count(name) > 1}
        if twice:
            raise ValueError(f"{min(twice)} is there twice, and belongs to one round")
    return rounds
