"""Many simulations on MuJoCo's own threads; each is bit for bit as one alone."""

from collections.abc import Sequence

import mujoco
import numpy as np
from mujoco.batch import Batch

from duobench.core.types import Array, DuoCommand
from duobench.world.scene.compose import SUBSTEPS
from duobench.world.sim.batch import SimulationBatch
from duobench.world.sim.contact_table import Booleans, Integers
from duobench.world.sim.duo import ramp
from duobench.world.sim.simulation import SOLVED, Simulation, raise_on_warning

_READY = int(mujoco.mjtStage.mjSTAGE_VEL)
"""Stage up to which `Simulation.forward` computes."""
_NOTHING = int(mujoco.mjtStage.mjSTAGE_NONE)
_CHECKED = ("M", "qacc", "qfrc_smooth", "qfrc_constraint")
_BLOCK = 128
"""Simulations that are checked at a time: what is recorded for that takes 20 MB."""


class ThreadBatch(SimulationBatch):
    """Simulations of one task, stepped on some threads of the processor."""

    def __init__(
        self,
        simulation: Simulation,
        count: int,
        threads: int,
    ) -> None:
        model = simulation.model
        batch = self._batch = Batch(
            model,
            count,
            threads,
            persistent=True,
        )
        super().__init__(simulation, count, batch)
        varies = any(prop.choice is not None for prop in self.props.values())
        switched = ("geom_contype", "geom_conaffinity") if varies else ()
        self._switches = {name: batch.expand(name) for name in switched}
        self._scratch, self._is_sparse = (
            mujoco.MjData(model),
            bool(mujoco.mj_isSparse(model)),
        )
        # Entries of the mass matrix, of which the engine keeps the lower half, row by row.
        rows, columns = np.repeat(np.arange(model.nv), model.M_rownnz), model.M_colind
        upper = np.flatnonzero(rows != columns)
        rows, columns = np.r_[rows, columns[upper]], np.r_[columns, rows[upper]]
        order = np.argsort(rows, kind="stable")
        self._entries, self._columns = np.r_[: model.nC, upper][order], columns[order]
        self._rows = np.searchsorted(rows[order], np.arange(model.nv))

    def _load(self, worlds: Integers, physics: Sequence[Array]) -> None:
        self._batch.reset(worlds, stage=_NOTHING)
        for number, state in zip(worlds.tolist(), physics, strict=True):
            self._batch.state[number] = state
            if self._switches:
                self.simulation.choose(self._variants[number])
            for name, switch in self._switches.items():
                switch[number] = getattr(self.simulation.model, name)
        self._batch.forward(worlds, stage=_READY)

    def physics(self, world: int) -> Array:
        """See `SimulationBatch`."""
        return self._batch.state[world].copy()

    def advance(self, worlds: Integers, commands: Array) -> None:
        """See `SimulationBatch`; each does what `Simulation.advance` does."""
        size = _BLOCK if self._is_sparse else len(worlds)
        for block in (
            slice(start, start + size) for start in range(0, len(worlds), size)
        ):
            self._run(worlds[block], commands[block])
        warned = self._batch.warning[worlds, :, 1]
        wrong = worlds[warned.any(axis=1)].tolist()
        raise_on_warning(warned.sum(axis=0).tolist(), f"in environments {wrong}")
        self.look_at(worlds)

    def _run(self, worlds: Integers, commands: Array) -> None:
        batch, actuators = self._batch, self.simulation.duo.actuators
        before = batch.state[worlds] if self._is_sparse else None
        controls = np.repeat(self._ctrl[worlds][:, None], SUBSTEPS, axis=1)
        controls[..., actuators] = ramp(
            self._ctrl[worlds, actuators], self.simulation.duo.controls_of(commands)
        )
        if before is None:
            # The first step goes on from the half that `forward` has computed already.
            self._ctrl[worlds] = controls[:, 0]
            batch.step(worlds)
            controls = controls[:, 1:]
        steps = batch.rollout(
            controls.shape[1],
            controls,
            record=() if before is None else _CHECKED,
            ids=worlds,
        )
        batch.forward(worlds, stage=_READY)
        if before is None:
            return
        unsolved = np.flatnonzero(~self._is_solved(*(steps[name] for name in _CHECKED)))
        for row, world in zip(
            unsolved.tolist(), worlds[unsolved].tolist(), strict=True
        ):
            self.simulation.choose(self._variants[world])
            self.simulation.set_state(before[row])
            self.simulation.advance(DuoCommand.from_flat(commands[row]))
            batch.state[world] = self.simulation.get_state()
        if len(unsolved):
            batch.forward(worlds[unsolved], stage=_READY)

    def _is_solved(
        self, mass: Array, qacc: Array, smooth: Array, constraint: Array
    ) -> Booleans:
        """Whether the accelerations of all steps (n, steps, nv) are those that forces cause."""
        products = mass[..., self._entries] * qacc[..., self._columns]
        missing = np.add.reduceat(products, self._rows, axis=-1) - smooth - constraint
        # Written so that what is not a number counts as unsolved.
        return np.abs(missing).max(axis=(1, 2)) <= SOLVED

    def copy_contacts(self, worlds: Integers) -> None:
        """See `SimulationBatch`."""
        self.contacts.copy(
            worlds, lambda world: self._batch.get_data(world, self._scratch)
        )

    def world(self, number: int) -> Simulation:
        """See `SimulationBatch`."""
        self.simulation.choose(self._variants[number])
        self._batch.get_data(number, self.simulation.data)
        self.simulation.contacts.update()
        return self.simulation
