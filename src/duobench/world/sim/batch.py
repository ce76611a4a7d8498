"""Many simulations of one model side by side, whichever engine steps them."""

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

from duobench.core.types import ARM_JOINTS, SIDES, Array
from duobench.world.sim.contact_table import ContactTable, Integers
from duobench.world.sim.questions import Questions
from duobench.world.sim.simulation import Simulation


class SimulationBatch(Questions):
    """Simulations of one task, which answer questions with arrays.

    Args:
        simulation: One of the same model. What no array can do is done in it, one after the other.
        count: How many.
        data: The engine's arrays, one row a simulation, under the names of MuJoCo's data.
    """

    def __init__(
        self,
        simulation: Simulation,
        count: int,
        data: Any,
    ) -> None:
        super().__init__(simulation.props, simulation.model, data)
        self.simulation, self.count = simulation, count
        self.contacts = ContactTable(simulation.model, count, simulation.robot.gripper)
        self.centres, self._ctrl = data.xipos, data.ctrl
        self._tool_frames = data.site_xpos, data.site_xmat
        self._variants: list[Mapping[str, str]] = [{}] * count
        self.variants: dict[str, Any] = {}
        """Values (n,) that the simulations' layouts chose, by the name of the choice."""
        self._memo: dict[tuple[Any, ...], Any] = {}
        self._chosen: dict[tuple[str, int], Array] = {}

    # --- state and motion ------------------------------------------------------------------------

    def load(
        self,
        worlds: Integers,
        variants: Sequence[Mapping[str, str]],
        physics: Sequence[Array],
    ) -> None:
        """Begin, or continue, some simulations with a layout's choices and a state each."""
        for number, chosen in zip(worlds.tolist(), variants, strict=True):
            self._variants[number] = chosen
        self._load(worlds, physics)
        names = self._variants[worlds[0]]
        self.variants = {
            name: np.array([chosen.get(name) for chosen in self._variants])
            for name in names
        }
        self._chosen.clear()
        self.forget()

    @abstractmethod
    def _load(self, worlds: Integers, physics: Sequence[Array]) -> None:
        """Bring some simulations, whose choices are known, into a state each."""

    @abstractmethod
    def physics(self, world: int) -> Array:
        """The state of one simulation, as `Simulation.get_state` gives it."""

    @abstractmethod
    def advance(self, worlds: Integers, commands: Array) -> None:
        """Advance some simulations (k,) by a control step towards flat commands (k, 16).

        Raises:
            SimulationError: The physics of some became invalid.
        """

    def look_at(self, worlds: Integers) -> None:
        """Read what touches in some simulations, and in no other, and forget what was read."""
        self.copy_contacts(worlds)
        self.contacts.update(self.centres)
        self.forget()

    def forget(self) -> None:
        """Forget what was read of the state before."""
        self._memo.clear()

    @abstractmethod
    def copy_contacts(self, worlds: Integers) -> None:
        """Copy the contacts of some simulations out of the engine, for `contacts.update`."""

    @abstractmethod
    def world(self, number: int) -> Simulation:
        """One of the simulations, to look at until the next one is asked for."""

    # --- what it is asked ------------------------------------------------------------------------

    def ask(self, question: Callable[[Any], Any], *, vectorized: bool) -> Any:
        """Values of a function for all simulations at once, or for one after the other (k, n)."""
        if vectorized:  # of what is fixed, a number is the same in all
            return [np.broadcast_to(number, self.count) for number in question(self)]
        return np.array(
            [question(self.world(number)) for number in range(self.count)]
        ).T

    def commands(self) -> Array:
        """The last commands (n, 16), as the actuators hold them."""
        duo = self.simulation.duo
        return duo.commands_of(self._ctrl[:, duo.actuators])

    def proprioception(self) -> Array:
        """Joint positions and openings (n, 16), as `Duo.read` gives them."""
        duo = self.simulation.duo
        flat = np.empty((self.count, len(SIDES), ARM_JOINTS + 1))
        flat[..., :ARM_JOINTS] = self._qpos[:, duo.joints]
        drivers = self._qpos[:, duo.drivers]
        openings = duo.opening_at(drivers[:, ::2] + drivers[:, 1::2])
        flat[..., ARM_JOINTS] = np.minimum(np.maximum(openings, 0.0), 1.0)
        return flat.reshape(self.count, -1)

    def joint_velocities(self) -> Array:
        """Joint velocities (n, 2, 7) in rad/s, as `Duo.joint_velocities` gives them."""
        return self._qvel[:, self.simulation.duo.dofs]

    def tool_poses(self) -> Array:
        """Tool centre points (n, 14), as `Duo.read` gives them."""
        positions, rotations = (
            array[:, self.simulation.duo.sites] for array in self._tool_frames
        )
        turns = np.empty((*positions.shape[:2], 4))
        nines = rotations.reshape(-1, 9).astype(np.float64, copy=False)
        for turn, rotation in zip(turns.reshape(-1, 4), nines, strict=True):
            mujoco.mju_mat2Quat(turn, rotation)
        turns = turns[..., [1, 2, 3, 0]]
        turns = np.where(turns[..., :1] < 0.0, -turns, turns)
        return np.concatenate([positions, turns], axis=-1).reshape(self.count, -1)

    def relative_position(self, body: str, frame: str) -> Any:
        """Origin of a body in the frame of another body, in metres, computed once."""
        if (body, frame) not in self._memo:
            self._memo[body, frame] = super().relative_position(body, frame)
        return self._memo[body, frame]

    def chosen(self, choice: str, rows: Mapping[str, Sequence[float]]) -> Array:
        """The numbers (k, n) that belong to what each layout chose."""
        key = choice, id(rows)
        if key not in self._chosen:
            self._chosen[key] = np.array(
                [rows[value] for value in self.variants[choice]]
            ).T
        return self._chosen[key]

    def _numbers(self, array: Array, row: int | slice) -> Array:
        key = id(array), str(row)
        if key not in self._memo:
            self._memo[key] = np.ascontiguousarray(array[:, row].T)
        return self._memo[key]

    def _number(self, array: Array, place: int) -> Array:
        return self._numbers(array, place)

    def _lowest(
        self,
        prop: str,
        x: Array,
        y: Array,
        z: Array,
    ) -> Array:
        if (prop,) not in self._memo:
            a, b, c = self._corners[prop][:, :, None]
            self._memo[prop,] = (a * x + b * y + c * z).min(axis=0)
        return self._memo[prop,]
