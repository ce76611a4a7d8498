"""Speed of DuoBench, measured in one run on one machine: `python -m dev.benchmarks`.

Absolute times belong to the machine they were taken on. What the package itself can be held to
are the ratios against the bare engine, measured side by side, and the bars.
"""
