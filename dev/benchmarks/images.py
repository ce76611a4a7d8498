"""How long images take: one frame, an observation of three cameras, other kinds, each renderer."""

import sys
from collections.abc import Iterator
from contextlib import ExitStack
from functools import partial

import duobench
from dev.benchmarks.environments import begin
from dev.benchmarks.measure import Measurement, Work, seconds
from duobench.core.backend import DEPTH, KINDS, SEGMENTATION, Sizes, Wanted
from duobench.core.errors import RenderingError
from duobench.envs.observation_wrappers import IMAGE_SIZE
from duobench.envs.sim_env import sim_of
from duobench.world.looks.catalog import look
from duobench.world.looks.look import STUDIO
from duobench.world.robot.cameras import POLICY_CAMERAS
from duobench.world.sim import rendering

MILLI = 1e-3
OTHERS = ((DEPTH,), (SEGMENTATION,), KINDS)
"""Kinds of images whose time is given as a ratio to that of colours."""


def measure(name: str, repeats: int = 60) -> Iterator[Measurement]:
    """Measure images of the default size, shadows included; other kinds beside colours."""
    env = duobench.make(name, cameras=False)
    begin(env)
    simulation = sim_of(env).simulation
    height, width = IMAGE_SIZE
    with rendering.Renderer(simulation.model, height=height, width=width) as renderer:

        def draw(*cameras: str) -> Work:
            return Work(pieces=[lambda: renderer.render_all(simulation.data, cameras)])

        def measured(*kinds: str) -> Work:
            sizes: Sizes = dict.fromkeys(POLICY_CAMERAS, IMAGE_SIZE)
            wanted: Wanted = dict.fromkeys(kinds, sizes)
            return Work(pieces=[lambda: renderer.render_kinds(simulation.data, wanted)])

        works = [*map(draw, POLICY_CAMERAS), draw(*POLICY_CAMERAS)]
        works += [measured(*kinds) for kinds in OTHERS]
        times = seconds(*works, repeats=repeats)
        frames = times[: len(POLICY_CAMERAS)]
        observation, *others = times[len(POLICY_CAMERAS) :]
    env.close()
    for camera, frame in zip(POLICY_CAMERAS, frames, strict=True):
        what = f"{name}: {width}x{height} frame, {camera}"
        yield Measurement(what=what, value=frame / MILLI, unit="ms", at_most=8.0)
    what = f"{name}: observation of three cameras"
    yield Measurement(what=what, value=observation / MILLI, unit="ms", at_most=24.0)
    for kinds, took in zip(OTHERS, others, strict=True):
        what = f"{name}: {' and '.join(kinds)}, to colours alone"
        yield Measurement(what=what, value=took / observation)
    yield from measure_studio(name)


def measure_studio(name: str, repeats: int = 10) -> Iterator[Measurement]:
    """Measure an observation of three cameras in a look of the studio beside the default one."""
    env = duobench.make(name, cameras=False)
    begin(env)
    simulation = sim_of(env).simulation
    height, width = IMAGE_SIZE
    with ExitStack() as stack:
        works = []
        for each in ("default", STUDIO):
            renderer = rendering.Renderer(
                simulation.model, height=height, width=width, look=look(each)
            )
            stack.enter_context(renderer)
            draw = partial(renderer.render_all, simulation.data, POLICY_CAMERAS)
            works.append(Work(pieces=[draw]))
        try:
            classic, studio = seconds(*works, repeats=repeats)
        except RenderingError as error:
            sys.stderr.write(f"{error}\n")
            return
    env.close()
    what = f"{name}: three cameras in the look studio, times the default one"
    yield Measurement(what=what, value=studio / classic, unit="", at_most=100.0)
