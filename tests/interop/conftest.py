"""Some of these tests need environments of their own; `make test-interop` makes them."""

import os

OPENPI_PYTHON = "DUOBENCH_OPENPI_PYTHON"
"""Environment variable: the interpreter of an environment with openpi-client."""
VLAGENTS_PYTHON = "DUOBENCH_VLAGENTS_PYTHON"
"""Environment variable: the interpreter of an environment with VLAgents and DuoBench."""

NEEDS = {"test_openpi.py": OPENPI_PYTHON, "test_vlagents.py": VLAGENTS_PYTHON}

collect_ignore = [file for file, variable in NEEDS.items() if variable not in os.environ]
