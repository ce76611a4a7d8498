"""DuoBench: a benchmark for two-armed manipulation on the Franka FR3 Duo.

Importing the package registers the environments with Gymnasium and does nothing else. Where
Gymnasium is not installed, as on a policy's server, there is `duobench.policy` all the same.
"""

from duobench.errors import DuoBenchError
from duobench.versions import __version__

__all__ = ["DuoBenchError", "__version__", "make", "register"]

try:
    from duobench.envs.registration import make, register, register_catalog
except ModuleNotFoundError as error:
    if error.name != "gymnasium":
        raise
else:
    register_catalog()
