"""Make the robot's meshes and compare them with the file in the package, or renew it."""

from __future__ import annotations

import argparse
import hashlib
import sys
from pathlib import Path

from duobench.errors import AssetError
from duobench.scene.robot import meshes as shipped
from tools.meshes.build import build, encode
from tools.meshes.originals import originals

TARGET = Path(shipped.__file__).with_name(shipped.FILE)


def main() -> int:
    """Return 0 if what was made is what the package ships."""
    parser = argparse.ArgumentParser(prog="python -m tools.meshes", description=__doc__)
    parser.add_argument("folder", type=Path, help="holds the published mesh files, anywhere below")
    parser.add_argument("--write", action="store_true", help=f"renew {TARGET.name}")
    arguments = parser.parse_args()
    try:
        data = encode(build(originals(arguments.folder)))
    except AssetError as error:
        parser.exit(2, f"{error}\n")
    digest = hashlib.sha256(data).hexdigest()
    if arguments.write:
        TARGET.write_bytes(data)
        print(f"Wrote {TARGET}.")
    if not TARGET.is_file() or TARGET.read_bytes() != data:
        print(f"Different from {TARGET}: what was made has the SHA-256 {digest}.")
        return 1
    if digest != shipped.SHA256:
        print(f'Set SHA256 = "{digest}" in {shipped.__file__}.')
        return 1
    print(f"Identical to {TARGET}, SHA-256 {digest}.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
