"""Many episodes of a task side by side in one process, on MuJoCo's own threads.

They are those of `duobench.make` to the last bit: layouts, states, stages, observations and images.
Resets, images and what a task of one's own describes for one simulation are done one after the
other in a single environment; physics, stages and numbers of all episodes at once.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from duobench.envs.action_modes import JOINT, JOINT_RELATIVE
from duobench.envs.action_wrappers import THRESHOLD
from duobench.envs.config import (
    LAYOUT,
    LAYOUT_SEED,
    OF_SIMULATION,
    SPLIT,
    EnvConfig,
    checked_reset_options,
    checked_seed,
)
from duobench.envs.duo_env import ROUNDING, DuoWrapper, ResetNeededError
from duobench.envs.episode_state import EpisodeState, required
from duobench.envs.episode_wrappers import SEEDS
from duobench.envs.observation_wrappers import PIXELS, flat_entries
from duobench.envs.sim_env import sim_of
from duobench.errors import ActionError, OptionError, check_known
from duobench.looks.look import Look
from duobench.robot.joints import RANGE_MARGIN, duo_limits
from duobench.shifts.levels import level_for
from duobench.shifts.shift import PHYSICS, SENSING
from duobench.sim.batch import SimulationBatch, World
from duobench.stages.batch import Booleans, ProgressBatch
from duobench.tasks.object_state import ENVIRONMENT_STATE
from duobench.types import OPENING_SLOTS, Array, real_array

Observations = dict[str, Any]
Infos = dict[str, Any]
"""Arrays, one row for each episode."""
MODES = (JOINT.name, JOINT_RELATIVE.name)
RESET_MASK, STATES = "reset_mask", "states"
"""Options of a reset beside those of `SimEnv`: which episodes begin anew, and from what states."""
KEPT_STARTS = 4096
"""Starts of episodes that are kept, about 5 kB each."""
ELSEWHERE = 'take vectorization_mode="async" in place of threads'
OPENINGS = list(OPENING_SLOTS)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Start:
    """How an episode begins, and what is said of it."""

    state: EpisodeState
    instruction: str
    subinstructions: Sequence[str]
    look: Look
    seed: int
    """Seed of the layout; -1 for a layout or a state that was given."""


class BatchEnv(VectorEnv[dict[str, Any], Any, Any]):
    """A vector environment without processes, with next-step autoreset and arrays in `info`.

    Episode i of a reset with a seed is that of `make` with seed + i, and so are the episodes that
    follow it by themselves. `info` holds, at every reset and step and for every episode, `stage`,
    `max_stage`, `success`, `is_success`, `success_at_end`, `clipped`, `sent`, `seed` (-1 for a
    layout that was given), `instruction` and `current_subinstruction`, with `chunk` also `rewards`
    and `executed`, as `make` has them.

    The options of a reset are those of `SimEnv`, for all episodes alike, and two more. `reset_mask`
    (n,) says which episodes begin anew; the others stay as they are. `states` has for each episode
    an `EpisodeState`, as `save_state` gives it, from which it continues, or None.

    Args:
        env: One environment of the same kind; it belongs to this one from now on.
        num_envs: How many episodes.
        threads: On how many threads physics runs.
        layouts: Episodes without a seed take one of so many layouts, those of the seeds 0 to
            `layouts` - 1, which are settled once; None takes a new one each time.

    Raises:
        OptionError: A part of the configuration works only one environment at a time.
    """

    def __init__(
        self, env: DuoWrapper, num_envs: int, threads: int, layouts: int | None = None
    ) -> None:
        config = env.config or EnvConfig()
        _check(config, env.task)
        self._env, self._config, self._base = env, config, sim_of(env)
        self.num_envs = num_envs
        self.spec, self.render_mode = env.spec, config.render_mode
        self.metadata = {**env.metadata, "autoreset_mode": AutoresetMode.NEXT_STEP}
        self.single_action_space = env.action_space
        self.single_observation_space = env.observation_space
        self.action_space = batch_space(env.action_space, num_envs)
        self.observation_space = batch_space(env.observation_space, num_envs)
        self._simulations = SimulationBatch(self._base.simulation, num_envs, threads)
        self._judge = ProgressBatch(self._base.definition.stages, self._simulations)
        self._limits = [self._base.backend.limits]
        if config.speed_fraction != 1.0:
            fractions = config.speed_fraction, config.speed_fraction
            self._limits.append(duo_limits(fractions, RANGE_MARGIN))
        self._horizon = np.inf if env.spec is None else env.spec.max_episode_steps or np.inf
        if config.cameras:
            env.get_wrapper_attr("set_rendering")(False)  # they are rendered here, once a step
        self._layouts = SEEDS if layouts is None else layouts
        self._bank: dict[tuple[int, str], Start] = {}
        self._generators = [seeding.np_random()[0] for _ in range(num_envs)]
        self._starts: list[Start] = []
        self._steps = np.zeros(num_envs, dtype=np.int64)
        self._is_over = np.zeros(num_envs, dtype=np.bool_)
        self._sent = np.zeros((num_envs, len(self._limits[0].low)))
        self._texts = np.empty((num_envs, self._judge.max_stage + 1), dtype=object)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Observations, Infos]:
        """Begin episodes, all of them unless the options say otherwise.

        Args:
            seed: Seeds episode i with `seed` + i, or one seed for each.
            options: See the class.

        Raises:
            OptionError: A seed or an option is invalid.
            StateError: A state is none of this environment.
        """
        given = checked_reset_options(options, (*OF_SIMULATION, RESET_MASK, STATES))
        seeds = _for_each(seed, self.num_envs)
        mask = given.pop(RESET_MASK, None)
        states = given.pop(STATES, None)
        mask = np.ones(self.num_envs, dtype=bool) if mask is None else np.asarray(mask)
        states = [None] * self.num_envs if states is None else states
        if mask.dtype != bool or mask.shape != (self.num_envs,) or len(states) != self.num_envs:
            raise OptionError(
                f"{RESET_MASK} has a boolean and {STATES} a state or None for each of the "
                f"{self.num_envs} environments, got {mask!r} and {len(states)} states."
            )
        if not self._starts and not mask.all():
            raise ResetNeededError("The first reset begins all episodes; leave reset_mask out.")
        numbers = np.flatnonzero(mask).tolist()
        self._begin({n: self._start(n, seeds[n], given, states[n]) for n in numbers})
        return self._observations(), self._info(np.zeros(self._sent.shape, dtype=bool))

    def _start(
        self, number: int, seed: int | None, options: Mapping[str, Any], state: EpisodeState | None
    ) -> Start:
        """How the next episode of one environment begins."""
        if seed is not None:
            self._generators[number] = seeding.np_random(seed)[0]
        if state is not None:
            _, info = self._env.restore_state(state)
            required(state.steps, "time limit")
            return self._as_it_is(info, -1)
        if options.get(LAYOUT) is not None:
            _, info = self._env.reset(options=dict(options))
            return self._as_it_is(info, -1)
        used = checked_seed(options.get(LAYOUT_SEED))
        if used is None:
            used = int(self._generators[number].integers(self._layouts)) if seed is None else seed
        key = used, options.get(SPLIT) or self._config.split
        is_usual = not options.keys() - {LAYOUT_SEED, SPLIT}
        if is_usual and key in self._bank:
            return self._bank[key]
        _, info = self._env.reset(options={**options, LAYOUT_SEED: used})
        start = self._as_it_is(info, used)
        if is_usual:
            self._bank[key] = start
            if len(self._bank) > KEPT_STARTS:
                del self._bank[next(iter(self._bank))]
        return start

    def _as_it_is(self, info: Mapping[str, Any], seed: int) -> Start:
        """The start that the single environment is at."""
        return Start(
            state=self._env.save_state(),
            instruction=info["instruction"],
            subinstructions=list(self._base.subinstructions.values()),
            look=self._base.look,
            seed=seed,
        )

    def _begin(self, starts: Mapping[int, Start]) -> None:
        self._starts = self._starts or [starts[number] for number in range(self.num_envs)]
        self._simulations.load(
            {
                number: World(variants=start.state.layout.variants, physics=start.state.physics)
                for number, start in starts.items()
            }
        )
        commands = self._simulations.commands()
        for number, start in starts.items():
            self._starts[number] = start
            self._judge.set_state(number, required(start.state.progress, "stages"))
            self._steps[number], self._is_over[number] = start.state.steps or 0, start.state.over
            self._sent[number] = commands[number]
            # Once the task is solved, what was to be done last is still the answer.
            self._texts[number] = [*start.subinstructions, start.subinstructions[-1]]

    def step(
        self, actions: Any
    ) -> tuple[dict[str, Any], Array, Booleans, Booleans, dict[str, Any]]:
        """Advance all episodes by one step; those that are over begin anew instead.

        Raises:
            ActionError: The actions have another shape, or are not finite. Nothing was moved.
            ResetNeededError: There was no reset yet.
            SimulationError: The physics of some episodes became invalid; reset them.
        """
        if not self._starts:
            raise ResetNeededError("No episode is running; call reset first.")
        chunks = self._checked(actions)
        where = ~self._is_over
        begin = {n: self._start(n, None, {}, None) for n in np.flatnonzero(self._is_over).tolist()}
        rewards = np.zeros(chunks.shape[:2])
        clipped = np.zeros(self._sent.shape, dtype=bool)
        executed = np.zeros(self.num_envs, dtype=np.int64)
        terminated, truncated = np.zeros((2, self.num_envs), dtype=bool)
        for place in range(chunks.shape[1]):
            if not where.any():
                break
            clipped |= self._advance(chunks[:, place], where)
            stage = self._judge.stage
            rewards[where, place] = stage[where] / self._judge.max_stage
            executed += where
            terminated |= where & (stage == self._judge.max_stage)
            truncated |= where & (self._steps >= self._horizon)
            where &= ~(terminated | truncated)
        self._is_over = terminated | truncated
        if begin:
            self._begin(begin)
        info = self._info(clipped)
        if self._config.chunk is not None:
            info |= {"rewards": rewards, "executed": executed}
        return self._observations(), rewards.sum(axis=1), terminated, truncated, info

    def _advance(self, actions: Array, where: Booleans) -> Booleans:
        """Advance some episodes by one control step, and say what of actions (n, k) was clipped."""
        targets = actions
        if self._config.action_mode == JOINT_RELATIVE.name:
            targets = actions + self._sent
            targets[:, OPENINGS] = actions[:, OPENINGS]
        within = targets
        for limits in self._limits:
            within = limits.clip(within, self._sent)
        self._sent[where] = within[where]
        worlds = np.flatnonzero(where)
        self._simulations.advance(worlds, within[worlds])
        self._judge.update(where)
        self._steps += where
        return (np.abs(within - targets) > ROUNDING) & where[:, None]

    def _checked(self, actions: Any) -> Array:
        """Actions (n, chunk, 16) as finite numbers."""
        shape = self.action_space.shape or ()
        try:
            numbers = real_array(actions, np.float64)
        except (TypeError, ValueError) as error:
            raise ActionError(f"Actions are an array of numbers {shape}: {error}") from error
        if numbers.shape != shape or not np.isfinite(numbers).all():
            raise ActionError(
                f"Actions are finite and of shape {shape} here, one row for each environment; got "
                f"shape {numbers.shape}{'' if numbers.shape != shape else ' with NaN or infinity'}."
                " Nothing was moved; the environments wait for other actions."
            )
        numbers = numbers.reshape(self.num_envs, -1, shape[-1]).copy()
        if self._config.binary_gripper:
            numbers[..., OPENINGS] = numbers[..., OPENINGS] >= THRESHOLD
        return numbers

    def _observations(self) -> Observations:
        tools = self._simulations.tool_poses().reshape(self.num_envs, -1)
        observations: Observations = {
            "agent_pos": self._simulations.proprioception().astype(np.float32),
            "tcp_pose": tools.astype(np.float32),
        }
        if self._config.object_state:
            state = self._base.definition.object_state
            observations[ENVIRONMENT_STATE] = state.read_all(self._simulations)
        if cameras := self._config.cameras:
            size = self._config.image_size
            seen = self._images(lambda: self._base.backend.images(cameras, size))
            observations[PIXELS] = {name: np.stack([one[name] for one in seen]) for name in cameras}
        return flat_entries(observations) if self._config.flat_obs else observations

    def _images(self, render: Callable[[], Any]) -> list[Any]:
        """What the single environment renders of each episode."""
        images: list[Any] = []
        for number, start in enumerate(self._starts):
            self._simulations.world(number)
            self._base.backend.set_look(start.look)
            images.append(render())
        return images

    def _info(self, clipped: Booleans) -> Infos:
        judge = self._judge
        success = judge.stage == judge.max_stage
        return {
            "stage": judge.stage.copy(),
            "max_stage": np.full(self.num_envs, judge.max_stage),
            "success": success,
            "is_success": success.copy(),
            "success_at_end": judge.final_holds.copy(),
            "clipped": clipped,
            "sent": self._sent.copy(),
            "seed": np.array([start.seed for start in self._starts]),
            "instruction": np.array([start.instruction for start in self._starts], dtype=object),
            "current_subinstruction": self._texts[np.arange(self.num_envs), judge.standing],
        }

    def save_state(self, number: int) -> EpisodeState:
        """The whole state of one of the episodes; `make`'s `restore_state` takes it as well."""
        if not self._starts:
            raise ResetNeededError("There is no state before the first reset; call reset first.")
        start = self._starts[number]
        return EpisodeState(
            layout=start.state.layout,
            physics=self._simulations.physics(number),
            scale=start.state.scale,
            instruction=start.instruction,
            progress=self._judge.get_state(number),
            steps=int(self._steps[number]),
            over=bool(self._is_over[number]),
        )

    def call(self, name: str) -> tuple[Any, ...]:
        """Something of each episode: `save_state`, `state_hash`, `layout` or `task_description`."""
        check_known("call of a vector environment", name, _OF_STATES)
        return tuple(_OF_STATES[name](self.save_state(n)) for n in range(self.num_envs))

    def render(self) -> tuple[Any, ...]:
        """What `render` of each episode gives."""
        return tuple(self._images(self._env.render))

    def close_extras(self, **kwargs: Any) -> None:  # noqa: ARG002 - Gymnasium's way
        """Free the renderers."""
        self._env.close()


_OF_STATES: Mapping[str, Callable[[EpisodeState], Any]] = {
    "save_state": lambda state: state,
    "state_hash": lambda state: state.hash,
    "layout": lambda state: state.layout,
    "task_description": lambda state: state.instruction,
}


def _check(config: EnvConfig, task: str) -> None:
    if config.action_mode not in MODES:
        raise OptionError(
            f"Threads take action_mode {' or '.join(MODES)}, got {config.action_mode!r}, whose "
            f"inverse kinematics is solved one arm at a time: {ELSEWHERE}."
        )
    for axis in (PHYSICS, SENSING):
        if level_for(config.shift, axis, task):
            raise OptionError(f"Threads take no shift of {axis}, got {config.shift}: {ELSEWHERE}.")


def _for_each(seed: Any, count: int) -> list[int | None]:
    """A seed for each of several environments, as Gymnasium's have them."""
    if seed is None or not isinstance(seed, Sequence | np.ndarray):
        first = checked_seed(seed)
        return [None if first is None else first + number for number in range(count)]
    if len(seed) != count:
        raise OptionError(f"Seeds are one number, or one for each of {count}; got {len(seed)}.")
    return [checked_seed(one) for one in seed]
