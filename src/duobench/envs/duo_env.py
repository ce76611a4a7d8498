"""The base environment: the robot and a task's objects, without reward, end or randomness.

What makes it a benchmark task is wrapped around it: random resets, stages, a time limit, action
modes, action chunks, cameras. Each wrapper works on its own; `envs.protocol` puts them together.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, SupportsFloat

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray

from duobench.envs import spaces
from duobench.envs.config import RENDER_SIZE, EnvConfig, checked_reset_options, checked_seed
from duobench.errors import DuoBenchError, LayoutError, SimulationError
from duobench.scene.cameras import OVERVIEW
from duobench.sim import placement
from duobench.sim.placement import Layout
from duobench.sim.rendering import Renderer
from duobench.sim.simulation import Simulation
from duobench.tasks.task import Task
from duobench.types import CONTROL_HZ, Array, DuoCommand, DuoState

Observation = dict[str, Any]
Info = dict[str, Any]
Transition = tuple[Observation, SupportsFloat, bool, bool, Info]
"""Observation, reward, terminated, truncated, info."""

ROUNDING = 1e-6
"""A target that is changed by less than this was rounded to float32, not clipped."""
DEFAULT_SEED = 0
"""A reset without a layout uses the one that this seed draws."""


class ResetNeededError(DuoBenchError, gym.error.ResetNeeded):
    """A step outside an episode: before the first reset, or after the last step."""


class DuoEnv(gym.Env[Observation, Any]):
    """Joint targets in, proprioception out.

    An action is 16 numbers: left joints 1-7 (absolute targets in radians), left gripper opening
    (0 closed to 1 open), then the same on the right. The targets are approached linearly over one
    control step of 1/30 s. Finite targets outside the ranges are clipped, and so are joint targets
    further from the last ones than the joint moves in one control step at its speed limit;
    `info["clipped"]` (16 booleans) says which. Grippers move at the speed of their motor.

    An observation holds `agent_pos` (16,), measured, in the order of an action, and `tool_pose`
    (14,), the left and the right tool centre point in the table frame, x y z qx qy qz qw each.

    The reward is zero and an episode never ends.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": round(CONTROL_HZ)}  # noqa: RUF012 - Gymnasium's way to declare it

    def __init__(
        self,
        task: Task,
        *,
        render_mode: str | None = None,
        render_size: tuple[int, int] = RENDER_SIZE,
    ) -> None:
        """Compile the task's model; no OpenGL before the first picture.

        Args:
            task: What is on the table.
            render_mode: "rgb_array", or None if nobody calls `render`.
            render_size: Height and width of the picture that `render` draws, in pixels.
        """
        self.definition = task
        """The task as data."""
        self.config: EnvConfig | None = None
        """What was chosen about the environment; None where wrappers were put together by hand."""
        self.simulation = Simulation(task.props, task.overview)
        """The physics; privileged state is read here."""
        self.render_mode = render_mode
        self._render_size = render_size
        self._renderer: Renderer | None = None
        self._layout: Layout | None = None
        self._instruction = task.instruction
        self._running = False
        self._low, self._high = self.simulation.duo.low, self.simulation.duo.high
        self.action_space = spaces.joint_actions(self._low, self._high)
        self.observation_space = spaces.observations(self._low, self._high)

    # --- what the field's tools ask for by name --------------------------------------------------

    @property
    def task(self) -> str:
        """Id of the task."""
        return self.definition.id

    @property
    def task_description(self) -> str:
        """The instruction of this episode; before the first reset, with variants left open."""
        return self._instruction

    @property
    def _max_episode_steps(self) -> int:
        """The task's horizon in control steps; a time limit enforces it."""
        return self.definition.horizon

    # --- episodes --------------------------------------------------------------------------------

    @property
    def layout(self) -> Layout:
        """How the current episode began.

        Raises:
            ResetNeededError: There was no reset yet.
        """
        if self._layout is None:
            raise ResetNeededError("There is no layout before the first reset; call reset first.")
        return self._layout

    def first_valid(self, candidates: Iterable[Layout]) -> Layout:
        """The first layout without overlaps and out-of-reach objects; ends the running episode.

        Args:
            candidates: Layouts to try on the real geometry, in order.

        Raises:
            LayoutError: None of them was valid within a bounded number of draws.
        """
        self._running = False
        configured = (self._configured(layout) for layout in candidates)
        return placement.first_valid(self.simulation, configured, self.task)

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Observation, Info]:
        """Begin an episode.

        Args:
            seed: Seeds `np_random`; what is on the table depends on the layout alone.
            options: `layout` says how to begin, as a `Layout` or as its JSON form; other keys are
                left to others.

        Returns:
            Observation and info, both taken after everything has come to rest. Info holds
            `instruction`, `layout` (JSON form) and `clipped`.

        Raises:
            LayoutError: The layout is incomplete, overlapping or out of reach.
            OptionError: The seed is no whole number from 0 on, or the options are no dict.
        """
        options = checked_reset_options(options)
        super().reset(seed=checked_seed(seed))
        self._running = False
        plain = self._asked_for(options)
        layout = Layout.from_json(plain)
        instruction = self._instruct(layout)
        simulation = self.simulation
        problems = placement.problems(simulation, self._configured(layout))
        if problems:
            raise LayoutError(
                f"Task {self.task!r} cannot begin with this layout: {'; '.join(problems)}."
            )
        simulation.settle()
        self._layout, self._instruction = layout, instruction
        self._running = True
        info = self._info(np.zeros(len(self._low), dtype=bool))
        info["layout"] = plain
        return self._observation(simulation.duo.read()), info

    def check_action(self, action: Any) -> Array:
        """The action as 16 float64 numbers, without executing it.

        Raises:
            ActionError: It has another shape, or holds NaN or infinity.
        """
        return spaces.checked_action(action, spaces.JOINT_LABELS)

    def step(self, action: ArrayLike) -> tuple[Observation, float, bool, bool, Info]:
        """Advance one control step.

        Args:
            action: 16 numbers, see the class.

        Raises:
            ActionError: The action has another shape, or holds NaN or infinity. Nothing was moved.
            ResetNeededError: No episode is running.
            SimulationError: The physics diverged; the episode is over.
        """
        if not self._running:
            raise ResetNeededError("No episode is running; call reset first.")
        targets = self.check_action(action)
        sent = self.simulation.duo.limit(targets)
        clipped = np.abs(sent - targets) > ROUNDING
        try:
            state = self.simulation.step(DuoCommand.from_flat(sent))
        except SimulationError:
            self._running = False
            raise
        return self._observation(state), 0.0, False, False, self._info(clipped)

    def fingerprint(self) -> str:
        """SHA-256 of the full state of the simulation; equal states, equal fingerprints."""
        return self.simulation.fingerprint()

    def _configured(self, layout: Layout) -> Layout:
        if self.definition.configure is not None:
            self.definition.configure(self.simulation.model, layout)
        return layout

    def _asked_for(self, options: Mapping[str, Any]) -> dict[str, Any]:
        """The layout to begin with, as plain data.

        Every layout takes the way through plain data, so that what info reports begins exactly
        the same episode when it is given back.
        """
        given = options.get("layout")
        if given is None:
            given = self.first_valid(self.definition.layouts(DEFAULT_SEED))
        if isinstance(given, Layout):
            return given.to_json()
        layout = Layout.from_json(given)
        poses = {name: [float(number) for number in given["poses"][name]] for name in layout.poses}
        return {"poses": poses, "variants": dict(layout.variants)}

    def _instruct(self, layout: Layout) -> str:
        """The instruction for a layout, whose variants must be complete."""
        for name, choice in self.definition.variants.items():
            value = layout.variants.get(name)
            if value not in choice.options:
                raise LayoutError(
                    f"Task {self.task!r} has a variant {name!r}, one of "
                    f"{', '.join(choice.options)}; the layout says {value!r}."
                )
        try:
            return self.definition.instruct(layout)
        except KeyError as error:
            raise LayoutError(
                f"The instruction of task {self.task!r} names the variant {error}, which the "
                f"layout lacks; it has {dict(layout.variants)}."
            ) from error

    def _info(self, clipped: NDArray[np.bool_]) -> Info:
        return {"instruction": self._instruction, "clipped": clipped}

    @staticmethod
    def _observation(state: DuoState) -> Observation:
        return {
            "agent_pos": state.flat.astype(np.float32),
            "tool_pose": state.tool_poses.astype(np.float32).ravel(),
        }

    # --- pictures --------------------------------------------------------------------------------

    def render(self) -> NDArray[np.uint8]:
        """The scene from the overview camera, (height, width, 3), for people.

        Raises:
            DuoBenchError: The environment was made without a render mode.
            ResetNeededError: There was no reset yet.
        """
        if self.render_mode is None:
            raise DuoBenchError(
                'This environment was made without pictures; make it with render_mode="rgb_array".'
            )
        if self._layout is None:
            raise ResetNeededError("There is nothing to see before the first reset.")
        if self._renderer is None:
            height, width = self._render_size
            self._renderer = Renderer(self.simulation.model, height=height, width=width)
        return self._renderer.render(self.simulation.data, OVERVIEW)

    def close(self) -> None:
        """Free the renderer; closing twice is harmless."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


def base_of(env: gym.Env) -> DuoEnv:
    """The `DuoEnv` under all wrappers.

    Raises:
        TypeError: There is none.
    """
    base = env.unwrapped
    if not isinstance(base, DuoEnv):
        raise TypeError(f"Expected a DuoEnv, wrapped or not, got {type(base).__name__}.")
    return base
