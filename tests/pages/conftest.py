"""These tests need a browser, and axe-core; `make test-pages` installs the latter."""

import os

AXE = "DUOBENCH_AXE"
"""Environment variable: the script of axe-core."""

collect_ignore_glob = [] if AXE in os.environ else ["test_*.py"]
