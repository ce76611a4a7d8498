"""The command line: thin, one file a command, named as the command, loaded when it is needed."""

import atexit
import io
import logging
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import TextIO

from duobench.cli.shared.process import leave, leaving_at_once
from duobench.core.errors import DuoBenchError, escaped
from duobench.core.machine import fill_streams

VERBOSE = "--verbose"


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a command and leave with its exit code: 0, or 1 after an error that is told in words.

    Args:
        arguments: What stands after `duobench`; the process's own if not given.
    """
    _find_modules_here()
    _print_anything()
    if arguments is None:  # the process ends with the command
        atexit.register(_print_the_rest)
    logging.getLogger("matplotlib").setLevel(
        logging.ERROR
    )  # it warns of a home it cannot write
    # Only files are drawn; what a notebook's kernel or a shell asks for may not exist here.
    os.environ["MPLBACKEND"] = "agg"
    with leaving_at_once():
        try:
            words = (
                sys.argv[1:] if arguments is None else [*arguments]
            )  # `list` is a command, a module of this package
            if VERBOSE in words:
                words.remove(VERBOSE)
                logging.basicConfig(format="%(message)s")
                logging.getLogger("duobench").setLevel(logging.INFO)
            import_module("duobench.cli.program").run(words)
            sys.stdout.flush()
        except DuoBenchError as error:
            sys.exit(f"error: {escaped(str(error))}")
        except BrokenPipeError:  # the reader of the output has closed it
            _discard_output()
            sys.exit(1)
        except OSError as error:
            _discard_output()
            what, kept = error.filename or "the output", "What is finished is kept."
            text = f"error: {what}: {error.strerror or error}."
            sys.exit(text if error.filename else f"{text} {kept}")
        except KeyboardInterrupt:
            with suppress(OSError):
                sys.stdout.flush()
            leave()


def _print_anything() -> None:
    """Replace what the output's encoding lacks, such as a dash, and do without closed streams."""
    fill_streams()
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_RDWR), mode))
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def _print_the_rest() -> None:
    """Print what streams still hold; without this, a lost terminal ends Python with 120."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (OSError, ValueError):
            _discard(stream)


def _discard_output() -> None:
    """Forget what could not be printed; Python would try again at its end."""
    _discard(sys.stdout)


def _discard(stream: TextIO) -> None:
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _find_modules_here() -> None:
    """Let `module:attribute` name a module in the current folder, as with `python -m`.

    The folder comes last, so that no file in it stands in for an installed module.
    """
    with suppress(FileNotFoundError):  # the folder may have been deleted
        here = str(Path.cwd())
        if here not in sys.path:
            sys.path.append(here)
