"""Comparing runs: who is compared, on which episodes, with which outcome, and how it is shown.

`duobench.results.compare` puts these parts together.
"""
