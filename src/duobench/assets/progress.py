"""Progress on the error stream; nothing is shown before there is something to wait for."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

Report = Callable[[str, int, int], None]
"""Called with a title, how much is done, and how much there is to do (0 if unknown)."""


def silent(_title: str, _done: int, _total: int) -> None:
    """Report nothing."""


@contextlib.contextmanager
def shown(enabled: bool) -> Iterator[Report]:
    """Yield a `Report` that draws one bar for every title on the error stream.

    Args:
        enabled: Whether anything is drawn.
    """
    if not enabled:
        yield silent
        return
    # Imported here because it is needed only when there is something to show.
    from rich.console import Console
    from rich.progress import Progress, TaskID

    bars: dict[str, TaskID] = {}
    with contextlib.ExitStack() as stack:
        display: list[Progress] = []

        def report(title: str, done: int, total: int) -> None:
            if not display:
                display.append(stack.enter_context(Progress(console=Console(stderr=True))))
            if title not in bars:
                bars[title] = display[0].add_task(title, total=None)
            display[0].update(bars[title], completed=done, total=total or None)

        yield report
