"""What MuJoCo leaves to us: steps that are really solved, and other physics in a compiled model."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import mujoco
import numpy as np

from duobench.types import Array

SOLVED = 0.1
"""Forces (N, N m) that may be missing in a step that counts as solved. Of 670,000 steps of cups in
shaking hands 21 missed more than 0.4, and all others less than 0.01."""


class Stepper:
    """Runs physics steps, and repeats with dense matrices what the engine did not solve.

    MuJoCo 4.0.0 factors the sparse matrices of large models wrongly in rare cases: its solver ends
    far from the solution, and a marble in a jerked cup leaves it at the speed of a bullet. Dense
    matrices are right, but take three times as long in `pour_marbles`, the only task with so large
    a model. MuJoCo 4.0.1 mends it [https://github.com/google-deepmind/mujoco/issues/3767].
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self._model, self._data = model, data
        self._sparse = bool(mujoco.mj_isSparse(model))
        self._given, self._needed = data.qfrc_smooth, data.qfrc_constraint
        self._acceleration, self._missing = data.qacc, np.empty(model.nv)

    def run(
        self,
        controls: Callable[[], Iterator[None]],
        save: Callable[[], Array],
        restore: Callable[[Array], None],
    ) -> None:
        """Run the physics steps of one control step.

        Args:
            controls: Puts the controls of one physics step after the other in place.
            save: Gives the state before the first one.
            restore: Goes back to that state.
        """
        if not self._sparse:
            self._run(controls(), checked=False)
            return
        before = save()
        if not self._run(controls(), checked=True):
            options = self._model.opt
            usual, options.jacobian = options.jacobian, mujoco.mjtJacobian.mjJAC_DENSE
            restore(before)
            self._run(controls(), checked=False)
            options.jacobian = usual
            mujoco.mj_step1(self._model, self._data)

    def _run(self, controls: Iterator[None], *, checked: bool) -> bool:
        """Each step is its second half (forces, integration) and the next one's first half."""
        model, data = self._model, self._data
        begin, finish = mujoco.mj_step1, mujoco.mj_step2
        for _ in controls:
            finish(model, data)
            if checked and not self._solved():
                return False
            begin(model, data)
        return True

    def _solved(self) -> bool:
        """Whether the accelerations of the last step are those that its forces cause."""
        missing = self._missing
        mujoco.mj_mulM(self._model, self._data, missing, self._acceleration)
        missing -= self._given
        missing -= self._needed
        # Written so that what is not a number counts as unsolved.
        return bool(np.abs(missing, out=missing).max() <= SOLVED)


_SCALED = ("body_mass", "body_inertia", "geom_friction", "jnt_stiffness", "dof_damping")
_DERIVED = (
    *("body_subtreemass", "body_invweight0", "dof_invweight0", "dof_M0", "actuator_acc0"),
    *("tendon_invweight0", "tendon_length0", "actuator_length0"),
    *("cam_pos0", "cam_poscom0", "cam_mat0", "light_pos0", "light_poscom0", "light_dir0"),
)
"""What the engine computes once, when it compiles a model, and anew where masses change."""
_STATISTICS = ("meaninertia", "meanmass", "meansize", "extent")


class PhysicsScaler:
    """Multiplies the physics of some bodies of a model; the numbers that were compiled are kept.

    Args:
        model: The model, which is written to by `apply`.
        roots: Ids of the root bodies of the objects.
    """

    def __init__(self, model: mujoco.MjModel, roots: Iterable[int]) -> None:
        self._model = model
        names = [name for name in (*_SCALED, *_DERIVED) if hasattr(model, name)]
        self._compiled = {name: getattr(model, name).copy() for name in names}
        self._statistics = {name: getattr(model.stat, name) for name in _STATISTICS}
        self._bodies = np.isin(model.body_rootid, list(roots))
        hinged = model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE
        self._joints = hinged & self._bodies[model.jnt_bodyid]
        self._dofs = self._joints[model.dof_jntid]
        self._is_scaled = False

    def apply(self, *, mass: float, friction: float, spring: float) -> None:
        """Scale what was compiled, not what is there; factors of 1 bring that back to the bit.

        Call it before a reset: no state is touched, and none is right for the new model.

        Args:
            mass: Factor on masses and inertias of the objects.
            friction: Factor on the sliding friction of all surfaces, the robot's included.
            spring: Factor on stiffness and damping of the hinges of objects.
        """
        if self._is_scaled:
            for name, values in self._compiled.items():
                getattr(self._model, name)[:] = values
            for name, value in self._statistics.items():
                setattr(self._model.stat, name, value)
        self._is_scaled = (mass, friction, spring) != (1.0, 1.0, 1.0)
        if not self._is_scaled:
            return
        model = self._model
        model.body_mass[self._bodies] *= mass
        model.body_inertia[self._bodies] *= mass
        model.geom_friction[:, 0] *= friction
        model.jnt_stiffness[self._joints] *= spring
        model.dof_damping[self._dofs] *= spring
        mujoco.mj_setConst(model, mujoco.MjData(model))
