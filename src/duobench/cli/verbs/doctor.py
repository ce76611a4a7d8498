"""`duobench doctor`: whether everything that DuoBench needs works on this machine."""

from __future__ import annotations

import sys
from collections.abc import Callable
from statistics import median
from timeit import repeat

from duobench.cli.shared.console import console
from duobench.cli.shared.engine import load_engine
from duobench.errors import DuoBenchError

FRAMES = 20
"""Images that are timed; their median is shown."""


def doctor() -> None:
    """Show versions and graphics, with the time of an image; exit code 1 if one fails."""
    screen = console()
    is_well = True
    for heading, examine in (("Versions", _versions), ("Graphics", _graphics)):
        screen.print(heading, style="bold")
        try:
            for name, value in examine().items():
                screen.print(f"  {name:<16}{value}")
        except DuoBenchError as error:
            is_well = False
            screen.print(f"  does not work: {error}", style="red")
    if not is_well:
        sys.exit(1)


def _versions() -> dict[str, str]:
    from duobench.randomness import SUITE_VERSION
    from duobench.versions import record_versions

    versions = {name: version for name, version in record_versions(None).items() if version}
    return {**versions, "suite version": SUITE_VERSION}


def _graphics() -> dict[str, str]:
    """What renders, and how long an image takes."""
    load_engine()
    from duobench.envs.config import IMAGE_SIZE
    from duobench.envs.sim_env import SimEnv
    from duobench.sim.rendering import Renderer
    from duobench.tasks import catalog
    from duobench.types import HEAD, POLICY_CAMERAS

    base = SimEnv(catalog.get(catalog.names()[0]))
    base.reset()
    data = base.simulation.data
    height, width = IMAGE_SIZE
    with Renderer(base.simulation.model, height=height, width=width) as renderer:
        info = renderer.info
        one = _milliseconds(lambda: renderer.render(data, HEAD))
        three = _milliseconds(lambda: renderer.render_all(data, POLICY_CAMERAS))
    return {
        "backend": info.backend,
        "renderer": info.renderer,
        "vendor": info.vendor,
        "OpenGL": info.version,
        "rendered by": "the processor (software)" if info.software else "a graphics card",
        "one image": f"{one:.1f} ms at {width}x{height}, shadows included",
        "three cameras": f"{three:.1f} ms",
    }


def _milliseconds(work: Callable[[], object]) -> float:
    """Median time of a call, after a first one that does not count."""
    work()
    return 1000 * median(repeat(work, number=1, repeat=FRAMES))
