"""Run the benchmarks and print one table; the exit status says whether every bar was met."""

import argparse
import os
import platform
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import mujoco
from rich.console import Console
from rich.table import Table

from benchmarks import imports
from benchmarks.measure import Measurement

BENCHMARKS: Mapping[str, Callable[[], Iterator[Measurement]]] = {
    "imports": imports.measure,
}


def machine() -> str:
    """Describe the machine in one line."""
    cpu = platform.processor()
    info = Path("/proc/cpuinfo")
    if info.exists():
        names = [line for line in info.read_text().splitlines() if line.startswith("model name")]
        cpu = names[0].partition(":")[2].strip() if names else cpu
    return (
        f"{cpu}, {os.cpu_count()} cores, Python {platform.python_version()}, "
        f"MuJoCo {mujoco.__version__}"
    )


def main() -> int:
    """Run the named benchmarks, or all of them."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="name", help=f"one of {', '.join(BENCHMARKS)}")
    names = parser.parse_args().names or list(BENCHMARKS)
    if unknown := [name for name in names if name not in BENCHMARKS]:
        parser.error(f"unknown: {', '.join(unknown)}; known: {', '.join(BENCHMARKS)}")
    table = Table(title=machine())
    table.add_column("measured")
    table.add_column("value", justify="right")
    table.add_column("bar", justify="right")
    table.add_column("")
    met = True
    console = Console()
    for name in names:
        with console.status(name):
            for found in BENCHMARKS[name]():
                met &= found.met
                verdict = "" if not found.bar else "met" if found.met else "[red]missed[/red]"
                value = f"{found.value:.4g} {found.unit}".strip()
                table.add_row(found.what, value, found.bar, verdict)
    console.print(table)
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
