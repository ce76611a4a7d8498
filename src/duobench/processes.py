"""How a process learns that the one that has started it is gone."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable

_LOOK_S = 0.1
"""How often a process looks whether its parent still lives, in seconds."""


def watch_parent(parent: int, end: Callable[[], object]) -> None:
    """Call a function in a thread as soon as the parent of this process is gone, however it went.

    Args:
        parent: Number of the process that has started this one.
        end: What to do then: end this process, and what it has started.
    """

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_LOOK_S)
        end()

    threading.Thread(target=watch, daemon=True).start()
