"""Images to learn to see from: of demonstrations, of layouts at rest, and of a policy's own play.

What is to be seen in them is known: the simulation says it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from demonstrations import Demonstrations, Rows
from numpy.typing import NDArray
from own_play import LEARNED
from sight import SIZES

import duobench
from duobench.core.errors import DataError
from duobench.core.randomness import TRAIN, episode_seed
from duobench.core.types import SIDES, DuoCommand
from duobench.data import DataSet, ImageSource
from duobench.policy import Policy
from duobench.results.run import needed_options
from duobench.world.sim.backend import SimBackend
from duobench.world.sim.simulation import Simulation

EVERY = 6
"""Rows of an episode from one image that is learned from to the next."""
HELD_OUT = 10
"""Every n-th episode and layout is not learned from, and tells how well is seen."""
MOVED = 10
"""Rows before one of a layout at rest under arms that are elsewhere, as they are counted."""
Pixels = NDArray[np.uint8]


@dataclass(frozen=True)
class Pictures:
    """Images, and what is to be seen in them."""

    images: list[Pixels]
    """Of each camera (T, height, width, 3)."""
    state: Rows
    """Joints and openings (T, 16)."""
    objects: Rows
    """Object states (T, n)."""
    before: NDArray[np.int64]
    """Rows (T,) of its episode before each."""
    held: NDArray[np.bool_]
    """Which (T,) are not learned from."""

    def __add__(self, other: Pictures) -> Pictures:
        """Those of the other one behind these."""
        pairs = zip(self.images, other.images, strict=True)
        return Pictures(
            [np.concatenate(both) for both in pairs],
            np.concatenate([self.state, other.state]),
            np.concatenate([self.objects, other.objects]),
            np.concatenate([self.before, other.before]),
            np.concatenate([self.held, other.held]),
        )


def watch(demos: Path, task: str, data: Demonstrations) -> Pictures:
    """Render every sixth row of demonstrations.

    Args:
        demos: Folder of the recordings that the export was made of.
        task: Their task.
        data: The demonstrations, which say how many.

    Raises:
        DataError: The recordings are others.
    """
    before = np.concatenate([np.arange(length) for length in data.lengths])
    number = np.repeat(np.arange(len(data.lengths)), data.lengths)
    kept = np.flatnonzero(before % EVERY == 0)
    recordings = DataSet.open(demos, create=False).recordings(task)
    source = ImageSource(task)

    def shown() -> Iterator[Simulation]:
        for episode in range(len(data.lengths)):
            recording, rows = next(recordings, None), number == episode
            recorded, state = data.recorded[rows], data.state[rows]
            if (
                recording is None
                or len(recording) <= recorded.max()
                or not np.allclose(recording.agent_pos[recorded], state, atol=1e-5)
            ):
                raise DataError(
                    f"Episode {episode} of {task} in {demos} is not that of the export."
                )
            for row in recorded[::EVERY].tolist():
                source.show(recording, row)
                yield source.simulation
            if episode % 20 == 0:
                text = f"{episode + 1} of {len(data.lengths)} episodes rendered"
                print(f"{task}: {text}", flush=True)

    images = _rendered(shown, len(kept))
    source.close()
    held = number[kept] % HELD_OUT == HELD_OUT - 1
    return Pictures(images, data.state[kept], data.objects[kept], before[kept], held)


def at_rest(task: str, data: Demonstrations, count: int) -> Pictures:
    """Render layouts of `train` at rest.

    Every second one is under arms as they were in some row of demonstrations, with open hands: a
    hand is not always where its object is.
    """
    env = duobench.make(
        task, cameras=False, object_state=True, split=TRAIN, gripper=data.gripper
    )
    simulation = env.get_wrapper_attr("simulation")
    states, objects = [], []
    rows = np.random.default_rng(0).integers(len(data.state), size=count)

    def shown() -> Iterator[Simulation]:
        for n in range(count):
            seen, _ = env.reset(seed=episode_seed(task, LEARNED + n, TRAIN))
            state = seen["agent_pos"]
            if n % 2:
                arms = data.state[rows[n]].reshape(len(SIDES), -1).copy()
                arms[:, -1] = 1.0
                state = arms.reshape(-1)
                simulation.duo.set_configuration(DuoCommand.from_flat(state))
                simulation.forward()
            states.append(state)
            objects.append(seen["environment_state"][list(data.columns)])
            yield simulation

    images = _rendered(shown, count)
    env.close()
    number = np.arange(count)
    held = number // 2 % HELD_OUT == HELD_OUT - 1
    before = np.where(number % 2, MOVED, 0)
    return Pictures(images, np.array(states), np.array(objects), before, held)


def in_play(policy: Policy, task: str, data: Demonstrations, episodes: int) -> Pictures:
    """Render every sixth step of a policy that plays layouts of `train`, failures too.

    What it drops, and holds otherwise than shown, is seen nowhere else.
    """
    options = needed_options(policy.metadata)
    env = duobench.make(task, split=TRAIN, **options)
    simulation = env.get_wrapper_attr("simulation")
    states, objects, before, number = [], [], [], []

    def shown() -> Iterator[Simulation]:
        for n in range(episodes):
            seen, _ = env.reset(seed=episode_seed(task, LEARNED + n, TRAIN))
            policy.reset("", n)
            steps, is_over, actions = 0, False, iter(())
            while not is_over:
                if steps % EVERY == 0:
                    states.append(seen["agent_pos"])
                    objects.append(seen["environment_state"][list(data.columns)])
                    before.append(steps)
                    number.append(n)
                    yield simulation
                action = next(actions, None)
                if action is None:
                    actions = iter(policy.act(seen))
                    action = next(actions)
                seen, _, ends, is_cut, _ = env.step(action)
                steps, is_over = steps + 1, ends or is_cut
            if n % 20 == 0:
                print(f"{task}: {n + 1} of {episodes} episodes played", flush=True)

    limit = env.get_wrapper_attr("definition").horizon
    images = _rendered(shown, episodes * math.ceil(limit / EVERY))
    env.close()
    held = np.array(number) % HELD_OUT == HELD_OUT - 1
    return Pictures(images, np.array(states), np.array(objects), np.array(before), held)


def _rendered(shown: Callable[[], Iterator[Simulation]], most: int) -> list[Pixels]:
    """Images of each camera of what one simulation shows, one after the other."""
    images = [np.empty((most, *size, 3), np.uint8) for size in SIZES.values()]
    backend, count = None, 0
    for place, simulation in enumerate(shown()):
        backend = backend or SimBackend(simulation)
        seen = backend.images_by_kind({"rgb": dict(SIZES)})["rgb"]
        for camera, image in zip(SIZES, images, strict=True):
            image[place] = seen[camera]
        count = place + 1
    if backend:
        backend.close()
    return [image[:count] for image in images]
