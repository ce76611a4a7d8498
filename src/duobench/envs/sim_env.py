"""The simulated environment: layouts, the reset script, and the state of an episode."""

from collections.abc import Iterator, Mapping
from dataclasses import asdict
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from duobench.core.errors import DuoBenchError, LayoutError, UnknownNameError
from duobench.core.randomness import EVAL
from duobench.envs.config import (
    INSTRUCTION,
    LAYOUT,
    LAYOUT_SEED,
    LOOK,
    OF_SIMULATION,
    RENDER_SIZE,
    SPLIT,
    checked_instruction,
    checked_reset_options,
    checked_seed,
)
from duobench.envs.duo_env import (
    ClosedEnvError,
    DuoEnv,
    Info,
    ResetNeededError,
    Start,
    base_of,
)
from duobench.envs.episode_state import EpisodeState
from duobench.tasks.shifts.samples import (
    UNSCALED,
    EpisodeKey,
    PhysicsScale,
    kept_paraphrase,
    physics_scale,
    shifted_look,
    shifted_task,
)
from duobench.tasks.shifts.shift import NO_SHIFT, Shift
from duobench.tasks.stages.progress import Progress, ProgressState, check_names
from duobench.tasks.task import Task
from duobench.world.looks.catalog import DEFAULT, as_look
from duobench.world.looks.look import Look
from duobench.world.robot.cameras import OVERVIEW
from duobench.world.robot.frames import ROBOT, Robot
from duobench.world.sim import placement
from duobench.world.sim.backend import SimBackend
from duobench.world.sim.layout import Layout
from duobench.world.sim.simulation import Simulation

DEFAULT_SEED = 0
"""A reset without a layout uses the one that this seed samples."""


class SimEnv(DuoEnv):
    """A `DuoEnv` in simulation, whose objects are laid out at every reset.

    The scene depends on the layout alone. Privileged state is read through `simulation`.

    The options of a reset: `layout` is the layout, as a `Layout` or as its JSON form; without it,
    `layout_seed` samples one from the task's `split`, "eval" or "train". `look` is the look of this
    episode, a name, a `Look` or its JSON form; without it, the environment's. `instruction` is the
    policy's, as text, or as the number of one of the task's `instructions`; without it, the
    task's own. Info also holds `layout` (JSON form). A reset raises a LayoutError for a layout that
    is incomplete, overlapping or out of reach, an UnknownNameError where there is no such option,
    split or look, and an OptionError for an invalid look, seed or instruction. Observation
    and info are taken after everything has come to rest.

    Args:
        task: What is on the table.
        render_mode: "rgb_array", or None for no `render`.
        render_size: Height and width of the image that `render` gives, in pixels.
        look: How images look; a name or a look.
        speed_fraction: Part of the joints' speed limits that the arms use; see `EnvConfig`.
        shift: What differs from the usual episodes, by the seed of the layout.
        robot: Description of the arms.

    Raises:
        UnknownNameError: There is no such look, or it names an object that the task has not.
        OptionError: The fraction is not over 0 and at most 1.
    """

    def __init__(
        self,
        task: Task,
        *,
        render_mode: str | None = None,
        render_size: tuple[int, int] = RENDER_SIZE,
        look: str | Look = DEFAULT,
        speed_fraction: float = 1.0,
        shift: Shift = NO_SHIFT,
        robot: Robot = ROBOT,
    ) -> None:
        self.simulation = Simulation(task.props, task.overview, robot)
        """The physics."""
        self._arms = SimBackend(self.simulation, speed_fraction)
        super().__init__(self._arms, task)
        self._usual_look = as_look(look)
        self._arms.set_look(self._usual_look)
        self.render_mode = render_mode
        self._render_size = render_size
        self._layout: Layout | None = None
        self._shift = shift
        self._scale = UNSCALED
        self._shifted = shifted_task(task, shift)

    @property
    def layout(self) -> Layout:
        """Layout of the current episode; an error before the first reset."""
        if self._layout is None:
            raise ResetNeededError(
                "There is no layout before the first reset; call reset first."
            )
        return self._layout

    @property
    def look(self) -> Look:
        """Look of the images of the current episode."""
        return self._arms.look

    def set_look(self, look: Look) -> None:
        """Give images in another look until the next reset."""
        self._arms.set_look(look)

    @property
    def subinstructions(self) -> dict[int, str]:
        """Instruction at each stage 0 to n-1 to reach the next one, in this layout."""
        return self.definition.subinstructions(self.layout)

    def make_judge(self) -> "SimJudge":
        """Judge of episodes by the stages of the task, all of whose names are checked here."""
        return SimJudge(self)

    def _begin(self, options: Mapping[str, Any]) -> Info:
        options = checked_reset_options(options, OF_SIMULATION)
        words = checked_instruction(
            options.get(INSTRUCTION), len(self.definition.instructions)
        )
        look = (
            self._usual_look if (given := options.get(LOOK)) is None else as_look(given)
        )
        # What shifts sample follows from the seed; a layout that is given stands for none.
        seed = checked_seed(options.get(LAYOUT_SEED)) or DEFAULT_SEED
        key = EpisodeKey(task=self.task, seed=seed, split=options.get(SPLIT, EVAL))
        self._arms.set_look(shifted_look(self._shift, key, look))
        self._set_scale(physics_scale(self._shift, key))
        self._arms.home()
        tried: list[Mapping[str, Any]] = []
        candidates = self._candidates(options.get(LAYOUT), key, tried)
        self._layout = placement.first_valid(self.simulation, candidates, self.task)
        own = self._instruct(self._layout, words if isinstance(words, int) else 0)
        if options.get(INSTRUCTION) is None:
            kept = self.definition.kept_paraphrases
            number = kept_paraphrase(self._shift, key, len(kept))
            words = (
                None if number is None else kept[number].format(**self._layout.variants)
            )
        self._instruction = words if isinstance(words, str) else own
        self.simulation.settle()
        return {LAYOUT: _as_floats(tried[-1])}

    def _set_scale(self, scale: PhysicsScale) -> None:
        """Scale the physics of the model; state is to be set afterwards."""
        self.simulation.scaler.apply(**asdict(scale))
        self._scale = scale

    def _candidates(
        self, given: Any, key: EpisodeKey, tried: list[Mapping[str, Any]]
    ) -> Iterator[Layout]:
        """The layouts that a reset may begin with; the JSON form of each is appended to `tried`.

        A sampled one takes the way through its JSON form too: a rotation that is written as a
        quaternion differs from the sampled one in its last bit, and what info reports must begin
        exactly the same episode.
        """
        if given is not None:
            tried.append(given.to_json() if isinstance(given, Layout) else given)
            layout = Layout.from_json(tried[-1])
            self._instruct(layout)
            yield layout
            return
        for sampled in self._shifted.layouts(key.seed, key.split):
            tried.append(sampled.to_json())
            yield Layout.from_json(tried[-1])

    def _instruct(self, layout: Layout, number: int = 0) -> str:
        """One of the task's instructions for a layout, whose variants must be complete."""
        for name, choice in self.definition.variants.items():
            value = layout.variants.get(name)
            if value not in choice.options:
                raise LayoutError(
                    f"Task {self.task!r} has a variant {name!r}, one of "
                    f"{', '.join(choice.options)}; the layout says {value!r}."
                )
        try:
            self.definition.subinstructions(layout)
            return self.definition.instruct(layout, number)
        except UnknownNameError as error:
            raise LayoutError(f"The layout lacks a variant. {error}") from error

    def save_state(self) -> EpisodeState:
        """The whole state of the running episode, of this environment and its wrappers."""
        ClosedEnvError.check(self.closed)
        return EpisodeState(
            layout=self.layout,
            physics=self.simulation.get_state(),
            scale=self._scale,
            instruction=self._instruction,
            look=self.look,
        )

    def state_hash(self) -> str:
        """SHA-256 of the whole state of the running episode; equal states, equal hashes."""
        return self.save_state().hash

    def restore_state(self, state: EpisodeState) -> Start:
        """Continue from a saved state of the same task; bit-exact.

        Returns:
            Observation and info as the step before gave them, but for `clipped`.

        Raises:
            LayoutError: The state is that of another task.
            SimulationError: The state was saved by another task or version.
        """
        ClosedEnvError.check(self.closed)
        self._running = False
        own = self._instruct(state.layout)
        instruction = own if state.instruction is None else state.instruction
        self._arms.set_look(state.look or self._usual_look)
        self._set_scale(state.scale)
        self.simulation.apply(state.layout)
        self._arms.home()
        self.simulation.set_state(state.physics)
        self._layout, self._instruction = state.layout, instruction
        self._sent = self.backend.last_command.flat
        self._running = True
        return self._observation(), self._info()

    def render(self) -> NDArray[np.uint8]:
        """The scene from the overview camera, (height, width, 3), for people.

        Raises:
            DuoBenchError: The environment was made without a render mode.
            ResetNeededError: There was no reset yet.
        """
        ClosedEnvError.check(self.closed)
        if self.render_mode is None:
            raise DuoBenchError(
                'This environment was made without images; make it with render_mode="rgb_array".'
            )
        if self._layout is None:
            raise ResetNeededError("There is nothing to see before the first reset.")
        return self.backend.images((OVERVIEW,), self._render_size)[OVERVIEW]


class SimJudge(Progress):
    """Judges by the task's constraints, from the state of the simulation."""

    def __init__(self, env: SimEnv) -> None:
        task = env.definition
        sampled = next(task.layouts(0))
        for number in range(len(task.instructions)):
            task.instruct(sampled, number)
        task.subinstructions(sampled)
        options = {name: choice.options for name, choice in task.variants.items()}
        check_names(task.stages, env.simulation, sampled.variants, options)
        super().__init__(task.stages)
        self._env = env

    def begin(self) -> None:
        """Begin at stage 0, and remember where everything is."""
        self.reset(self._env.simulation, self._env.layout.variants)

    def judge(self) -> None:
        """Evaluate the stage rule."""
        self.update(self._env.simulation)

    def near(self) -> float:
        """Nearness of the next stage, from 0 to below 1."""
        return self.nearness(self._env.simulation)

    def set_state(
        self, state: ProgressState, variants: Mapping[str, str] | None = None
    ) -> None:
        """Continue from a state, in the environment's layout where no variants are given."""
        super().set_state(
            state, self._env.layout.variants if variants is None else variants
        )


def _as_floats(layout: Mapping[str, Any]) -> dict[str, Any]:
    """The JSON form of a layout with plain numbers, as it was given."""
    poses = {
        name: [float(number) for number in pose]
        for name, pose in layout["poses"].items()
    }
    return {"poses": poses, "variants": dict(layout.get("variants", {}))}


def sim_of(env: gym.Env) -> SimEnv:
    """The `SimEnv` under all wrappers.

    Raises:
        TypeError: The environment is not simulated; layouts and privileged state need that.
    """
    base = base_of(env)
    if not isinstance(base, SimEnv):
        raise TypeError(f"Expected a simulated environment, got {type(base).__name__}.")
    return base
