"""A salt: the secret that the seeds of the split "salted" follow from.

Whoever evaluates publishes its SHA-256 before and the salt itself afterwards. It never leaves the
process that reads it: runs and records hold its SHA-256, and workers and policies get seeds.
"""

import hashlib
import hmac
import os
import secrets
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from duobench.errors import EvaluationError
from duobench.files import make_folder, writing
from duobench.randomness import SUITE_VERSION

SALT_BYTES = 32
"""Fewest bytes of a salt: as long as its SHA-256, so that nobody finds it by trying."""
_SECRET_MODE = 0o600
_LONGEST_FILE = 4096


class Seeds(NamedTuple):
    """The seeds of an episode, 32 bits each."""

    episode: int
    """That of the reset."""
    policy: int


@dataclass(frozen=True, slots=True)
class Salt:
    """A secret of at least `SALT_BYTES` bytes, which no text of this object shows."""

    secret: bytes = field(repr=False)

    def __post_init__(self) -> None:
        if len(self.secret) < SALT_BYTES:
            raise EvaluationError(
                f"A salt has at least {SALT_BYTES} bytes, {2 * SALT_BYTES} digits; this one has "
                f"{len(self.secret)} bytes."
            )

    @classmethod
    def parse(cls, text: str) -> "Salt":
        """A salt from its hexadecimal digits; the message of an error has none of them."""
        try:
            return cls(bytes.fromhex(text))
        except ValueError:
            raise EvaluationError("A salt is one line of hexadecimal digits.") from None

    @property
    def sha256(self) -> str:
        """SHA-256 of its bytes, in hexadecimal digits."""
        return hashlib.sha256(self.secret).hexdigest()

    def seeds(self, task_id: str, episode: int) -> Seeds:
        """Seeds of the n-th episode of a task in this suite version.

        They are HMAC-SHA256 modulo 2^32, with the salt as key, of "episode" or "policy", task, suite
        version and index, joined by the character 0x1f. So neither says anything of the other.
        """
        return Seeds(*(self._number(kind, task_id, episode) for kind in Seeds._fields))

    def _number(self, kind: str, task_id: str, episode: int) -> int:
        text = "\x1f".join((kind, task_id, SUITE_VERSION, str(int(episode))))
        digest = hmac.digest(self.secret, text.encode(), "sha256")
        return int.from_bytes(digest, "big") % 2**32


def read_salt(path: Path) -> Salt:
    """The salt in a file of one line of hexadecimal digits.

    Raises:
        EvaluationError: There is no file, or no salt in it.
    """
    try:
        with path.open("rb") as file:
            return Salt.parse(file.read(_LONGEST_FILE).decode("ascii", "replace"))
    except OSError as error:
        raise EvaluationError(f"Cannot read the salt in {path}: {error.strerror}.") from error
    except EvaluationError as error:
        raise EvaluationError(f"{path} holds no salt. {error}") from None


def make_salt(path: Path) -> Salt | None:
    """Write a new salt into a new file, which its owner alone may read; None if there is a file.

    Raises:
        OutputError: It cannot be written.
    """
    make_folder(path.parent)
    salt = Salt(secrets.token_bytes(SALT_BYTES))
    with writing(path):
        try:
            handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, _SECRET_MODE)
        except FileExistsError:
            return None
        with open(handle, "w", encoding="ascii") as file:
            file.write(salt.secret.hex() + "\n")
            file.flush()
            os.fsync(handle)
    return salt
