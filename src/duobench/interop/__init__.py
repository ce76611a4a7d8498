"""DuoBench inside the programs of other benchmarks.

Each module needs the package that it is named after; nothing of the rest of DuoBench imports it.
"""
