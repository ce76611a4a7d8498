import sys
from pathlib import Path

import pytest

from dev.tools.mujoco_stubs import PACKAGE, generate, widen
from tests.children import ran

# Each line is right by what the bindings take and return, except where the comment says otherwise.
USE = """
import mujoco
import numpy as np

spec = mujoco.MjSpec()
body = spec.worldbody.add_body(name="box", pos=np.zeros(3), quat=(1, 0, 0, 0))
body.ipos = (0.0, 0.0, 0.1)
height: float = body.ipos[2]
body.positon = (0.0, 0.0, 0.1)  # misspelt
body.add_geom(mass="heavy")  # not a number
mujoco.mj_step(spec.compile())  # no data
"""
WRONG = [9, 10, 11]


@pytest.mark.parametrize(
    ("stub", "widened"),
    [
        (
            "pos: collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex] | None",
            "pos: numpy.typing.ArrayLike | None",
        ),
        (
            "@pos.setter\n    def pos(self, arg1: numpy.typing.NDArray[numpy.float64]) -> None:",
            "@pos.setter\n    def pos(self, arg1: numpy.typing.ArrayLike) -> None:",
        ),
        ("names: collections.abc.Sequence[str]", "names: collections.abc.Sequence[str]"),
        (
            "def mju_add(res: numpy.typing.NDArray[numpy.float64]) -> None:",
            "def mju_add(res: numpy.typing.NDArray[numpy.float64]) -> None:",
        ),
    ],
)
def test_what_is_converted_to_an_array_may_be_array_like(stub: str, widened: str) -> None:
    assert widen(stub) == widened


@pytest.mark.long
def test_the_checker_finds_wrong_uses_of_mujoco_and_no_others(tmp_path: Path) -> None:
    generate(tmp_path / "typings")
    assert (tmp_path / "typings" / PACKAGE / "__init__.pyi").is_file()
    (tmp_path / "use.py").write_text(USE)
    (tmp_path / "pyproject.toml").write_text('[tool.basedpyright]\ntypeCheckingMode = "standard"\n')
    checker = ["-m", "basedpyright", "--pythonpath", sys.executable]
    result = ran(*checker, "use.py", cwd=tmp_path)
    places = [line for line in result.stdout.splitlines() if " - error: " in line]
    assert [int(line.split(" - ")[0].split(":")[-2]) for line in places] == WRONG, result.stdout
