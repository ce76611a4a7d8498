"""The wrappers that make a base environment a benchmark task; each works on its own."""
