"""Environments: the arms behind Gymnasium, and the wrappers that make a benchmark task of them."""
