"""Images to learn to see from: of demonstrations, of layouts at rest, and of a policy's own play.

What is to be seen in them is known: the simulation says it. Kept are whole images in half of the
size that they are rendered in, and windows around objects in that size.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from demonstrations import Demonstrations, Rows
from frames import bodies, places_in, rotations_of, with_pose_noise
from grasps import MOVED
from numpy.typing import NDArray
from own_play import LEARNED
from sight import SIZES, WINDOW, places_of_cameras, rendered_sizes, whole
from windows import Windows

import duobench
from duobench.core.errors import DataError
from duobench.core.randomness import TRAIN, episode_seed
from duobench.core.spatial import SE3
from duobench.core.types import SIDES, DuoCommand
from duobench.data import DataSet, ImageSource
from duobench.envs.execution import Step
from duobench.evaluation import Watcher, rollout
from duobench.policy import Policy
from duobench.results.run import needed_options
from duobench.world.robot.frames import robot_with
from duobench.world.sim.backend import SimBackend
from duobench.world.sim.simulation import Simulation

EVERY = 6
"""Rows of an episode from one image that is learned from to the next."""
HELD_OUT = 10
"""Every n-th episode, and pair of layouts, is not learned from, and tells how well is seen."""
UNDER_OTHER_ARMS = 10
"""Which row of an episode a layout at rest under arms that are elsewhere counts as."""
NEARLY = 0.02
"""Largest standard deviation (m) of where objects are told to be as windows are cut around them;
each image draws its own up to it."""
GRASP_NOISE = 3e-3, 0.03
"""Largest standard deviations (m, rad) of how what is held is moved and turned in demonstrations
before these are rendered, as hands hold things that grasp by what they see; each image draws its
own up to these."""
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
    row: NDArray[np.int64]
    """Which row (T,) of its episode each is."""
    held_out: NDArray[np.bool_]
    """Which (T,) are not learned from."""
    window_places: NDArray[np.float32]
    """About where objects are (T, K, 3)."""
    near: Pixels
    """Windows around there (T, cameras, K, 3, height, width)."""


def joined(parts: list[Pictures]) -> Pictures:
    """All of these, one behind the other; the list is emptied, as they fill gigabytes."""
    columns = [
        [getattr(part, field.name) for part in parts] for field in fields(Pictures)
    ]
    parts.clear()
    images = [list(one) for one in zip(*columns.pop(0), strict=True)]
    of_cameras = [_taken(one) for one in images]
    return Pictures(of_cameras, *(_taken(column) for column in columns))


def _taken(column: list[NDArray[Any]]) -> NDArray[Any]:
    both = np.concatenate(column)
    column.clear()
    return both


class _Album:
    """Renders what simulations show, one after the other."""

    def __init__(self, data: Demonstrations, most: int) -> None:
        self._where = places_in(data.names)
        self._robot = robot_with(data.gripper)
        self._rng = np.random.default_rng(most)
        self._backend: SimBackend | None = None
        windows = (len(SIZES), len(self._where), 3, WINDOW, WINDOW)
        self._images = [np.empty((most, *size, 3), np.uint8) for size in SIZES.values()]
        self._near = np.empty((most, *windows), np.uint8)
        self._rows: list[tuple[Any, ...]] = []

    def add(
        self,
        simulation: Simulation,
        state: Rows,
        objects: Rows,
        row: int,
        episode: int,
    ) -> None:
        """Render what a simulation, the same each time, shows now.

        Args:
            simulation: The simulation.
            state: Joints and openings (16,).
            objects: The object state (n,).
            row: Which row of its episode it is.
            episode: The number of that: every tenth one is held out.
        """
        self._backend = self._backend or SimBackend(simulation)
        there = np.stack([objects[part] for part in self._where])
        spread = NEARLY * self._rng.random()
        around = there + spread * self._rng.normal(size=there.shape)
        around = around.astype(np.float32)
        rgb = self._backend.images_by_kind({"rgb": rendered_sizes()})["rgb"]
        seen = [torch.from_numpy(rgb[name].transpose(2, 0, 1))[None] for name in SIZES]
        cameras = torch.from_numpy(places_of_cameras(state[None], self._robot))
        windows = Windows.around(torch.from_numpy(around)[None], cameras)
        place = len(self._rows)
        self._near[place] = windows.cut(seen)[0].round().byte().numpy()
        for one, images in zip(seen, self._images, strict=True):
            images[place] = whole(one)[0].permute(1, 2, 0).numpy()
        is_held_out = episode % HELD_OUT == HELD_OUT - 1
        self._rows.append((state, objects, row, is_held_out, around))

    def pictures(self) -> Pictures:
        """What was rendered."""
        if self._backend:
            self._backend.close()
        count = len(self._rows)
        rows = (np.array(column) for column in zip(*self._rows, strict=True))
        images = [one[:count] for one in self._images]
        return Pictures(images, *rows, self._near[:count])


def watch(demos: Path, task: str, data: Demonstrations) -> Pictures:
    """Render every sixth row of demonstrations.

    Args:
        demos: Folder of the recordings that the export was made of.
        task: Their task.
        data: The demonstrations, which say how many.

    Raises:
        DataError: The recordings are others.
    """
    number = np.repeat(np.arange(len(data.lengths)), data.lengths)
    recordings = DataSet.open(demos, create=False).recordings(task)
    source = ImageSource(task)
    album = _Album(data, sum(len(range(0, n, EVERY)) for n in data.lengths))
    rng = np.random.default_rng(0)
    for episode in range(len(data.lengths)):
        recording, rows = next(recordings, None), number == episode
        recorded, state, objects = (
            part[rows] for part in (data.recorded, data.state, data.objects)
        )
        if (
            recording is None
            or len(recording) <= recorded.max()
            or not np.allclose(recording.agent_pos[recorded], state, atol=1e-5)
        ):
            raise DataError(
                f"Episode {episode} of {task} in {demos} is not that of the export: "
                "name the recordings that it was made of."
            )
        for row in range(0, len(recorded), EVERY):
            source.show(recording, int(recorded[row]))
            seen = _otherwise(
                source.simulation, objects[row], objects[0], data.names, rng
            )
            album.add(source.simulation, state[row], seen, row, episode)
        if episode % 20 == 0:
            text = f"{episode + 1} of {len(data.lengths)} episodes rendered"
            print(f"{task}: {text}", flush=True)
    pictures = album.pictures()
    source.close()
    return pictures


def _otherwise(
    simulation: Simulation,
    objects: Rows,
    first: Rows,
    names: tuple[str, ...],
    rng: np.random.Generator,
) -> Rows:
    """Move and turn what no longer lies as it lay at first; the object state (n,) then.

    In demonstrations things are held, and joined, alike to a tenth of a millimetre, so that one
    would tell where another one is. Where one without axes is, such as a ball, it lies in others,
    and nothing is moved.
    """
    places = dict(zip(bodies(names), places_in(names), strict=True))
    if not all(f"{body}_x_axis_x" in names for body in places):
        return objects
    share = rng.random()
    noise = [share * size for size in GRASP_NOISE]
    moved = with_pose_noise(objects[None], names, *noise, rng)[0]
    for body, place in places.items():
        axes = [names.index(f"{body}_{axis}_axis_x") for axis in "xz"]
        parts = [place, *(slice(axis, axis + 3) for axis in axes)]
        if np.linalg.norm(objects[place] - first[place]) < MOVED:
            for part in parts:
                moved[part] = objects[part]
            continue
        at, ahead, up = (moved[part].astype(np.float64) for part in parts)
        simulation.place(body, SE3(rotations_of(ahead, up), at))
    simulation.forward()
    return moved


def at_rest(task: str, data: Demonstrations, count: int) -> Pictures:
    """Render layouts of `train` at rest.

    Every second one is under arms as they were in some row of demonstrations, with open hands: a
    hand is not always where its object is.
    """
    env = duobench.make(
        task, cameras=False, object_state=True, split=TRAIN, gripper=data.gripper
    )
    simulation = env.get_wrapper_attr("simulation")
    album = _Album(data, count)
    rows = np.random.default_rng(0).integers(len(data.state), size=count)
    for n in range(count):
        seen, _ = env.reset(seed=episode_seed(task, LEARNED + n, TRAIN))
        state, row = seen["agent_pos"], 0
        objects = seen["environment_state"][list(data.columns)]
        if n % 2:
            arms = data.state[rows[n]].reshape(len(SIDES), -1).copy()
            arms[:, -1] = 1.0
            state, row = arms.reshape(-1), UNDER_OTHER_ARMS
            simulation.duo.set_configuration(DuoCommand.from_flat(state))
            simulation.forward()
        album.add(simulation, state, objects, row, n // 2)
    pictures = album.pictures()
    env.close()
    return pictures


def in_play(policy: Policy, task: str, data: Demonstrations, episodes: int) -> Pictures:
    """Render every sixth step of a policy that plays layouts of `train`, failures too.

    What it drops, and holds otherwise than shown, is seen nowhere else.
    """
    options = needed_options(policy.metadata)
    env = duobench.make(task, split=TRAIN, gripper=data.gripper, **options)
    steps = -(-env.get_wrapper_attr("definition").horizon // EVERY)
    album = _Album(data, episodes * steps)
    watcher = _Renders(album, env, data)
    for n in range(episodes):
        seed = episode_seed(task, LEARNED + n, TRAIN)
        watcher.episode = n
        rollout(env, policy, seed=seed, hashed=n, watchers=[watcher])
        if n % 20 == 0:
            print(f"{task}: {n + 1} of {episodes} episodes played", flush=True)
    pictures = album.pictures()
    env.close()
    return pictures


class _Renders(Watcher):
    """Renders every sixth step of episodes."""

    def __init__(self, album: _Album, env: gym.Env, data: Demonstrations) -> None:
        self._album = album
        self._simulation = env.get_wrapper_attr("simulation")
        self._columns = list(data.columns)
        self.episode = 0

    def on_episode_start(
        self,
        env: gym.Env,  # noqa: ARG002
        observation: Mapping[str, Any],
        info: Mapping[str, Any],  # noqa: ARG002
    ) -> None:
        """Render the layout."""
        self._add(observation, 0)

    def on_step(self, step: Step) -> None:
        """Render it, or not."""
        if step.number % EVERY == 0 and not step.is_last:
            self._add(step.observation, step.number)

    def _add(self, observation: Mapping[str, Any], number: int) -> None:
        objects = observation["environment_state"][self._columns]
        self._album.add(
            self._simulation, observation["agent_pos"], objects, number, self.episode
        )
