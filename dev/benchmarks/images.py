"""How long images take: one frame, and an observation of three cameras."""

from collections.abc import Iterator

import duobench
from dev.benchmarks.environments import begin
from dev.benchmarks.measure import Measurement, Work, seconds
from duobench.core.types import POLICY_CAMERAS
from duobench.envs.observation_wrappers import IMAGE_SIZE
from duobench.envs.sim_env import sim_of
from duobench.world.sim import rendering

MILLI = 1e-3


def measure(name: str, repeats: int = 60) -> Iterator[Measurement]:
    """Measure images of the default size, shadows included."""
    env = duobench.make(name, cameras=False)
    begin(env)
    simulation = sim_of(env).simulation
    height, width = IMAGE_SIZE
    with rendering.Renderer(simulation.model, height=height, width=width) as renderer:

        def draw(*cameras: str) -> Work:
            return Work(pieces=[lambda: renderer.render_all(simulation.data, cameras)])

        works = [*map(draw, POLICY_CAMERAS), draw(*POLICY_CAMERAS)]
        *frames, observation = seconds(*works, repeats=repeats)
    env.close()
    for camera, frame in zip(POLICY_CAMERAS, frames, strict=True):
        what = f"{name}: {width}x{height} frame, {camera}"
        yield Measurement(what=what, value=frame / MILLI, unit="ms", at_most=8.0)
    what = f"{name}: observation of three cameras"
    yield Measurement(what=what, value=observation / MILLI, unit="ms", at_most=24.0)
