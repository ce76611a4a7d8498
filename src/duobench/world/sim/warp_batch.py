"""Many simulations on a graphics card, stepped by MuJoCo Warp.

Warp is another engine with the same models: its numbers have 32 bits, their sums another order each
time, and some contacts are found otherwise, so that no two runs are the same. What is played on it
is no score.
"""

from collections.abc import Mapping, Sequence
from copy import copy
from importlib import import_module
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from duobench.core.errors import OptionError, SimulationError
from duobench.core.machine import load_extra
from duobench.core.types import Array
from duobench.world.scene.compose import SUBSTEPS
from duobench.world.sim.batch import SimulationBatch
from duobench.world.sim.contact_table import Integers
from duobench.world.sim.duo import ramp
from duobench.world.sim.simulation import STATE, Simulation

CONTACTS, CONVEX, CONSTRAINTS = 192, 64, 512
"""Room for contacts and for those of them with a mesh or cylinder, which take 2 kB each, on average
of all simulations; and for constraints, in each. Experts need up to 99, fewer, and 304."""
BEYOND = 1e10
"""A position or speed that MuJoCo calls invalid, its mjMAXVAL."""
_KEPT = ("time", "qpos", "qvel", "ctrl", "qacc_warmstart", "mocap_pos", "mocap_quat")
"""Fields that are kept of a state; the rest is the same in all states of a model."""
_SEEN = ("xpos", "xmat", "xipos", "xanchor", "xaxis", "site_xpos", "site_xmat")
_CONTACT = ("worldid", "geom", "dist", "frame", "pos")
_MATRICES = ("xmat", "site_xmat", "frame")
_GRAIN = 1e-4
"""Half the side in metres of a shape that a variant leaves out, inside one that is there."""
_BOX, _DISABLED = int(mujoco.mjtGeom.mjGEOM_BOX), mujoco.mjtDisableBit


class WarpBatch(SimulationBatch):
    """Simulations of one task on the graphics card, or on the processor without a card.

    Raises:
        OptionError: MuJoCo Warp is not installed, or cannot step so many of this model.
    """

    def __init__(self, simulation: Simulation, count: int) -> None:
        self._engine = load_extra(
            "mujoco_warp", "warp", "MuJoCo Warp is missing", OptionError
        )
        self._warp = import_module("warp")
        model = copy(simulation.model)
        model.geom_contype[:], model.geom_conaffinity[:] = simulation.touches
        # Warp resets nothing by itself. Its general collider gives one contact where an edge lies
        # on a face, which lets go of what MuJoCo holds; the one for boxes gives two, as MuJoCo's.
        off = model.opt.disableflags & ~int(_DISABLED.mjDSBL_AUTORESET)
        model.opt.disableflags = off | int(_DISABLED.mjDSBL_NATIVECCD)
        model.opt.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE
        empty = mujoco.MjData(model)
        room = {"nconmax": CONTACTS, "nccdmax": CONVEX, "njmax": CONSTRAINTS}
        try:
            self._model = self._engine.put_model(model)
            self._data = self._engine.put_data(
                model,
                empty,
                nworld=count,
                **room,
            )
        except (RuntimeError, ValueError) as error:
            raise OptionError(
                f"MuJoCo Warp cannot step {count} simulations of this model: {error}"
            ) from error
        self._is_on_card = bool(self._warp.get_device().is_cuda)
        self._copies = {name: self._beside(name) for name in (*_KEPT, *_SEEN)}
        self.arrays = {
            name: _flat(name, array.numpy()) for name, array in self._copies.items()
        }
        """Arrays that were copied from the engine last."""
        super().__init__(simulation, count, _NamedArrays(self.arrays))
        self._scratch, self._graph = mujoco.MjData(model), None
        shape = SUBSTEPS, count, model.nu
        self._ramp = self._warp.zeros(shape, dtype=float)
        self._ramp_copy = self._warp.zeros(
            shape, dtype=float, device="cpu", pinned=self._is_on_card
        )
        self._left_out = _LeftOut(simulation, count, self._model, self._warp)

    def _beside(self, name: str) -> Any:
        """Room in the processor's memory for one of the engine's arrays."""
        return self._warp.empty_like(
            getattr(self._data, name), device="cpu", pinned=self._is_on_card
        )

    # --- state and motion ------------------------------------------------------------------------

    def _load(self, worlds: Integers, physics: Sequence[Array]) -> None:
        for number, state in zip(worlds.tolist(), physics, strict=True):
            mujoco.mj_setState(self.simulation.model, self._scratch, state, STATE)
            for name in _KEPT:
                self.arrays[name][number] = getattr(self._scratch, name)
        for name in _KEPT:
            self._warp.copy(getattr(self._data, name), self._copies[name])
        self._left_out.choose(worlds, self._variants)
        self._data.overflow.zero_()
        self._place()
        self._copy(_SEEN)

    def physics(self, world: int) -> Array:
        """See `SimulationBatch`."""
        for name in _KEPT:
            setattr(self._scratch, name, self.arrays[name][world])
        state = np.empty(mujoco.mj_stateSize(self.simulation.model, STATE))
        mujoco.mj_getState(self.simulation.model, self._scratch, state, STATE)
        return state

    def advance(self, worlds: Integers, commands: Array) -> None:
        """See `SimulationBatch`."""
        # Those that are not asked for hold still meanwhile, and are loaded before they go on.
        goals, duo = self._ctrl.copy(), self.simulation.duo
        goals[worlds, duo.actuators] = duo.controls_of(commands)
        self._ramp_copy.numpy()[:] = ramp(self._ctrl, goals).swapaxes(0, 1)
        self._warp.copy(self._ramp, self._ramp_copy)
        self._run()
        self._copy((*_KEPT, *_SEEN))
        full = self._data.overflow.numpy() != 0
        numbers = np.hstack([self.arrays["qpos"], self.arrays["qvel"]])
        # Written so that what is not a number counts as beyond.
        wrong = np.flatnonzero(full | ~(np.abs(numbers) < BEYOND).all(axis=1))
        wrong = wrong[np.isin(wrong, worlds)].tolist()
        if wrong:
            why = (
                "contacts had no room"
                if full[wrong].any()
                else "numbers are no longer valid"
            )
            raise SimulationError(
                f"MuJoCo Warp failed in environments {wrong}: {why}. Reset all environments."
            )
        self.look_at(worlds)

    def _run(self) -> None:
        """A control step: on a graphics card a CUDA graph, captured after the first one."""
        if self._graph:
            self._warp.capture_launch(self._graph)
            return
        self._steps()
        if self._is_on_card:
            with self._warp.ScopedCapture() as capture:
                self._steps()
            self._graph = capture.graph

    def _steps(self) -> None:
        for number in range(SUBSTEPS):
            self._warp.copy(self._data.ctrl, self._ramp[number])
            self._engine.step(self._model, self._data)
        self._place()

    def _place(self) -> None:
        """Find poses and contacts of the state."""
        self._engine.kinematics(self._model, self._data)
        self._engine.collision(self._model, self._data)

    def _copy(self, names: Sequence[str]) -> None:
        for name in names:
            self._warp.copy(self._copies[name], getattr(self._data, name))
        self._warp.synchronize()

    def copy_contacts(self, worlds: Integers) -> None:
        """See `SimulationBatch`."""
        found, contact = int(self._data.nacon.numpy()[0]), self._data.contact
        # An empty slice cannot be copied.
        shown = {
            name: getattr(contact, name)[: max(found, 1)].numpy() for name in _CONTACT
        }
        asked = np.zeros(self.count, dtype=bool)
        asked[worlds] = True
        kept = np.flatnonzero(asked[shown["worldid"][:found]])
        self.contacts.take(*(_flat(name, array[kept]) for name, array in shown.items()))

    def world(self, number: int) -> Simulation:
        """See `SimulationBatch`; its contacts are MuJoCo's."""
        self.simulation.choose(self._variants[number])
        self.simulation.set_state(self.physics(number))
        return self.simulation


class _NamedArrays:
    """Arrays under their names."""

    def __init__(self, arrays: dict[str, NDArray[Any]]) -> None:
        vars(self).update(arrays)


def _flat(name: str, array: NDArray[Any]) -> NDArray[Any]:
    """Matrices (..., 3, 3) as rows of nine numbers, as MuJoCo keeps them; a view."""
    return array.reshape(*array.shape[:-2], 9) if name in _MATRICES else array


class _LeftOut:
    """Leaves out what the variants of layouts leave out.

    In Warp all simulations share what may touch what. So a shape that is left out becomes a grain
    in the middle of the largest one of the same body, which nothing can reach.
    """

    def __init__(
        self, simulation: Simulation, count: int, engine: Any, warp: Any
    ) -> None:
        self._simulation, model = simulation, simulation.model
        self._geoms, inside = [], []
        for prop in simulation.props.values():
            numbers = set().union(
                *(each.without_shapes for each in prop.variants.values())
            )
            of_prop = [
                model.geom(f"{prop.name}:{number}").id for number in sorted(numbers)
            ]
            body = model.body(prop.name)
            always = set(range(body.geomadr[0], body.geomadr[0] + body.geomnum[0])) - {
                *of_prop
            }
            solid = simulation.touches[0]
            always = [
                geom for geom in always if model.geom_type[geom] == _BOX and solid[geom]
            ]
            if any(model.geom_type[geom] != _BOX for geom in of_prop) or (
                of_prop and not always
            ):
                raise OptionError(
                    f"MuJoCo Warp can leave out boxes in boxes only: {prop.name}."
                )
            self._geoms += of_prop
            largest = max(
                always, key=lambda geom: model.geom_size[geom].prod(), default=-1
            )
            inside += [largest] * len(of_prop)
        self._there = model.geom_pos[self._geoms], model.geom_size[self._geoms]
        self._gone = model.geom_pos[inside], np.full((len(inside), 3), _GRAIN)
        self._arrays: list[tuple[Any, NDArray[Any]]] = []
        for name in ("geom_pos", "geom_size") if self._geoms else ():
            array = warp.array(
                np.tile(getattr(model, name), (count, 1, 1)), dtype=warp.vec3
            )
            setattr(engine, name, array)
            self._arrays.append((array, array.numpy()))

    def choose(self, worlds: Integers, variants: Sequence[Mapping[str, str]]) -> None:
        """Give some simulations the shapes of their variants."""
        for number in worlds.tolist() if self._geoms else ():
            self._simulation.choose(variants[number])
            there = self._simulation.model.geom_contype[self._geoms, None] != 0
            for (_, rows), *both in zip(
                self._arrays, self._there, self._gone, strict=True
            ):
                rows[number, self._geoms] = np.where(there, *both)
        for array, rows in self._arrays:
            array.assign(rows)
