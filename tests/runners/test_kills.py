"""A run that is killed at random moments, in part or whole; `dev.benchmarks.kills` does it more."""

import socket
from collections import Counter
from pathlib import Path

from dev.benchmarks.kills import disturb


def test_results_are_the_same_after_ten_kills(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    counts = sum((counts for _, counts in disturb(tmp_path, 10, 1, port)), Counter[str]())
    assert counts.total() == 10
    assert len(counts) > 1
