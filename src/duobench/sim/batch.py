"""Many simulations of one model side by side, on MuJoCo's own threads; bit for bit as one alone."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from duobench.scene.compose import SUBSTEPS
from duobench.scene.robotiq import DRIVER_CLOSED
from duobench.sim.contact_table import ContactTable, Integers
from duobench.sim.duo import commands_of, controls_of, ramp
from duobench.sim.questions import Questions
from duobench.sim.simulation import SOLVED, Simulation, raise_on_warning
from duobench.types import ARM_JOINTS, SIDES, Array, DuoCommand

_READY = int(mujoco.mjtStage.mjSTAGE_VEL)
"""What `Simulation.forward` computes."""
_NOTHING = int(mujoco.mjtStage.mjSTAGE_NONE)
_CONTROLS = int(mujoco.mjtState.mjSTATE_CTRL)
_CHECKED = ("qacc", "qfrc_smooth", "qfrc_constraint", "M")
_BLOCK = 128
"""Simulations whose steps are checked at a time: what is recorded for that takes 20 MB."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class World:
    """What one simulation of a batch starts from."""

    variants: Mapping[str, str]
    """The layout's choices."""
    physics: Array
    """Its state, as `Simulation.get_state` gives it."""


class SimulationBatch(Questions):
    """Simulations of the same task, which answer questions with arrays.

    Args:
        simulation: One of the same model. What no array can do is done in it, one after the other,
            so that its state is overwritten.
        count: How many.
        threads: On how many threads of the processor they are stepped.
    """

    def __init__(self, simulation: Simulation, count: int, threads: int) -> None:
        model = simulation.model
        super().__init__(simulation.props, model)
        self._simulation, self.count = simulation, count
        # MuJoCo's threads take turns with Python's: a call returns when all of them are done.
        batch = self._batch = Batch(model, count, threads, persistent=True)
        self.contacts = ContactTable(model, count)
        self._xpos, self._xmat, self._xipos = map(batch.bind, ("xpos", "xmat", "xipos"))
        self._qpos, self._qvel, self._ctrl = map(batch.bind, ("qpos", "qvel", "ctrl"))
        self._xanchor, self._xaxis = batch.bind("xanchor"), batch.bind("xaxis")
        self._tools = batch.bind("site_xpos"), batch.bind("site_xmat")
        self._switches: dict[str, NDArray[Any]] = {}
        if any(prop.choice is not None for prop in self.props.values()):
            names = "geom_contype", "geom_conaffinity"
            self._switches = {name: batch.expand(name) for name in names}
        self._variants: list[Mapping[str, str]] = [{}] * count
        self.variants: dict[str, NDArray[Any]] = {}
        """For each choice of a layout, what every simulation's has chosen (n,)."""
        self._scratch = mujoco.MjData(model)
        self._is_sparse = bool(mujoco.mj_isSparse(model))
        self._inertia = _Inertia(model)
        self._memo: dict[tuple[Any, ...], Any] = {}
        self._of_choices: dict[tuple[str, int], Array] = {}

    # --- state and motion ------------------------------------------------------------------------

    def load(self, worlds: Mapping[int, World]) -> None:
        """Begin, or continue, some of the simulations from states; the others stay as they are."""
        ids = np.array(list(worlds), dtype=np.intp)
        self._batch.reset(ids, stage=_NOTHING)
        for number, world in worlds.items():
            self._batch.state[number] = world.physics
            self._variants[number] = world.variants
            if self._switches:
                self._simulation.choose(world.variants)
            for name, switch in self._switches.items():
                switch[number] = getattr(self._simulation.model, name)
        self._batch.forward(ids, stage=_READY)
        names = {name for world in self._variants for name in world}
        self.variants = {
            name: np.array([world.get(name) for world in self._variants]) for name in names
        }
        self._of_choices.clear()
        self._memo.clear()

    def physics(self, world: int) -> Array:
        """The state of one simulation, as `Simulation.get_state` gives it."""
        return self._batch.state[world].copy()

    def advance(self, worlds: Integers, commands: Array) -> None:
        """Advance some simulations by one control step, each as `Simulation.advance` does.

        Args:
            worlds: Their numbers (k,).
            commands: Flat commands (k, 16).

        Raises:
            SimulationError: The engine warned in some of them, which have to begin anew.
        """
        blocks = range(0, len(worlds), _BLOCK if self._is_sparse else len(worlds) or 1)
        for start in blocks:
            part = slice(start, start + (blocks.step))
            self._run(worlds[part], commands[part])
        self._memo.clear()
        warned = self._batch.warning[worlds, :, 1]
        if warned.any():
            wrong = worlds[warned.any(axis=1)].tolist()
            raise_on_warning(warned.sum(axis=0).tolist(), f"in environments {wrong}")
        self.look(worlds)

    def look(self, worlds: Integers) -> None:
        """Read the contacts of some simulations; `advance` does so for those that it moves."""
        self.contacts.gather(worlds, lambda world: self._batch.get_data(world, self._scratch))
        self.contacts.update(self._xipos)

    def _run(self, worlds: Integers, commands: Array) -> None:
        batch, actuators = self._batch, self._simulation.duo.actuators
        before = batch.state[worlds] if self._is_sparse else None
        controls = np.repeat(self._ctrl[worlds][:, None], SUBSTEPS, axis=1)
        controls[..., actuators] = ramp(self._ctrl[worlds, actuators], controls_of(commands))
        steps = batch.rollout(
            SUBSTEPS,
            control=controls,
            control_spec=_CONTROLS,
            record=_CHECKED if self._is_sparse else (),
            ids=worlds,
        )
        batch.forward(worlds, stage=_READY)
        if before is None:
            return
        unsolved = np.flatnonzero(~self._inertia.is_solved(*(steps[name] for name in _CHECKED)))
        for row in unsolved.tolist():
            world = int(worlds[row])
            self._simulation.choose(self._variants[world])
            self._simulation.set_state(before[row])
            self._simulation.advance(DuoCommand.from_flat(commands[row]))
            batch.state[world] = self._simulation.get_state()
        if len(unsolved):
            batch.forward(worlds[unsolved], stage=_READY)

    def world(self, number: int) -> Simulation:
        """One of the simulations, to look at until the next one is asked for."""
        self._simulation.choose(self._variants[number])
        self._batch.get_data(number, self._simulation.data)
        self._simulation.contacts.update()
        return self._simulation

    # --- what it is asked ------------------------------------------------------------------------

    def proprioception(self) -> Array:
        """Joint positions and openings (n, 16), as `Duo.read` gives them."""
        duo = self._simulation.duo
        flat = np.empty((self.count, len(SIDES), ARM_JOINTS + 1))
        flat[..., :ARM_JOINTS] = self._qpos[:, duo.joints]
        drivers = self._qpos[:, duo.drivers]
        closed = (drivers[:, ::2] + drivers[:, 1::2]) * (0.5 / DRIVER_CLOSED)
        flat[..., ARM_JOINTS] = np.minimum(np.maximum(1.0 - closed, 0.0), 1.0)
        return flat.reshape(self.count, -1)

    def commands(self) -> Array:
        """The last commands (n, 16), as the actuators hold them."""
        return commands_of(self._ctrl[:, self._simulation.duo.actuators])

    def tool_poses(self) -> Array:
        """Tool centre points (n, 2, 7), as `Duo.read` gives them."""
        positions, rotations = (array[:, self._simulation.duo.sites] for array in self._tools)
        turns = np.empty((*positions.shape[:2], 4))
        for turn, rotation in zip(turns.reshape(-1, 4), rotations.reshape(-1, 9), strict=True):
            mujoco.mju_mat2Quat(turn, rotation)
        turns = turns[..., [1, 2, 3, 0]]
        return np.concatenate([positions, np.where(turns[..., :1] < 0.0, -turns, turns)], axis=-1)

    def chosen(self, choice: str, rows: Mapping[str, Sequence[float]]) -> Array:
        """The numbers (k, n) that belong to what each layout chose."""
        key = choice, id(rows)
        if key not in self._of_choices:
            self._of_choices[key] = np.array([rows[value] for value in self.variants[choice]]).T
        return self._of_choices[key]

    def _numbers(self, array: Array, row: int | slice) -> Array:
        key = (id(array), row) if isinstance(row, int) else (id(array), row.start, row.stop)
        if key not in self._memo:
            self._memo[key] = np.ascontiguousarray(array[:, row].T)
        return self._memo[key]

    def _lowest(self, prop: str, x: Array, y: Array, z: Array) -> Array:
        if (prop,) not in self._memo:
            a, b, c = self._corners[prop][:, :, None]
            self._memo[prop,] = (a * x + b * y + c * z).min(axis=0)
        return self._memo[prop,]


class _Inertia:
    """Multiplies by the mass matrix of a model, whose sparse form is that of its lower half."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._rows = np.repeat(np.arange(model.nv), model.M_rownnz)
        self._columns = model.M_colind
        self._starts = model.M_rowadr
        off = np.flatnonzero(self._rows != self._columns)
        self._upper = off[np.argsort(self._columns[off], kind="stable")]
        self._of, first = np.unique(self._columns[self._upper], return_index=True)
        self._firsts = first

    def is_solved(self, qacc: Array, smooth: Array, constraint: Array, mass: Array) -> Any:
        """Whether forces (n, steps, nv) cause the accelerations in all steps (n,); see `advance`.

        Args:
            qacc: Accelerations (n, steps, nv).
            smooth: Forces.
            constraint: Forces of constraints.
            mass: Mass matrices (n, steps, entries).
        """
        missing = np.add.reduceat(mass * qacc[..., self._columns], self._starts, axis=-1)
        above = (mass * qacc[..., self._rows])[..., self._upper]
        missing[..., self._of] += np.add.reduceat(above, self._firsts, axis=-1)
        missing -= smooth
        missing -= constraint
        # Written so that what is not a number counts as unsolved.
        return np.abs(missing).max(axis=(1, 2)) <= SOLVED
