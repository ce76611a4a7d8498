"""The command line, `duobench <verb>`: thin, one file a verb, loaded when it is needed."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path

from duobench.cli.interrupt import leave, leaving_at_once
from duobench.errors import DuoBenchError


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a verb and leave with its exit code: 0, or 1 after an error that is told in words.

    Args:
        arguments: What stands after `duobench`; the process's own if not given.
    """
    _find_modules_here()
    with leaving_at_once():
        try:
            import_module("duobench.cli.verbs").run(arguments)
        except DuoBenchError as error:
            sys.exit(f"error: {error}")
        except KeyboardInterrupt:
            with suppress(OSError):
                sys.stdout.flush()
            leave()


def _find_modules_here() -> None:
    """Let `module:attribute` name a module in the current folder, as with `python -m`.

    The folder comes last, so that no file in it stands in for an installed module.
    """
    with suppress(FileNotFoundError):  # the folder may have been deleted
        here = str(Path.cwd())
        if here not in sys.path:
            sys.path.append(here)
