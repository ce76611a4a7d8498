"""DuoBench: a benchmark for two-armed manipulation on the Franka FR3 Duo.

Importing the package registers the environments with Gymnasium and does nothing else.
"""

from duobench.envs.registration import make, register, register_catalog

__all__ = ["__version__", "make", "register"]

__version__ = "0.1.0"

register_catalog()
