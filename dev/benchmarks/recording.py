"""What recording costs an environment."""

import tempfile
from collections.abc import Iterator

import duobench
from dev.benchmarks.environments import expert_actions, wrapped_physics
from dev.benchmarks.measure import Measurement, seconds
from duobench.data.recorder import Recorder


def measure(name: str, repeats: int = 15) -> Iterator[Measurement]:
    """Measure an expert's whole episode as it is recorded, its file included, and as it is not."""
    env = duobench.make(name, cameras=False)
    actions = expert_actions(env)
    with tempfile.TemporaryDirectory() as folder:
        recorder = Recorder(duobench.make(name, cameras=False), folder)
        plain, recorded = seconds(
            wrapped_physics(env, actions),
            wrapped_physics(recorder, actions),
            repeats=repeats,
        )
        recorder.close()
    env.close()
    yield Measurement(
        what=f"{name}: episode, recorded / not recorded",
        value=recorded / plain,
        at_most=1.05,
    )
