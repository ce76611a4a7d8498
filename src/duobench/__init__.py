"""DuoBench: a benchmark for two-armed manipulation on the Franka FR3 Duo."""
