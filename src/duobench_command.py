"""The command `duobench`: what answers Ctrl-C while the package is imported.

It lies beside the package, whose import alone, with Gymnasium and NumPy, takes a moment.
"""

import os
import signal
import sys
from types import FrameType


def _leave(number: int, _frame: FrameType | None) -> None:
    """End the process as `duobench.cli.shared.process.leave` does; nothing is open yet."""
    os.write(2, b"\nStopped.\n")
    os._exit(128 + number)


def main() -> None:
    """Run the command."""
    before = signal.getsignal(signal.SIGINT)
    if before is signal.default_int_handler:  # not where it is ignored, as in the background
        signal.signal(signal.SIGINT, _leave)
    if sys.platform == "win32":  # before what asks for POSIX is imported
        from duobench.core.machine import unsupported

        sys.exit(f"error: {unsupported()}")
    from duobench.cli import main as run

    signal.signal(signal.SIGINT, before)
    run()
