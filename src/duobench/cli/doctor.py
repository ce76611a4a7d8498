"""`duobench doctor`: whether a machine is fit for a run."""

from __future__ import annotations

import os
import resource
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from statistics import median
from timeit import repeat

import numpy as np

from duobench.cli.shared.console import CHECK_STYLES, counted, say
from duobench.cli.shared.process import load_engine
from duobench.core import files
from duobench.core.errors import RenderingError
from duobench.core.machine import DEVICE, unsupported
from duobench.core.randomness import SUITE_VERSION
from duobench.core.versions import other_engine, record_versions
from duobench.envs.config import IMAGE_SIZE
from duobench.real.doctor.checks import Check, CheckOutcome
from duobench.tasks import catalog
from duobench.world.robot.cameras import HEAD, POLICY_CAMERAS

FIRST_COMMAND = (
    "duobench eval --policy expert --tasks bin_sort --episodes 1 --out runs/first"
)
FRAMES = 20
"""Images that are timed; their median is shown."""
ROOM_GB = 1.0
"""Free space for the output below which a note is shown."""
LEAST_ROOM_GB = 0.1
"""Free space for the output below which the check fails."""
HANDLES = 256
"""Open files that are enough for many workers."""
_VARIABLES = (
    "MUJOCO_GL",
    DEVICE,
    "PYOPENGL_PLATFORM",
    "CUDA_VISIBLE_DEVICES",
    "NVIDIA_DRIVER_CAPABILITIES",
    "OMP_NUM_THREADS",
)
"""Environment variables that a run depends on, shown with their values."""
_PROXIES = ("HTTP_PROXY", "HTTPS_PROXY", "ALL_PROXY", "NO_PROXY")
_NAMED = (
    "PYTHONPATH",
    "LD_PRELOAD",
    "LD_LIBRARY_PATH",
    "TMPDIR",
    "MPLCONFIGDIR",
    *_PROXIES,
    *map(str.lower, _PROXIES),
)
"""Variables whose values are private and not shown; connections to policies take no proxy."""


def run(out: Path | None = None) -> None:
    """Try what a run needs, one line a check; the exit code is 1 if one fails.

    Scripts of jobs call it first.

    Args:
        out: Folder of the run, which need not be there; the current folder if none is named.
    """
    problem = unsupported()
    if problem:
        say(problem, style="red")
        sys.exit(1)
    failed = 0
    for check in _checks(out):
        failed += check.outcome is CheckOutcome.FAILED
        parts = [check.value.removesuffix("."), check.advice]
        words = " ".join(". ".join(filter(None, parts)).split())
        say(
            f"{check.outcome:<8}{check.name:<17}{words}",
            style=CHECK_STYLES[check.outcome],
        )
    if failed:
        say(f"{counted(failed, 'check')} failed.", style="bold red")
        sys.exit(1)
    say(f"All is well. Next: {FIRST_COMMAND}", style="bold")


def _checks(out: Path | None) -> Iterator[Check]:
    yield from _versions()
    looks: dict[str, Callable[[], Iterable[Check]]] = {
        "output": lambda: _output(out or Path()),
        "temporary files": _temporary,
        "file handles": _handles,
        "locale": _locale,
        "variables": _variables,
        "figures": _figures,
        "videos": _videos,
        "images": _images,
        "studio": _studio,
    }
    for name, look in looks.items():
        try:
            yield from look()
        except Exception as error:  # noqa: BLE001 - any error is a result of the check
            is_asked = name != "output" or out is not None
            outcome = CheckOutcome.FAILED if is_asked else CheckOutcome.NOTE
            yield outcome.of(name, str(error) or type(error).__name__)


def _versions() -> Iterator[Check]:
    versions = {
        name: version for name, version in record_versions(None).items() if version
    }
    other = other_engine(versions)
    for name, version in versions.items():
        is_well = name != "mujoco" or not other
        advice = f"This is {other}; runs with it are marked."
        yield CheckOutcome.NOTE.unless(is_well, name, version, advice)
    yield CheckOutcome.OK.of("suite version", SUITE_VERSION)


def _output(out: Path) -> Iterator[Check]:
    above = next(each for each in (out, *out.absolute().parents) if each.exists())
    with (
        files.writing(out),
        tempfile.TemporaryDirectory(prefix=files.SCRATCH, dir=above) as folder,
    ):
        with files.locked(Path(folder)):
            files.write(Path(folder, "file"), "written")
        room = shutil.disk_usage(folder).free / 1e9
    outcome = CheckOutcome.NOTE if room > LEAST_ROOM_GB else CheckOutcome.FAILED
    found = f"{above.absolute()} can be written, {room:.1f} GB are free"
    yield outcome.unless(
        room > ROOM_GB, "output", found, "Make room, or give another --out."
    )


def _temporary() -> Iterator[Check]:
    folder = Path(tempfile.gettempdir())
    room = shutil.disk_usage(folder).free / 1e9
    is_usual = not folder.name.startswith(files.SCRATCH)
    advice = "No usual folder for them can be written: set TMPDIR to one."
    found = f"{folder}, {room:.1f} GB are free"
    yield CheckOutcome.NOTE.unless(is_usual, "temporary files", found, advice)


def _handles() -> Iterator[Check]:
    most, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    is_well = most == resource.RLIM_INFINITY or most >= HANDLES
    advice = f"Many workers need more: ulimit -n {HANDLES}"
    yield CheckOutcome.NOTE.unless(is_well, "file handles", f"{most} at a time", advice)


def _locale() -> Iterator[Check]:
    names = sys.getfilesystemencoding()
    output = sys.stdout.encoding
    is_well = {names.lower(), output.lower()} == {"utf-8"}
    advice = "Signs that they lack are replaced: set LC_ALL=C.UTF-8."
    found = f"names of files in {names}, output in {output}"
    yield CheckOutcome.NOTE.unless(is_well, "locale", found, advice)


def _variables() -> Iterator[Check]:
    here = {name: os.environ[name] for name in _VARIABLES if name in os.environ}
    threads = here.get("OMP_NUM_THREADS", "1")
    is_well = all(
        number.strip().isdecimal() and int(number) for number in threads.split(",")
    )
    # Bug reports contain this line, and some values are secrets or private paths.
    shown = [f"{name}={value}" for name, value in here.items()]
    shown += [name for name in _NAMED if name in os.environ]
    advice = "OMP_NUM_THREADS is a whole number from 1 on."
    yield CheckOutcome.NOTE.unless(
        is_well, "variables", " ".join(shown) or "none of others", advice
    )


def _figures() -> Iterator[Check]:
    given = os.environ.get("MPLCONFIGDIR")
    from matplotlib import __version__, get_cachedir
    from matplotlib.figure import Figure

    from duobench.results.figures import as_svg

    figure = Figure()
    figure.add_subplot().set_title("Success")
    as_svg("doctor", lambda: figure)
    found = f"drawn by Matplotlib {__version__}, which keeps fonts in {get_cachedir()}"
    # Without a writable folder, Matplotlib sets the variable to a temporary one.
    is_kept = os.environ.get("MPLCONFIGDIR") == given
    advice = "Each command finds them anew: set MPLCONFIGDIR to a folder that can be written."
    yield CheckOutcome.NOTE.unless(is_kept, "figures", found, advice)


def _videos() -> Iterator[Check]:
    from duobench.core.codecs import AV1, H264, VP9
    from duobench.core.video import write_video

    codecs = (VP9, AV1, H264)
    frames = [np.zeros((64, 64, 3), dtype=np.uint8)] * 2
    with tempfile.TemporaryDirectory() as folder:
        for codec in codecs:
            write_video(frames, Path(folder, codec.encoder), codec, 30)
    yield CheckOutcome.OK.of(
        "videos", f"encoded by {', '.join(codec.encoder for codec in codecs)}"
    )


def _images() -> Iterator[Check]:
    load_engine()
    from duobench.envs.sim_env import SimEnv
    from duobench.world.sim.rendering import Renderer

    base = SimEnv(catalog.get(catalog.names()[0]))
    base.reset()
    data = base.simulation.data
    height, width = IMAGE_SIZE
    with Renderer(base.simulation.model, height=height, width=width) as renderer:
        info = renderer.info
        is_seen = renderer.render(data, HEAD).any()
        one = _milliseconds(lambda: renderer.render(data, HEAD))
        three = _milliseconds(lambda: renderer.render_all(data, POLICY_CAMERAS))
    found = f"{one:.1f} ms at {width}x{height}, shadows included"
    yield CheckOutcome.OK.of("backend", info.backend)
    yield CheckOutcome.OK.of("renderer", info.renderer)
    yield CheckOutcome.OK.of("vendor", info.vendor)
    yield CheckOutcome.OK.of("OpenGL", info.version)
    yield CheckOutcome.FAILED.unless(bool(is_seen), "one image", found, "It is black.")
    yield CheckOutcome.OK.of("three cameras", f"{three:.1f} ms")
    devices = os.environ.get("CUDA_VISIBLE_DEVICES")
    is_chosen = info.software or not devices or DEVICE in os.environ
    by = "the processor, as no card does" if info.software else "a graphics card"
    advice = f"CUDA_VISIBLE_DEVICES does not choose it; {DEVICE}, a whole number, does."
    yield CheckOutcome.NOTE.unless(is_chosen, "rendered by", by, advice)


def _studio() -> Iterator[Check]:
    from duobench.world.looks.look import STUDIO
    from duobench.world.sim.rendering import describe

    try:
        found = describe(STUDIO).renderer
    except RenderingError as error:
        yield CheckOutcome.NOTE.of("studio", str(error))
    else:
        yield CheckOutcome.OK.of("studio", f"looks of the studio by {found}")


def _milliseconds(work: Callable[[], object]) -> float:
    """Median time of a call, after a first one that does not count."""
    work()
    return 1000 * median(repeat(work, number=1, repeat=FRAMES))
