"""These tests need a slicer; `make test-printing` installs one where it may, and says where."""

import os

SLICER = "DUOBENCH_SLICER"
"""Environment variable: the program of PrusaSlicer."""

collect_ignore_glob = [] if SLICER in os.environ else ["test_*.py"]
