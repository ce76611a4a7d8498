"""Progress of a download on the error stream; nothing is shown before there is something."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

Report = Callable[[str, int, int], None]
"""Called with a title, the bytes that arrived so far, and the bytes expected (0 if unknown)."""


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
    # Imported here because it is needed only when something is really fetched.
    from rich.console import Console
    from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TransferSpeedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), DownloadColumn())
    bars: dict[str, int] = {}
    with contextlib.ExitStack() as stack:
        display: list[Progress] = []

        def report(title: str, done: int, total: int) -> None:
            if not display:
                console = Console(stderr=True)
                progress = Progress(*columns, TransferSpeedColumn(), console=console)
                display.append(stack.enter_context(progress))
            if title not in bars:
                bars[title] = display[0].add_task(title, total=None)
            display[0].update(bars[title], completed=done, total=total or None)

        yield report
