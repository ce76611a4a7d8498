"""A salt: the secret that the seeds of the split "salted" follow from; see docs/hosting.md.

It never leaves the process that reads it: runs hold its SHA-256, workers and policies get seeds.
"""

import hashlib
import hmac
import os
import secrets
from dataclasses import dataclass, field
from pathlib import Path

from duobench.errors import EvaluationError
from duobench.files import writing
from duobench.randomness import SUITE_VERSION

SALT_BYTES = 32
"""Fewest bytes of a salt: as many as its SHA-256 has, so that trying does not find it."""
_LONGEST_FILE = 4096

Seeds = tuple[int, int]
"""Seeds of the reset and of the policy in an episode, 32 bits each."""


@dataclass(frozen=True, slots=True)
class Salt:
    """A secret in hexadecimal digits, which no text of this object or of an error shows."""

    digits: str = field(repr=False)
    _secret: bytes = field(init=False, repr=False)

    def __post_init__(self) -> None:
        try:
            secret = bytes.fromhex(self.digits)
        except ValueError:
            secret = b""
        if len(secret) < SALT_BYTES:
            raise EvaluationError(f"A salt is {2 * SALT_BYTES} hexadecimal digits or more.")
        object.__setattr__(self, "_secret", secret)

    @property
    def sha256(self) -> str:
        """SHA-256 of its bytes, in hexadecimal digits."""
        return hashlib.sha256(self._secret).hexdigest()

    def seeds(self, task_id: str, episode: int) -> Seeds:
        """Seeds of the n-th episode of a task in this suite version; neither tells the other.

        They are HMAC-SHA256 modulo 2^32, with the salt as key, of "episode" or "policy", task,
        suite version and index, joined by the character 0x1f.
        """
        episodes, policies = (
            hmac.digest(
                self._secret,
                "\x1f".join((word, task_id, SUITE_VERSION, str(episode))).encode(),
                "sha256",
            )
            for word in ("episode", "policy")
        )
        return int.from_bytes(episodes[-4:], "big"), int.from_bytes(policies[-4:], "big")


def read_salt(path: Path) -> Salt:
    """The salt in a file of one line; an `EvaluationError` if there is none."""
    try:
        with path.open("rb") as file:
            return Salt(file.read(_LONGEST_FILE).decode("ascii", "replace"))
    except (OSError, EvaluationError) as error:
        reason = f"{error.strerror}." if isinstance(error, OSError) else error
        raise EvaluationError(f"Cannot read the salt in {path}: {reason}") from None


def make_salt(path: Path) -> bool:
    """Write a new salt into a file that its owner alone may read, unless there is a file."""
    with writing(path):
        try:
            handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        except FileExistsError:
            return False
        with os.fdopen(handle, "w") as file:
            file.write(f"{secrets.token_hex(SALT_BYTES)}\n")
    return True
