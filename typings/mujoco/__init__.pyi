"""MuJoCo's bindings are compiled and carry no type information: to the checker they are opaque.

Without this stub every name of `mujoco` would be reported as unknown; with it the rest of the
code is checked as strictly as before.
"""

from typing import Any

def __getattr__(name: str) -> Any: ...
