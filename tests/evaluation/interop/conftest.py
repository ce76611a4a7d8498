"""Some of these tests need environments of their own; `make test-interop` makes them."""

import os

from tests.docs.markdown import ROOT
from tests.policy.serving.conftest import serve  # noqa: F401 - a fixture

OPENPI_PYTHON = "DUOBENCH_OPENPI_PYTHON"
"""Environment variable: the interpreter of an environment with openpi-client."""
VLA_EVAL_PYTHON = "DUOBENCH_VLA_EVAL_PYTHON"
"""Environment variable: the interpreter of an environment with vla-eval and DuoBench."""
VLAGENTS_PYTHON = "DUOBENCH_VLAGENTS_PYTHON"
"""Environment variable: the interpreter of an environment with VLAgents and DuoBench."""

NEEDS = {
    "test_openpi.py": OPENPI_PYTHON,
    "test_vla_eval.py": VLA_EVAL_PYTHON,
    "test_vlagents.py": VLAGENTS_PYTHON,
}

collect_ignore = [file for file, variable in NEEDS.items() if variable not in os.environ]


def environment(**variables: str) -> dict[str, str]:
    """That of a process which finds what the tests test, and the tests."""
    path = os.pathsep.join([str(ROOT), str(ROOT / "src")])
    return {**os.environ, "PYTHONPATH": path, **variables}
