"""Suites by name, and runs that lie in several folders."""
