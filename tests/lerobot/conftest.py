"""Tests with LeRobot and the plugin, in an environment that `make test-lerobot` makes."""

from importlib.util import find_spec

collect_ignore_glob = [] if find_spec("lerobot") else ["test_*.py"]
