"""These tests need environments of their own; `make test-interop` makes them."""

import os

OPENPI_PYTHON = "DUOBENCH_OPENPI_PYTHON"
"""Environment variable: the interpreter of an environment with openpi-client."""

collect_ignore_glob = [] if OPENPI_PYTHON in os.environ else ["test_*.py"]
