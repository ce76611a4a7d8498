"""DuoBench: a benchmark for two-armed manipulation on the Franka FR3 Duo."""

__version__ = "0.1.0"
