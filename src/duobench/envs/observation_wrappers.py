"""Further content and form of observations, and sensing that is worse than usual."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, cast

import gymnasium as gym
import numpy as np

from duobench.core.backend import (
    DEPTH,
    RGB,
    SEGMENTATION,
    CameraGeometry,
    DuoBackend,
    Wanted,
)
from duobench.core.errors import OptionError
from duobench.core.randomness import EVAL
from duobench.core.types import Array, as_several
from duobench.envs.camera_options import name_of, wanted_images
from duobench.envs.config import IMAGE_SIZE
from duobench.envs.duo_env import (
    DuoWrapper,
    Observation,
    ObservingWrapper,
    ResetOptions,
    Start,
    Transition,
    base_of,
)
from duobench.envs.episode_state import EpisodeState
from duobench.tasks.object_state import ENVIRONMENT_STATE, LARGEST
from duobench.tasks.shifts import levels
from duobench.tasks.shifts.levels import level_for
from duobench.tasks.shifts.samples import EpisodeKey
from duobench.tasks.shifts.shift import SENSING, Shift
from duobench.world.objects.segmentation import CAMERA, GRIPPERS, MOUNT
from duobench.world.robot.camera_geometry import named
from duobench.world.robot.cameras import (
    FARTHEST,
    POLICY_CAMERAS,
    Camera,
    check_image_size,
)
from duobench.world.robot.stereo import StereoQuality, measured_depth

if TYPE_CHECKING:
    from duobench.envs.sim_env import SimEnv
    from duobench.world.sim.backend import SimBackend

PIXELS = "pixels"
"""Key of the images in an observation."""
KEYS: Mapping[str, str] = {RGB: PIXELS, DEPTH: DEPTH, SEGMENTATION: SEGMENTATION}
"""Key of the images of each kind."""
FLAT_ENDS: Mapping[str, str] = {
    PIXELS: "image",
    DEPTH: DEPTH,
    SEGMENTATION: SEGMENTATION,
}
"""End of the name of an image of each of these keys in a flat observation."""
NO_SIZES: Mapping[str, tuple[int, int]] = {}


class Cameras(ObservingWrapper):
    """Adds images to the observation, by the name of the camera.

    `pixels` holds colours (height, width, 3), uint8; `depth` metres along the optical axis
    (height, width), float32, 0 where nothing is or what is there is further than 7 m;
    `segmentation` the number of the part that is shown (height, width), int32, 0 for none, see
    `DuoEnv.segmentation_ids`. Each is there if it is asked for.

    It belongs outside action chunks: one image of each camera is rendered for each step and each
    reset, nothing before the first reset. `set_rendering` leaves out images that are not
    needed; `env.get_wrapper_attr` finds it through any wrappers.

    Args:
        cameras: Names of cameras, and cameras of one's own.
        image_size: Height and width in pixels, at most the native 720 x 1280. An image of the
            robot's cameras shows the whole native field of view at every size.
        depth: Names of the cameras whose depth it adds.
        segmentation: Names of the cameras whose parts it adds.
        image_sizes: Sizes by name, of cameras with another one.

    Raises:
        UnknownNameError: There is no such camera.
        RenderingError: The size is larger than the native one, or not positive.
        BackendError: A camera of real arms gives no such images.
    """

    def __init__(
        self,
        env: gym.Env,
        cameras: str | Camera | Sequence[str | Camera] = POLICY_CAMERAS,
        image_size: tuple[int, int] = IMAGE_SIZE,
        depth: str | Sequence[str] = (),
        segmentation: str | Sequence[str] = (),
        image_sizes: Mapping[str, tuple[int, int]] = NO_SIZES,
    ) -> None:
        seen = as_several((cameras,) if isinstance(cameras, Camera) else cameras)
        far, parts = as_several(depth), as_several(segmentation)
        if seen is None or far is None or parts is None:
            raise OptionError(
                "cameras, depth and segmentation are a name, or a list of names; got "
                f"{cameras!r}, {depth!r} and {segmentation!r}."
            )
        self._wanted = wanted_images(seen, far, parts, image_size, image_sizes)
        self._is_rendering = True
        for sizes in self._wanted.values():
            for size in sizes.values():
                check_image_size(*size)
        ids = base_of(env).segmentation_ids if parts else {}
        spaces: dict[str, gym.Space] = {
            KEYS[kind]: gym.spaces.Dict(
                {
                    name_of(camera): _space(kind, size, ids)
                    for camera, size in sizes.items()
                }
            )
            for kind, sizes in self._wanted.items()
        }
        super().__init__(
            env,
            spaces,
            cameras=seen,
            image_size=image_size,
            depth=far,
            segmentation=parts,
            image_sizes=image_sizes,
        )

    @property
    def wanted(self) -> Wanted:
        """Images of an observation, by their kind."""
        return self._wanted

    @property
    def cameras(self) -> dict[str, CameraGeometry]:
        """Lens and place at this step of each camera whose images are observed."""
        sizes = {
            camera: size
            for each in self._wanted.values()
            for camera, size in each.items()
        }
        return dict(self.base.backend.camera_geometry(sizes))

    def set_rendering(self, is_on: bool) -> None:
        """Switch images on or off; while they are off, an observation has none."""
        self._is_rendering = is_on

    def observation(self, observation: Observation) -> Observation:
        """The observation with images of each camera, unless they are switched off."""
        if not self._is_rendering:
            return observation
        images = self.base.backend.images_by_kind(self._wanted)
        return {**observation, **{KEYS[kind]: images[kind] for kind in self._wanted}}


def _space(kind: str, size: tuple[int, int], ids: Mapping[str, int]) -> gym.spaces.Box:
    """The space of an image."""
    if kind == DEPTH:
        return gym.spaces.Box(0.0, FARTHEST, size, dtype=np.float32)
    if kind == SEGMENTATION:
        return gym.spaces.Box(0, max(ids.values()), size, dtype=np.int32)
    return gym.spaces.Box(0, 255, (*size, 3), dtype=np.uint8)


class ObjectStates(ObservingWrapper):
    """Adds `environment_state` to the observation: the numbers (n,) of `Task.object_state`.

    They are privileged: read from the simulation. `object_state_names` says what each is.

    Raises:
        TypeError: There is no simulation inside.
    """

    def __init__(self, env: gym.Env) -> None:
        base = base_of(env)
        if not hasattr(base, "simulation"):  # asked without loading one
            raise TypeError(
                "Object states are read from a simulation, and there is none in a "
                f"{type(base).__name__}."
            )
        self._simulation = cast("SimEnv", base).simulation
        self._state = base.definition.object_state
        numbers = gym.spaces.Box(
            -LARGEST, LARGEST, (len(self._state.names),), dtype=np.float32
        )
        super().__init__(env, {ENVIRONMENT_STATE: numbers})

    @property
    def object_state_names(self) -> tuple[str, ...]:
        """Name of each number of `environment_state`."""
        return self._state.names

    def observation(self, observation: Observation) -> Observation:
        """The observation with the numbers of the current state."""
        return {**observation, ENVIRONMENT_STATE: self._state.read(self._simulation)}


class FlatObservations(ObservingWrapper):
    """Gives a `Dict` of one level: `head_image`, `left_wrist_image`, ... instead of `pixels`.

    Likewise `head_depth` and `head_segmentation`. Libraries of reinforcement learning take no
    `Dict` inside a `Dict`. The images stay arrays of their shape, and everything else stays as it
    is; no vector is made of it. Put it outside the wrappers that add to the observation.
    """

    def __init__(self, env: gym.Env) -> None:
        super().__init__(env, {})
        nested = cast("gym.spaces.Dict", env.observation_space)
        self.observation_space = gym.spaces.Dict(flat_entries(nested.spaces))

    def observation(self, observation: Observation) -> Observation:
        """The same observation, with images beside the numbers."""
        return flat_entries(observation)


def flat_entries(entries: Mapping[str, Any]) -> dict[str, Any]:
    """Entries of an observation, or their spaces, with each image at the top."""
    images = {
        f"{camera}_{end}": image
        for key, end in FLAT_ENDS.items()
        for camera, image in entries.get(key, {}).items()
    }
    return {
        key: value for key, value in entries.items() if key not in FLAT_ENDS
    } | images


MAX_AGE = 30
"""Most frames that a camera drops in a row; the next one always comes."""
NOISY = {"agent_pos": levels.JOINT_NOISE, "environment_state": levels.POSE_NOISE}
_FRAMES = "frames"
"""Beside the noise, so that which frames are dropped does not depend on what else is observed."""
_TOOL = 7
"""Numbers of one tool's pose, the first three of which are its position."""


class Sensing(DuoWrapper):
    """Gives observations as worse sensors would, from the seed of the layout; physics stay.

    Every camera takes a frame each control step, and drops it with a probability: then it shows the
    state of the last frame that it did not drop, in all kinds of images. Depth is measured as a
    stereo camera does, by `duobench.world.robot.stereo.measured_depth`. Joint positions, openings,
    positions of tools and the numbers of objects have Gaussian noise that is new at every step.
    What an episode meets does not depend on who asks for images, or when. Noise in colours belongs
    to the look.

    Args:
        env: A simulated environment with its cameras, if it has any.
        shift: How bad the sensors are.
    """

    def __init__(self, env: gym.Env, shift: Shift) -> None:
        from duobench.envs.sim_env import sim_of

        super().__init__(env, shift=shift)
        self._level = level_for(shift, SENSING, self.task)
        self._base = sim_of(env)
        try:
            self._wanted: Wanted = env.get_wrapper_attr("wanted")
        except AttributeError:  # there are no cameras inside
            self._wanted = {}
        self._cameras = {
            name_of(camera): camera
            for sizes in self._wanted.values()
            for camera in sizes
        }
        self._own = sorted(self._cameras.keys() - {*POLICY_CAMERAS})
        self._quality = StereoQuality(
            subpixel=levels.DEPTH_SUBPIXEL[self._level],
            farthest=levels.DEPTH_FARTHEST[self._level],
            shiny_share=levels.DEPTH_SHINY_SHARE[self._level],
        )
        self._seed = 0
        self._generator = self._frames = np.random.default_rng(0)
        self._own_frames: dict[str, np.random.Generator] = {}
        self._ages: dict[str, int] = {}
        self._past: deque[Array] = deque(maxlen=MAX_AGE + 1)
        self._past_backend: SimBackend | None = None

    def reset(self, *, seed: int | None = None, options: ResetOptions = None) -> Start:
        """Begin an episode; its first frames are not dropped."""
        observation, info = self.env.reset(seed=seed, options=options)
        split = info.get("split") or EVAL
        key = EpisodeKey(task=self.task, seed=info.get("seed") or 0, split=split)
        self._generator, self._frames = key.generator(SENSING), key.generator(_FRAMES)
        self._own_frames = {
            name: key.generator(f"{_FRAMES} {name}") for name in self._own
        }
        self._seed = key.seed
        self._begin()
        return self._sensed(observation), info

    def step(self, action: Any) -> Transition:
        """Advance one step, and see what sensors show of it."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        self._past.append(self._base.simulation.get_state())
        # Every camera has its number, also one that is not used.
        chances = self._frames.uniform(size=len(POLICY_CAMERAS)).tolist()
        chances += [float(each.uniform()) for each in self._own_frames.values()]
        cameras = (*POLICY_CAMERAS, *self._own)
        for camera, chance in zip(cameras, chances, strict=True):
            is_dropped = chance < levels.DROPPED_SHARE[self._level]
            age = self._ages[camera]
            self._ages[camera] = age + 1 if is_dropped and age < MAX_AGE else 0
        return self._sensed(observation), float(reward), terminated, truncated, info

    def observe(self) -> Observation:
        """The observation of this moment, with other noise than the one before."""
        return self._sensed(super().observe())

    def restore_state(self, state: EpisodeState) -> Start:
        """Continue from a saved state, with fresh frames and other noise than the first time.

        It follows from the state alone.
        """
        observation, info = super().restore_state(state)
        seed = int(state.hash, 16)
        self._generator = np.random.default_rng((seed, 0))
        self._frames = np.random.default_rng((seed, 1))
        self._own_frames = {
            name: np.random.default_rng((seed, 2, *name.encode())) for name in self._own
        }
        self._seed = seed
        self._begin()
        return self._sensed(observation), info

    def close(self) -> None:
        """Free the renderer of what is past."""
        if self._past_backend is not None:
            self._past_backend.close()
            self._past_backend = None
        super().close()

    def _begin(self) -> None:
        self._ages = dict.fromkeys((*POLICY_CAMERAS, *self._own), 0)
        self._past.clear()
        self._past.append(self._base.simulation.get_state())

    def _sensed(self, observation: Observation) -> Observation:
        sensed = dict(observation)
        for name, noise in NOISY.items():
            if name in sensed:
                sensed[name] = self._noisy(sensed[name], noise[self._level])
        poses = sensed["tcp_pose"].reshape(-1, _TOOL).copy()
        poses[:, :3] = self._noisy(poses[:, :3], levels.POSE_NOISE[self._level])
        sensed["tcp_pose"] = poses.ravel()
        for kind, images in self._images(sensed).items():
            sensed[KEYS[kind]] = images
        space: Any = self.observation_space
        for name in sensed.keys() & {*NOISY, "tcp_pose"}:
            sensed[name] = np.clip(sensed[name], space[name].low, space[name].high)
        return sensed

    def _noisy(self, numbers: Array, deviation: float) -> Array:
        noise = self._generator.standard_normal(numbers.shape) * deviation
        return (numbers + noise).astype(numbers.dtype)

    def _images(self, observation: Observation) -> dict[str, dict[str, Any]]:
        """Images of an observation as its cameras show them: late, and with measured depth."""
        shown = {
            kind: dict(observation[KEYS[kind]])
            for kind in self._wanted
            if KEYS[kind] in observation
        }
        for name, camera in self._cameras.items() if shown else ():
            kinds = [kind for kind in shown if name in shown[kind]]
            if not self._ages[name]:
                kinds = [kind for kind in kinds if kind == DEPTH]
            size = next(
                sizes[camera] for sizes in self._wanted.values() if camera in sizes
            )
            # What is shiny is told by the parts that pixels show.
            more = (SEGMENTATION,) if DEPTH in kinds else ()
            wanted = {kind: {camera: size} for kind in (*kinds, *more)}
            images = self._backend_at(self._ages[name]).images_by_kind(wanted)
            for kind in kinds:
                shown[kind][name] = images[kind][name]
            if more:
                shown[DEPTH][name] = measured_depth(
                    images[DEPTH][name],
                    np.isin(images[SEGMENTATION][name], self._shiny),
                    named(camera),
                    self._quality,
                    f"{self._seed}".encode()
                    + self._past[-1 - self._ages[name]].tobytes(),
                )
        return shown

    @cached_property
    def _shiny(self) -> list[int]:
        """Numbers of the parts that are of bare metal and glass; objects are printed, so matt."""
        ids = self.segmentation_ids
        return [ids[part] for part in (*GRIPPERS.values(), CAMERA, MOUNT)]

    def _backend_at(self, age: int) -> DuoBackend:
        """Arms as they were some control steps ago."""
        if not age:
            return self._base.backend
        if self._past_backend is None:
            from duobench.world.sim.backend import SimBackend
            from duobench.world.sim.simulation import Simulation

            task = self._base.definition
            robot = self._base.backend.robot
            self._past_backend = SimBackend(
                Simulation(task.props, task.overview, robot)
            )
        backend = self._past_backend
        backend.set_look(self._base.look)
        backend.simulation.apply(self._base.layout)
        backend.simulation.set_state(self._past[-1 - age])
        return backend
