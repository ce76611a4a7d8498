"""How long `import duobench` takes, in fresh processes."""

import statistics
import subprocess
import sys
from collections.abc import Iterator

from dev.benchmarks.measure import Measurement

PROBE = """
import time
start = time.perf_counter()
import numpy, gymnasium
middle = time.perf_counter()
import duobench
print(middle - start, time.perf_counter() - middle)
"""


def measure(repeats: int = 9) -> Iterator[Measurement]:
    """Measure the import on top of NumPy and Gymnasium, and against them."""
    runs = []
    for _ in range(repeats):
        command = [sys.executable, "-c", PROBE]
        output = subprocess.run(
            command, check=True, capture_output=True, text=True
        ).stdout
        runs.append([float(word) for word in output.split()])
    others, own = (statistics.median(column) for column in zip(*runs, strict=True))
    yield Measurement(
        what="import duobench, after numpy and gymnasium",
        value=own,
        unit="s",
        at_most=0.3,
    )
    yield Measurement(
        what="import duobench / import numpy and gymnasium", value=own / others, unit=""
    )
