"""Write MuJoCo's type stubs, which its wheel does not carry, into `typings/`.

The generator reads the compiled bindings. They convert whatever NumPy can read as an array, but
describe themselves as taking a sequence of floats, which an array is not, or an array, which a
tuple is not. The stubs written here say array-like in both places. Arrays that a function writes
into stay arrays.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

TYPINGS = Path(__file__).parents[2] / "typings"
PACKAGE = "mujoco"
UNUSED = ("glfw", "rendering")
"""Parts that need packages without types, and that DuoBench does not import."""

_NUMBER = r"typing\.Supports(?:Float|Int) \| typing\.SupportsIndex"
_SEQUENCE = re.compile(rf"collections\.abc\.Sequence\[{_NUMBER}\]")
_SETTER = re.compile(r"(\.setter\n +def \w+\(self, \w+: ).*NDArray.*(\) -> None:)")
_ARRAY_LIKE = "numpy.typing.ArrayLike"


def generate(folder: Path) -> None:
    """Write stubs of the installed MuJoCo into a folder, as `mujoco/`.

    Raises:
        subprocess.CalledProcessError: The generator failed.
    """
    generator = [sys.executable, "-m", "pybind11_stubgen", "--ignore-all-errors"]
    subprocess.run([*generator, "-o", folder, PACKAGE], check=True)
    for name in UNUSED:
        shutil.rmtree(folder / PACKAGE / name, ignore_errors=True)
    for path in (folder / PACKAGE).glob("*.pyi"):
        path.write_text(widen(path.read_text(encoding="utf-8")), encoding="utf-8")


def widen(stub: str) -> str:
    """Let everything that the bindings convert to an array be array-like."""
    return _SETTER.sub(rf"\1{_ARRAY_LIKE}\2", _SEQUENCE.sub(_ARRAY_LIKE, stub))


def main() -> None:
    """Replace the stubs in `typings/`."""
    argparse.ArgumentParser(
        prog="python -m dev.tools.mujoco_stubs", description=__doc__
    ).parse_args()
    with tempfile.TemporaryDirectory() as folder:
        generate(Path(folder))
        shutil.rmtree(TYPINGS / PACKAGE, ignore_errors=True)
        shutil.move(Path(folder) / PACKAGE, TYPINGS / PACKAGE)


if __name__ == "__main__":
    main()
