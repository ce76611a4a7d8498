"""Python in processes of its own."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]


def environment(**variables: str) -> dict[str, str]:
    """That of a process which finds what the tests test, and the tests."""
    path = os.pathsep.join([str(ROOT / "src"), str(ROOT)])
    return {**os.environ, "PYTHONPATH": path, **variables}


def ran(*arguments: str, **options: Any) -> subprocess.CompletedProcess[str]:
    """Python with some arguments, run to its end."""
    command = [sys.executable, *arguments]
    return subprocess.run(command, check=False, capture_output=True, text=True, **options)


def printed(code: str, *arguments: str, **options: Any) -> str:
    """What code prints that ends well and warns of nothing."""
    done = ran("-W", "error", "-c", code, *arguments, **options)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout
