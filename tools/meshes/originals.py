"""Find the published files that the meshes are made from."""

from __future__ import annotations

import hashlib
from pathlib import Path

from duobench.errors import AssetError

DIGESTS = Path(__file__).with_name("originals.sha256")
"""SHA-256 and name of every file, in the format of `sha256sum`."""

_SUFFIXES = {".obj", ".stl"}


def originals(folder: Path, digests: Path = DIGESTS) -> dict[str, bytes]:
    """Return the bytes of every original by name.

    Files are taken by content: it does not matter how the folder names and arranges them.

    Args:
        folder: Searched with everything below it.
        digests: What to look for.

    Raises:
        AssetError: The folder does not hold all of them.
    """
    wanted = dict(line.split() for line in digests.read_text("utf-8").splitlines())
    found: dict[str, bytes] = {}
    for path in sorted(folder.rglob("*")):
        if path.suffix in _SUFFIXES and path.is_file():
            data = path.read_bytes()
            if name := wanted.get(hashlib.sha256(data).hexdigest()):
                found[name] = data
    if missing := sorted(set(wanted.values()) - set(found)):
        raise AssetError(
            f"{folder} lacks {len(missing)} of {len(wanted)} originals, or has them with other "
            f"bytes: {', '.join(missing)}. Give a checkout of MuJoCo Menagerie or another folder "
            f"that holds the files of {digests.name}."
        )
    return found
