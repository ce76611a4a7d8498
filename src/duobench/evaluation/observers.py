"""Observers named by a user as `module:NAME`, in place of objects in `observers=`."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from duobench.core.errors import EvaluationError, traceback_text
from duobench.core.references import load
from duobench.evaluation.rollouts import Observer
from duobench.results.run import Run

_KIND = "observer, or class or function that makes one,"
_METHODS = ("on_run_start", "on_episode")


class ObserverError(EvaluationError):
    """Observer that cannot be made, or has failed."""


def load_observer(path: str) -> Observer[Any]:
    """Return the observer that an import path `module:NAME` names.

    NAME is an observer, or a class or a function that makes one when it is called without
    arguments. Every error of the observer becomes an `ObserverError` that names it.

    Raises:
        ImportPathError: The module cannot be imported.
        UnknownNameError: Nothing in the module fits the name.
        ObserverError: The observer cannot be made, or lacks a method.
    """
    value = load(path, _KIND, _fits)
    if isinstance(value, type) or not _is_observer(value):
        with _blamed(path, "cannot be made"):
            value = value()
    if not _is_observer(value):
        raise ObserverError(
            f"Observer {path!r} is of type {type(value).__name__}; an observer has the methods "
            "on_run_start(run, finished) and on_episode(record)."
        )
    return _NamedObserver(path, value)


def _fits(value: object) -> bool:
    return callable(value) or _is_observer(value)


def _is_observer(value: object) -> bool:
    return all(callable(getattr(value, name, None)) for name in _METHODS)


@contextmanager
def _blamed(path: str, what: str) -> Iterator[None]:
    try:
        yield
    except Exception as error:
        text = traceback_text(error, skip=1).strip()
        raise ObserverError(f"Observer {path!r} {what}.\n{text}") from error


class _NamedObserver:
    """An observer whose errors say which one it is."""

    def __init__(self, path: str, observer: Observer[Any]) -> None:
        self._path = path
        self._observer = observer

    def on_run_start(self, run: Run, finished: Sequence[Any]) -> None:
        with _blamed(self._path, "has failed; episodes that are finished are kept"):
            self._observer.on_run_start(run, finished)

    def on_episode(self, played: Any) -> None:
        with _blamed(self._path, "has failed; episodes that are finished are kept"):
            self._observer.on_episode(played)
