"""Run the benchmarks, a line for each number; the exit status says whether every bar was met."""

import argparse
import os
import platform
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib import import_module
from pathlib import Path

import mujoco

from dev.benchmarks import (
    batches,
    environments,
    images,
    imports,
    processes,
    recording,
    serving,
    teleoperation,
)
from dev.benchmarks.measure import Measurement
from duobench.tasks import catalog
from duobench.world.sim import rendering

PER_TASK: Mapping[str, Callable[[str], Iterator[Measurement]]] = {
    "creation": environments.measure_creation,
    "resets": environments.measure_resets,
    "steps": environments.measure_steps,
    "judging": batches.measure_judging,
    "batches": batches.measure_steps,
    "images": images.measure,
    "recording": recording.measure,
}
ONCE: Mapping[str, Callable[[], Iterator[Measurement]]] = {
    "imports": imports.measure,
    "processes": processes.measure,
    "serving": serving.measure,
    "teleoperation": teleoperation.measure,
}
USUAL = (*ONCE, *PER_TASK)
WARP = "warp"
"""What is measured where it is asked for alone, since it needs what is not always installed."""
KINDS = (*USUAL, WARP)


def measurements(kinds: Sequence[str], tasks: Sequence[str]) -> Iterator[Measurement]:
    """Measure the named kinds, one after another."""
    for kind in kinds:
        if kind in ONCE:
            yield from ONCE[kind]()
            continue
        measure = PER_TASK[kind] if kind != WARP else import_module("dev.benchmarks.warp").measure
        for task in tasks:
            yield from measure(task)


def machine() -> str:
    """Describe the machine in one line."""
    cpu = platform.processor()
    info = Path("/proc/cpuinfo")
    if info.exists():
        names = [line for line in info.read_text().splitlines() if line.startswith("model name")]
        cpu = names[0].partition(":")[2].strip() if names else cpu
    drawing = rendering.describe()
    return (
        f"{cpu}, {os.cpu_count()} cores, Python {platform.python_version()}, "
        f"MuJoCo {mujoco.__version__}, {drawing.renderer} ({drawing.backend}), "
        f"load {os.getloadavg()[0]:.1f}"
    )


def main() -> int:
    """Measure what the arguments name, or everything."""
    parser = argparse.ArgumentParser(prog="python -m dev.benchmarks", description=__doc__)
    parser.add_argument("kinds", nargs="*", metavar="kind", help=f"some of: {', '.join(KINDS)}")
    parser.add_argument("--tasks", nargs="+", choices=catalog.names(), default=catalog.names())
    arguments = parser.parse_args()
    if unknown := [kind for kind in arguments.kinds if kind not in KINDS]:
        parser.error(f"no such kind: {', '.join(unknown)}; known: {', '.join(KINDS)}")
    print(machine())
    met = True
    for found in measurements(arguments.kinds or USUAL, arguments.tasks):
        met &= found.met
        verdict = "" if not found.bar else "met" if found.met else "MISSED"
        value = f"{found.value:.4g} {found.unit}"
        print(f"{found.what:<56} {value:>14} {found.bar:>9}  {verdict}".rstrip(), flush=True)
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
