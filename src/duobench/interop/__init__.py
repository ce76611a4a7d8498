"""DuoBench inside the programs of other benchmarks.

`vla_eval` needs the package vla-eval; nothing of the rest of DuoBench imports it.
"""
