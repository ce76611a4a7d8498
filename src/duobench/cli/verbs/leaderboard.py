"""`duobench leaderboard`: verify the bundles in a folder, and show them in their order."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from duobench.cli.shared.advice import AdvisedError, advising
from duobench.cli.shared.console import console, counted
from duobench.cli.shared.engine import load_engine
from duobench.errors import DuoBenchError, OtherRunError

if TYPE_CHECKING:
    from duobench.data.processes import Progress
    from duobench.results.leaderboard import BoardEntry


def leaderboard(folder: tyro.conf.Positional[Path], out: Path, workers: int = 1) -> None:
    """Verify the bundles in a folder and build a leaderboard of them: pages that load nothing.

    A bundle that does not verify is listed with the reason and not ranked. What was verified before
    is not played again.

    Args:
        folder: Folder with files that duobench bundle has written, NAME.duobench.zip.
        out: Folder of the leaderboard; an earlier one in it is replaced.
        workers: Processes that verify side by side.
    """
    if not folder.is_dir():
        raise AdvisedError(f"There is no folder {folder}. duobench bundle RUN makes a bundle.")
    load_engine()
    from duobench.cli.shared.progress import display
    from duobench.replay.leaderboard import make_leaderboard

    screen = console()
    shown = ExitStack()

    def started(name: str) -> Progress:
        shown.close()  # what is shown of the bundle before
        screen.print(f"Verifying {name}")
        return shown.enter_context(display(screen, "episode")).tell

    with shown, advising(_advice):
        board, page = make_leaderboard(folder, out, workers=workers, started=started)
    for title, privileged in (("Ranked", False), ("Privileged", True)):
        for rank, entry in board.ranked(privileged=privileged):
            screen.print(f"{title} {rank}: {_result(entry)}")
    for entry in board.partial:
        screen.print(f"Not ranked: {_result(entry)}; {'; '.join(entry.lacks)}")
    for refused in board.refused:
        screen.print(f"Refused: {refused.file}: {refused.reason}")
    screen.print(f"Leaderboard: {page}, {counted(len(board.entries), 'policy run')}")


def _result(entry: BoardEntry) -> str:
    from duobench.results.scores import interval_percent, percent

    overall = entry.results.overall
    rate, interval = percent(overall.success_rate), interval_percent(overall)
    return f"{entry.name}, success {rate} % ({interval}) of {counted(overall.episodes, 'episode')}"


def _advice(error: DuoBenchError) -> str | None:
    return "Give --out another folder." if isinstance(error, OtherRunError) else None
