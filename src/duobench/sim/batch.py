"""Many simulations of one model side by side, on MuJoCo's own threads; bit for bit as one alone."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import Batch

from duobench.scene.compose import SUBSTEPS
from duobench.scene.robotiq import DRIVER_CLOSED
from duobench.sim.contact_table import Booleans, ContactTable, Integers
from duobench.sim.duo import commands_of, controls_of, ramp
from duobench.sim.questions import Questions
from duobench.sim.simulation import SOLVED, Simulation, raise_on_warning
from duobench.types import ARM_JOINTS, SIDES, Array, DuoCommand

_READY = int(mujoco.mjtStage.mjSTAGE_VEL)
"""What `Simulation.forward` computes."""
_NOTHING = int(mujoco.mjtStage.mjSTAGE_NONE)
_CHECKED = ("M", "qacc", "qfrc_smooth", "qfrc_constraint")
_BLOCK = 128
"""Simulations that are checked at a time: what is recorded for that takes 20 MB."""


class SimulationBatch(Questions):
    """Simulations of one task, which answer questions with arrays.

    Args:
        simulation: One of the same model. What no array can do is done in it, one after the other.
        count: How many.
        threads: On how many threads of the processor they are stepped.
    """

    def __init__(self, simulation: Simulation, count: int, threads: int) -> None:
        model = simulation.model
        batch = self._batch = Batch(model, count, threads, persistent=True)
        super().__init__(simulation.props, model, batch)
        self.simulation, self.count = simulation, count
        self.contacts = ContactTable(model, count)
        self.centres, self._ctrl = batch.xipos, batch.ctrl
        self._tool_frames = batch.site_xpos, batch.site_xmat
        varies = any(prop.choice is not None for prop in self.props.values())
        switched = ("geom_contype", "geom_conaffinity") if varies else ()
        self._switches = {name: batch.expand(name) for name in switched}
        self._variants: list[Mapping[str, str]] = [{}] * count
        self.variants: dict[str, Any] = {}
        """For each choice of a layout, what every simulation's has chosen (n,)."""
        self._scratch, self._is_sparse = mujoco.MjData(model), bool(mujoco.mj_isSparse(model))
        # Entries of the mass matrix, of which the engine keeps the lower half, row by row.
        rows, columns = np.repeat(np.arange(model.nv), model.M_rownnz), model.M_colind
        upper = np.flatnonzero(rows != columns)
        rows, columns = np.r_[rows, columns[upper]], np.r_[columns, rows[upper]]
        order = np.argsort(rows, kind="stable")
        self._entries, self._columns = np.r_[: model.nC, upper][order], columns[order]
        self._rows = np.searchsorted(rows[order], np.arange(model.nv))
        self._memo: dict[tuple[Any, ...], Any] = {}
        self._chosen: dict[tuple[str, int], Array] = {}

    # --- state and motion ------------------------------------------------------------------------

    def load(
        self, worlds: Integers, variants: Sequence[Mapping[str, str]], physics: Sequence[Array]
    ) -> None:
        """Begin, or continue, some simulations with a layout's choices and a state each."""
        self._batch.reset(worlds, stage=_NOTHING)
        for number, chosen, state in zip(worlds.tolist(), variants, physics, strict=True):
            self._batch.state[number], self._variants[number] = state, chosen
            if self._switches:
                self.simulation.choose(chosen)
            for name, switch in self._switches.items():
                switch[number] = getattr(self.simulation.model, name)
        self._batch.forward(worlds, stage=_READY)
        names = self._variants[worlds[0]]
        self.variants = {
            name: np.array([chosen.get(name) for chosen in self._variants]) for name in names
        }
        self._chosen.clear()
        self.forget()

    def physics(self, world: int) -> Array:
        """The state of one simulation, as `Simulation.get_state` gives it."""
        return self._batch.state[world].copy()

    def advance(self, worlds: Integers, commands: Array) -> None:
        """Advance some simulations (k,) by a control step towards flat commands (k, 16).

        Each does what `Simulation.advance` does, and raises where that does.
        """
        size = _BLOCK if self._is_sparse else len(worlds)
        for block in (slice(start, start + size) for start in range(0, len(worlds), size)):
            self._run(worlds[block], commands[block])
        warned = self._batch.warning[worlds, :, 1]
        wrong = worlds[warned.any(axis=1)].tolist()
        raise_on_warning(warned.sum(axis=0).tolist(), f"in environments {wrong}")
        self.look_at(worlds)

    def _run(self, worlds: Integers, commands: Array) -> None:
        batch, actuators = self._batch, self.simulation.duo.actuators
        before = batch.state[worlds] if self._is_sparse else None
        controls = np.repeat(self._ctrl[worlds][:, None], SUBSTEPS, axis=1)
        controls[..., actuators] = ramp(self._ctrl[worlds, actuators], controls_of(commands))
        record = _CHECKED if self._is_sparse else ()
        kind = int(mujoco.mjtState.mjSTATE_CTRL)
        steps = batch.rollout(SUBSTEPS, controls, control_spec=kind, record=record, ids=worlds)
        batch.forward(worlds, stage=_READY)
        if before is None:
            return
        unsolved = np.flatnonzero(~self._is_solved(*(steps[name] for name in _CHECKED)))
        for row, world in zip(unsolved.tolist(), worlds[unsolved].tolist(), strict=True):
            self.simulation.choose(self._variants[world])
            self.simulation.set_state(before[row])
            self.simulation.advance(DuoCommand.from_flat(commands[row]))
            batch.state[world] = self.simulation.get_state()
        if len(unsolved):
            batch.forward(worlds[unsolved], stage=_READY)

    def _is_solved(self, mass: Array, qacc: Array, smooth: Array, constraint: Array) -> Booleans:
        """Whether the accelerations of all steps (n, steps, nv) are those that forces cause."""
        products = mass[..., self._entries] * qacc[..., self._columns]
        missing = np.add.reduceat(products, self._rows, axis=-1) - smooth - constraint
        # Written so that what is not a number counts as unsolved.
        return np.abs(missing).max(axis=(1, 2)) <= SOLVED

    def look_at(self, worlds: Integers) -> None:
        """Read what touches in some simulations, and in no other, and forget what was read."""
        self.copy_contacts(worlds)
        self.contacts.update(self.centres)
        self.forget()

    def forget(self) -> None:
        """Forget what was read of the state before."""
        self._memo.clear()

    def copy_contacts(self, worlds: Integers) -> None:
        """Copy the contacts of some simulations out of the engine, for `contacts.update`."""
        self.contacts.copy(worlds, lambda world: self._batch.get_data(world, self._scratch))

    def world(self, number: int) -> Simulation:
        """One of the simulations, to look at until the next one is asked for."""
        self.simulation.choose(self._variants[number])
        self._batch.get_data(number, self.simulation.data)
        self.simulation.contacts.update()
        return self.simulation

    # --- what it is asked ------------------------------------------------------------------------

    def ask(self, question: Callable[[Any], Any], *, vectorized: bool) -> Any:
        """What a function answers of all simulations at once, or of one after the other (k, n)."""
        if vectorized:  # of what is fixed, a number is the same in all
            return [np.broadcast_to(number, self.count) for number in question(self)]
        return np.array([question(self.world(number)) for number in range(self.count)]).T

    def commands(self) -> Array:
        """The last commands (n, 16), as the actuators hold them."""
        return commands_of(self._ctrl[:, self.simulation.duo.actuators])

    def proprioception(self) -> Array:
        """Joint positions and openings (n, 16), as `Duo.read` gives them."""
        duo = self.simulation.duo
        flat = np.empty((self.count, len(SIDES), ARM_JOINTS + 1))
        flat[..., :ARM_JOINTS] = self._qpos[:, duo.joints]
        drivers = self._qpos[:, duo.drivers]
        openings = 1.0 - (drivers[:, ::2] + drivers[:, 1::2]) * (0.5 / DRIVER_CLOSED)
        flat[..., ARM_JOINTS] = np.minimum(np.maximum(openings, 0.0), 1.0)
        return flat.reshape(self.count, -1)

    def tool_poses(self) -> Array:
        """Tool centre points (n, 14), as `Duo.read` gives them."""
        positions, rotations = (array[:, self.simulation.duo.sites] for array in self._tool_frames)
        turns = np.empty((*positions.shape[:2], 4))
        for turn, rotation in zip(turns.reshape(-1, 4), rotations.reshape(-1, 9), strict=True):
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
            self._chosen[key] = np.array([rows[value] for value in self.variants[choice]]).T
        return self._chosen[key]

    def _numbers(self, array: Array, row: int | slice) -> Array:
        key = id(array), str(row)
        if key not in self._memo:
            self._memo[key] = np.ascontiguousarray(array[:, row].T)
        return self._memo[key]

    def _lowest(self, prop: str, x: Array, y: Array, z: Array) -> Array:
        if (prop,) not in self._memo:
            a, b, c = self._corners[prop][:, :, None]
            self._memo[prop,] = (a * x + b * y + c * z).min(axis=0)
        return self._memo[prop,]
