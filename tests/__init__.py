"""Tests, and what they share; a package of its own beside others that are named `tests`."""
