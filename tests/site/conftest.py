"""These tests look at the site as `make site` built it, in its environment; no other run has it."""

import os

SITE = "DUOBENCH_SITE"
"""Environment variable: the folder of the site."""

collect_ignore_glob = [] if SITE in os.environ else ["test_*.py"]
