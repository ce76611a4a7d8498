"""DuoBench inside other benchmarks' programs: each module needs the package that it is named after.

Nothing here is imported by the rest of DuoBench.
"""
