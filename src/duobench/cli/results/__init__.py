"""Verbs about results that are there: `duobench report` and its neighbours."""
