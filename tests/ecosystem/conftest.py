"""Libraries of the field around our environments; `make test-ecosystem` installs them.

Each runs as its users run it. What does not work is a row too, with the words that say so.
"""

from importlib.util import find_spec

NEEDED = ("mujoco_warp", "stable_baselines3", "torchrl", "triton")

collect_ignore_glob = [] if all(map(find_spec, NEEDED)) else ["test_*.py"]
