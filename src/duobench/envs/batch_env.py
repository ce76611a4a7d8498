"""Many episodes of a task side by side in one process, on threads or on a graphics card.

On threads they are those of `duobench.make` to the last bit: layouts, states, stages, observations
and images. On a card, layouts are, and the rest is near.
Resets and images are made one after the other in a single environment; physics, stages and numbers
of all episodes at once.
"""

from __future__ import annotations

from collections.abc import (
    Callable,
    Iterable,
    Mapping,
    Sequence,
)
from dataclasses import replace
from typing import Any, SupportsIndex

import gymnasium as gym
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from duobench.core.backend import CameraGeometry
from duobench.core.errors import ActionError, OptionError, SimulationError
from duobench.core.spatial import SE3
from duobench.core.types import (
    ARM_JOINTS,
    OPENING_SLOTS,
    SIDE_SIZE,
    SIDES,
    Array,
    Side,
)
from duobench.envs import action_modes, spaces
from duobench.envs.action_modes import (
    CARTESIAN,
    CARTESIAN_RELATIVE,
    JOINT,
    JOINT_RELATIVE,
)
from duobench.envs.action_wrappers import (
    MIN_NORM,
    THRESHOLD,
    displaced_poses,
    joint_targets,
)
from duobench.envs.config import (
    LAYOUT,
    LAYOUT_SEED,
    OF_SIMULATION,
    SPLIT,
    EnvConfig,
    checked_reset_options,
    checked_seed,
)
from duobench.envs.duo_env import (
    ROUNDING,
    ClosedEnvError,
    Info,
    Observation,
    ResetNeededError,
)
from duobench.envs.episode_state import EpisodeState, required
from duobench.envs.episode_wrappers import SEEDS
from duobench.envs.observation_wrappers import KEYS, flat_entries
from duobench.envs.registration import WARP
from duobench.envs.rewards import DENSE, reward_of
from duobench.envs.sim_env import sim_of
from duobench.tasks.object_state import ENVIRONMENT_STATE
from duobench.tasks.shifts.levels import level_for
from duobench.tasks.shifts.samples import UNSCALED
from duobench.tasks.shifts.shift import PHYSICS, SENSING
from duobench.tasks.stages.batch import Booleans, ProgressBatch
from duobench.world.robot.joints import RANGE_MARGIN, SERVO_LAG, duo_limits
from duobench.world.sim.batch import SimulationBatch
from duobench.world.sim.thread_batch import ThreadBatch
from duobench.world.sim.warp_batch import WarpBatch

RESET_MASK, STATES = "reset_mask", "states"
"""Options of a reset beside those of `SimEnv`: which episodes begin anew, and from what states."""
KEPT_STARTS = 4096
"""Starts of episodes that are kept, about 5 kB each."""
OPENINGS = list(OPENING_SLOTS)
Start = tuple[EpisodeState, Info]
"""Start of an episode: its state, the info of its reset, and its look."""


class BatchEnv(gym.vector.VectorEnv[Observation, Any, Any]):
    """A vector environment without processes, with arrays in `info`.

    Episode i of a reset with a seed is that of `make` with seed + i, and so are the episodes that
    follow it by themselves. `info` holds what that of `make` holds, in arrays, and dicts of arrays:
    all but `layout` and `split` at every reset and step and for every episode, `seed` too (-1 for a
    layout or a state that was given). Those two are told of episodes that begin, `_layout` and
    `_split` say of which; `rewards` and `executed` of a chunk of those that were stepped, and
    `final_obs` and `final_info` of those that were over and began anew in the same step.

    The options of a reset are those of `SimEnv`, for all episodes alike, and two more: `reset_mask`
    (n,) says which episodes begin anew, while the others stay as they are; `states` has for each
    episode a state that `save_state` gave, from which it goes on, or None.

    Args:
        env: One environment of the same kind; it belongs to this one from now on.
        num_envs: How many episodes.
        threads: On how many threads physics runs; None for MuJoCo Warp, another engine that
            `metadata["engine"]` names then.
        layouts: Episodes without a seed take one of so many layouts, those of the seeds 0 to
            `layouts` - 1, which are settled once; None takes a new one each time.
        autoreset_mode: NEXT_STEP, SAME_STEP, or DISABLED: then an episode that is over is reset by
            its mask.

    Raises:
        OptionError: A part of the configuration takes environments of their own; see `takes`.
    """

    def __init__(
        self,
        env: gym.Env,
        num_envs: int,
        threads: int | None,
        layouts: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
    ) -> None:
        self._env, self._base = env, sim_of(env)
        config = self._config = self._base.config or EnvConfig()
        if not takes(env):
            raise OptionError(
                f"Threads and Warp take no shift of {PHYSICS} or {SENSING}; leave threads and "
                "engine out to have them."
            )
        try:
            autoreset_mode = AutoresetMode(autoreset_mode)
        except ValueError as error:
            raise OptionError(
                "autoreset_mode is NEXT_STEP, SAME_STEP or DISABLED, an AutoresetMode; got "
                f"{autoreset_mode!r}."
            ) from error
        if config.wanted:
            env.get_wrapper_attr("set_rendering")(
                False
            )  # images of all are rendered here
        self.num_envs = num_envs
        self.spec = env.spec
        self.render_mode = config.render_mode
        self.config = config
        """Configuration of the environments."""
        self.object_state_names = self._base.definition.object_state.names
        """Name of each number of an object state."""
        self.autoreset_mode = autoreset_mode
        self.metadata = {**env.metadata, "autoreset_mode": autoreset_mode}
        self.single_action_space = env.action_space
        self.single_observation_space = env.observation_space
        self.action_space = batch_space(env.action_space, num_envs)
        self.observation_space = batch_space(env.observation_space, num_envs)
        simulation = self._base.simulation
        self.simulations: SimulationBatch = (
            WarpBatch(simulation, num_envs)
            if threads is None
            else ThreadBatch(simulation, num_envs, threads)
        )
        """The physics of all episodes."""
        if threads is None:
            self.metadata["engine"] = WARP
        self.judge = ProgressBatch(self._base.definition.stages, self.simulations)
        """Judge of the stages that they have reached."""
        self._worth: Array = np.zeros(num_envs)
        self._limits = [self._base.backend.limits]
        if config.speed_fraction != 1.0:
            fractions = config.speed_fraction, config.speed_fraction
            self._limits.append(duo_limits(fractions, RANGE_MARGIN, SERVO_LAG))
        self._horizon = (env.spec and env.spec.max_episode_steps) or np.inf
        self._max_stage = self._base.definition.max_stage
        self._layouts = layouts or SEEDS
        self._bank: dict[tuple[int, str], Start] = {}
        self._generators = [seeding.np_random()[0] for _ in range(num_envs)]
        self._starts: list[Start] = []
        self._steps = np.zeros(num_envs, dtype=np.int64)
        self._is_over = np.zeros(num_envs, dtype=np.bool_)
        self._sent = np.zeros((num_envs, len(spaces.JOINT_NAMES)))
        self._texts = np.empty((num_envs, self._max_stage + 1), dtype=object)
        self._mode = action_modes.get(config.action_mode)
        self._tool_targets: list[dict[Side, SE3]] = [{} for _ in range(num_envs)]
        if self._mode in (CARTESIAN, CARTESIAN_RELATIVE):
            self._kinematics = env.get_wrapper_attr("kinematics")

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: Info | None = None,
    ) -> tuple[Observation, Info]:
        """Begin episodes, all of them unless the options say otherwise.

        Args:
            seed: Seeds episode i with `seed` + i, or one seed for each.
            options: See the class; errors are those of `SimEnv`.
        """
        ClosedEnvError.check(self.closed)
        given = checked_reset_options(options, (*OF_SIMULATION, RESET_MASK, STATES))
        count, seeds = self.num_envs, seed
        if isinstance(seeds, np.ndarray) and not seeds.ndim:  # a number of NumPy
            seeds = seeds.item()
        mask = np.asarray(given.pop(RESET_MASK, np.ones(count, dtype=bool)))
        states = given.pop(STATES, [None] * count)
        if not isinstance(states, Sequence | np.ndarray):
            raise OptionError(f"{STATES} is a list of states, got {states!r}.")
        if not isinstance(seeds, Sequence | np.ndarray):
            first = checked_seed(seeds)
            seeds = [
                None if first is None else first + number for number in range(count)
            ]
        if mask.dtype != bool or {mask.shape, (len(states),), (len(seeds),)} != {
            (count,)
        }:
            raise OptionError(
                f"A list of seeds, {STATES} and the booleans of {RESET_MASK} have one entry for "
                f"each of the {count} environments."
            )
        if not (self._starts or mask.all()):
            raise ResetNeededError(
                "The first reset begins all episodes; leave reset_mask out."
            )
        numbers = np.flatnonzero(mask).tolist()
        starts = {
            n: self._start(n, checked_seed(seeds[n]), given, states[n]) for n in numbers
        }
        if starts:
            self._begin(starts)
        return self._observations(), self._info(
            np.zeros(self._sent.shape, dtype=bool), starts
        )

    def _start(
        self,
        number: int,
        seed: int | None,
        options: Info,
        state: EpisodeState | None = None,
    ) -> Start:
        """Make the start of the next episode of one environment."""
        if seed is not None:
            self._generators[number] = seeding.np_random(seed)[0]
        if state is not None:
            if getattr(state, "scale", UNSCALED) != UNSCALED:
                raise OptionError(
                    f"The state for environment {number} is of a shift of {PHYSICS}, which threads "
                    "and Warp do not play."
                )
            return self._made(self._env.get_wrapper_attr("restore_state")(state)[1])
        if options.get(LAYOUT) is not None:
            return self._made(self._env.reset(options=options)[1])
        used = checked_seed(options.get(LAYOUT_SEED))
        if used is None:
            used = (
                int(self._generators[number].integers(self._layouts))
                if seed is None
                else seed
            )
        if options.keys() - {LAYOUT_SEED, SPLIT}:
            return self._made(
                self._env.reset(options={**options, LAYOUT_SEED: used})[1]
            )
        key = used, options.get(SPLIT, self._config.split)
        if key not in self._bank:
            self._bank[key] = self._made(
                self._env.reset(options={LAYOUT_SEED: used, SPLIT: key[1]})[1]
            )
            if len(self._bank) > KEPT_STARTS:
                del self._bank[next(iter(self._bank))]
        return self._bank[key]

    def _made(self, info: Info) -> Start:
        """The start that the single environment is at."""
        state = self._env.get_wrapper_attr("save_state")()
        return state, {"seed": -1, **info, "look": self._base.look}

    def _begin(self, starts: Mapping[int, Start]) -> None:
        self._starts = self._starts or [
            starts[number] for number in range(self.num_envs)
        ]
        states, numbers = (
            [state for state, _ in starts.values()],
            np.array(list(starts)),
        )
        variants = [state.layout.variants for state in states]
        self.simulations.load(numbers, variants, [state.physics for state in states])
        self._sent[numbers] = self.simulations.commands()[numbers]
        for number, (state, info) in starts.items():
            self._starts[number] = state, info
            self.judge.set_state(number, required(state.progress, "stages"))
            self._steps[number], self._is_over[number] = state.steps or 0, state.over
            self._tool_targets[number] = dict(state.tool_targets or ())
            texts = list(info["stage_to_subinstructions"].values())
            # Once the task is solved, what was to be done last is still the answer.
            self._texts[number] = [*texts, texts[-1]]
        if self._config.reward == DENSE:
            self.simulations.look_at(numbers)
        self._worth[numbers] = self._measured()[numbers]

    def step(self, actions: Any) -> tuple[Observation, Array, Booleans, Booleans, Info]:
        """Advance all episodes by one step; those that are over begin anew instead.

        Raises:
            ActionError: The actions have another shape, or are not finite. Nothing was moved.
            ResetNeededError: There was no reset yet, or one of what is over is missing.
            SimulationError: The physics of some episodes became invalid; reset all.
        """
        ClosedEnvError.check(self.closed)
        if not self._starts:
            raise ResetNeededError("No episode is running; call reset first.")
        if self._is_over.any() and self.autoreset_mode is AutoresetMode.DISABLED:
            raise ResetNeededError(
                "An episode is over; reset it, by reset_mask if others go on."
            )
        chunks = self._checked(actions)
        count, length = chunks.shape[:2]
        running = ~self._is_over
        begin = {n: self._start(n, None, {}) for n in np.flatnonzero(~running).tolist()}
        rewards, executed = np.zeros((count, length)), np.zeros(count, dtype=np.int64)
        terminated, truncated = np.zeros((2, count), dtype=np.bool_)
        clipped = np.zeros(self._sent.shape, dtype=np.bool_)
        try:
            for number in range(length):
                where = running & ~(terminated | truncated)
                clipped |= self._advance(chunks[:, number], where)
                before, worth = self._worth, self._measured()
                # What is over is not looked at any more, and keeps what it was worth.
                self._worth = np.where(where, worth, before)
                paid = reward_of(self._config.reward, before, worth, self._max_stage)
                rewards[:, number] = np.where(where, paid, 0.0)
                executed += where
                terminated |= where & (self.judge.stage == self._max_stage)
                truncated |= where & (self._steps >= self._horizon)
        except SimulationError:
            self._starts = []
            raise
        self._is_over = terminated | truncated
        of_chunks: Info = {"rewards": rewards, "executed": executed}
        of_chunks = {} if self._config.chunk is None else of_chunks
        told: Info = {}
        if self.autoreset_mode is AutoresetMode.SAME_STEP and self._is_over.any():
            begin = self._finish(told, {**self._info(clipped, ()), **of_chunks})
            running &= ~self._is_over
            clipped &= running[:, None]
        for key, values in of_chunks.items():
            told[key] = (values.T * running).T
            told[f"_{key}"] = running
        if begin:
            self._begin(begin)
        return (
            self._observations(),
            np.array([each.sum() for each in rewards]),  # as one episode sums its own
            terminated,
            truncated,
            {**told, **self._info(clipped, begin)},
        )

    def _finish(self, told: Info, info: Info) -> dict[int, Start]:
        """Tell how episodes that are over ended, and make the starts of those that follow."""
        observation = self._observations()
        begin = {}
        for number in np.flatnonzero(self._is_over).tolist():
            ends = {
                "final_obs": _of_one(observation, number),
                "final_info": _of_one(info, number),
            }
            self._add_info(told, ends, number)
            begin[number] = self._start(number, None, {})
        return begin

    def _measured(self) -> Array:
        """Quantities of the rewards (n,): the stage, and how near the next one is."""
        stage = self.judge.stage.astype(np.float64)
        return stage + self.judge.nearness() if self._config.reward == DENSE else stage

    def _advance(self, actions: Array, where: Booleans) -> Booleans:
        """Advance some episodes by a control step, and say which numbers (n, 16) were clipped."""
        targets = self._joint_targets(actions, where)
        within, simulations = targets, self.simulations
        measured, velocities = (
            simulations.proprioception(),
            simulations.joint_velocities(),
        )
        for limits in self._limits:
            within = limits.clip(within, self._sent, measured, velocities)
        gripper = self._base.backend.robot.gripper
        self._sent[where] = within[where]
        told = within
        waits = np.flatnonzero(~gripper.takes_target(self._steps))[:, None]
        if len(waits):
            told = within.copy()
            told[waits, OPENINGS] = simulations.commands()[waits, OPENINGS]
        worlds = np.flatnonzero(where)
        if len(worlds):
            simulations.advance(worlds, told[worlds])
        self.judge.update(where)
        self._steps += where
        return (np.abs(within - targets) > ROUNDING) & where[:, None]

    def _joint_targets(self, actions: Array, where: Booleans) -> Array:
        """Joint actions (n, 16) that actions of any mode mean for some episodes."""
        if self._mode is JOINT:
            return actions
        targets = self._sent.copy()
        if self._mode is JOINT_RELATIVE:
            targets += actions
            targets[:, OPENINGS] = actions[:, OPENINGS]
            return targets
        numbers = np.flatnonzero(where)
        if not len(numbers):
            return targets
        joints = targets[numbers].reshape(-1, len(SIDES), SIDE_SIZE)[..., :ARM_JOINTS]
        poses = actions[numbers]
        if self._mode is CARTESIAN_RELATIVE:
            rows = zip(numbers.tolist(), joints, poses, strict=True)
            poses = np.array([self._displaced(*row) for row in rows])
        targets[numbers] = joint_targets(self._kinematics, joints, poses)
        return targets

    def _displaced(self, number: int, joints: Array, displacements: Array) -> Array:
        """The Cartesian action (16,) that a relative one means for an episode, and add it up."""
        poses, self._tool_targets[number] = displaced_poses(
            self._kinematics, joints, self._tool_targets[number], displacements
        )
        return poses

    def _checked(self, actions: Any) -> Array:
        """Chunks of actions (n, length, k) as numbers that could be executed, or an error."""
        numbers = spaces.numbers(actions, self.action_space.shape or ())
        count, size = len(numbers), len(self._mode.names)
        chunks = numbers.reshape(count, -1, size).copy()
        wrong = ~np.isfinite(chunks).all(axis=(1, 2))
        what = "finite"
        if self._mode is CARTESIAN and not wrong.any():
            poses = chunks.reshape(count, -1, SIDE_SIZE)
            lengths = np.sqrt((poses[..., 3:ARM_JOINTS] ** 2).sum(axis=-1))
            wrong = (lengths < MIN_NORM).any(axis=1)
            what = "poses whose quaternions (qx qy qz qw) are of length one"
        if wrong.any():
            raise ActionError(
                f"Actions must be {what}, but those of environments "
                f"{np.flatnonzero(wrong).tolist()} are not. Nothing was moved; the environments "
                "wait for other actions."
            )
        if self._config.binary_gripper:
            slots = spaces.opening_slots(size)
            chunks[..., slots] = chunks[..., slots] >= THRESHOLD
        return chunks

    def _observations(self) -> Observation:
        observation: Observation = {
            "agent_pos": self.simulations.proprioception().astype(np.float32),
            "tcp_pose": self.simulations.tool_poses().astype(np.float32),
        }
        if self._config.object_state:
            numbers = self._base.definition.object_state
            observation[ENVIRONMENT_STATE] = numbers.read(self.simulations)
        wanted = self._config.wanted
        if wanted:
            seen = self._rendered(lambda: self._base.backend.images_by_kind(wanted))
            for kind in wanted:
                observation[KEYS[kind]] = {
                    name: np.stack([one[kind][name] for one in seen])
                    for name in seen[0][kind]
                }
        return flat_entries(observation) if self._config.flat_obs else observation

    @property
    def cameras(self) -> dict[str, CameraGeometry]:
        """Lens and place of each camera at this step, arrays with an entry for each episode."""
        if not self._config.wanted:
            return {}
        seen = self._rendered(lambda: self._env.get_wrapper_attr("cameras"))
        return {
            name: CameraGeometry(
                matrix=np.stack([one[name].matrix for one in seen]),
                table_from_camera=np.stack(
                    [one[name].table_from_camera for one in seen]
                ),
            )
            for name in (seen[0] if seen else ())
        }

    @property
    def segmentation_ids(self) -> dict[str, int]:
        """Number in a segmentation of each part of the scene, by name."""
        return self._base.segmentation_ids

    def _rendered(self, render: Callable[[], Any]) -> list[Any]:
        """Images, or what else follows from them, of each episode in the single environment."""
        images: list[Any] = []
        for number, (_, info) in enumerate(self._starts):
            self.simulations.world(number)
            self._base.set_look(info["look"])
            images.append(render())
        return images

    def _info(self, clipped: Booleans, begun: Iterable[int]) -> Info:
        count, infos = self.num_envs, [info for _, info in self._starts]
        success = self.judge.stage == self._max_stage
        told: Info = {
            "stage": self.judge.stage.copy(),
            "max_stage": np.full(count, self._max_stage),
            "success": success,
            "is_success": success.copy(),
            "success_at_end": self.judge.final_holds.copy(),
            "clipped": clipped,
            "sent": self._sent.copy(),
            "seed": np.array(
                [-1 if info["seed"] is None else info["seed"] for info in infos]
            ),
            "instruction": np.array(
                [info["instruction"] for info in infos], dtype=object
            ),
            "current_subinstruction": self._texts[
                np.arange(count), self.judge.standing
            ],
            "stage_to_subinstructions": {
                stage: self._texts[:, stage].copy() for stage in range(self._max_stage)
            },
        }
        for number in begun:
            # A state that was given does not say where its episode began.
            start = {
                key: infos[number][key]
                for key in (LAYOUT, SPLIT)
                if key in infos[number]
            }
            told = self._add_info(told, start, number)
        return told

    def save_state(self, number: int) -> EpisodeState:
        """The whole state of one of the episodes; an environment of `make` takes it as well."""
        ClosedEnvError.check(self.closed)
        if not self._starts:
            raise ResetNeededError(
                "There is no state before the first reset; call reset first."
            )
        if not isinstance(number, SupportsIndex) or not 0 <= number < self.num_envs:
            raise OptionError(f"Episodes are 0 to {self.num_envs - 1}, got {number}.")
        start, _ = self._starts[number]
        return replace(
            start,
            physics=self.simulations.physics(number),
            progress=self.judge.get_state(number),
            steps=None if start.steps is None else int(self._steps[number]),
            over=start.steps is not None and bool(self._is_over[number]),
            tool_targets=None
            if start.tool_targets is None
            else tuple(self._tool_targets[number].items()),
        )

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """Answer of a method, or value of an attribute, for the environment of each episode.

        All episodes share one environment, which is brought into the state of each.

        Raises:
            OptionError: The method moves an episode.
        """
        ClosedEnvError.check(self.closed)
        answers = []
        for number in range(self.num_envs):
            state = self.save_state(number) if self._starts else None
            if state is not None:
                self._env.get_wrapper_attr("restore_state")(state)
            answer = self._env.get_wrapper_attr(name)
            if callable(answer):
                answer = answer(*args, **kwargs)
            answers.append(answer)
            after = self._base.simulation.get_state()
            if state is not None and not np.array_equal(after, state.physics):
                raise OptionError(
                    f"{name} moves an episode. Step and reset all of them together, some by "
                    f"{RESET_MASK} and {STATES}; or make environments of their own, by "
                    'vectorization_mode="sync".'
                )
        return tuple(answers)

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Value of an attribute for the environment of each episode; see `call`."""
        return self.call(name)

    def set_attr(self, name: str, values: Any) -> None:
        """Set an attribute of the environment that all episodes share.

        Args:
            name: The attribute.
            values: Its value, or a list with the same one for each episode.

        Raises:
            OptionError: The values differ, or are not one for each episode.
        """
        if not isinstance(values, list | tuple):
            values = [values] * self.num_envs
        if len(values) != self.num_envs or any(one != values[0] for one in values):
            raise OptionError(
                f"{name} is one value for all {self.num_envs} episodes, which share an "
                f'environment; got {values!r}. With vectorization_mode="sync" each has its own.'
            )
        self._env.set_wrapper_attr(name, values[0])

    def render(self) -> tuple[Any, ...]:
        """Images that `render` of each episode gives."""
        ClosedEnvError.check(self.closed)
        if not self._starts:
            raise ResetNeededError(
                "There is nothing to see before the first reset; call reset first."
            )
        return tuple(self._rendered(self._env.render))

    def close_extras(self, **_kwargs: Any) -> None:
        """Free the renderers."""
        self._env.close()


def takes(env: gym.Env) -> bool:
    """Whether episodes of an environment can be played side by side."""
    base = sim_of(env)
    config = base.config or EnvConfig()
    levels = (level_for(config.shift, axis, base.task) for axis in (PHYSICS, SENSING))
    return not any(levels)


def _of_one(values: Mapping[Any, Any], number: int) -> dict[Any, Any]:
    """What observations or info hold of one episode."""
    return {
        key: _of_one(value, number) if isinstance(value, Mapping) else value[number]
        for key, value in values.items()
        if not str(key).startswith("_")
    }
