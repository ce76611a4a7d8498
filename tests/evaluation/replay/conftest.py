"""Evaluations of the small tasks; see `tests.evaluation.conftest`."""

from tests.evaluation.conftest import play

__all__ = ["play"]
