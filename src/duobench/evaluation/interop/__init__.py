"""DuoBench with the programs of other benchmarks; nothing of the rest of DuoBench imports it."""
