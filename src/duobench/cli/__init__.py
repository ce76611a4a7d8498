"""The command line, `duobench <verb>`: thin, one file a verb, loaded when it is needed."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module

from duobench.errors import DuoBenchError

INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells use it."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a verb and leave with its exit code: 0, or 1 after an error that is told in words.

    Args:
        arguments: What stands after `duobench`; the process's own if not given.
    """
    try:
        import_module("duobench.cli.verbs").run(arguments)
    except DuoBenchError as error:
        sys.exit(f"error: {error}")
    except KeyboardInterrupt:
        print("\nStopped.", file=sys.stderr)  # noqa: T201 - nothing else may be loaded yet
        sys.exit(INTERRUPTED)
