"""Other physics in a compiled model."""

from collections.abc import Iterable

import mujoco
import numpy as np

_CHANGED = (
    *("body_mass", "body_inertia", "geom_friction", "jnt_stiffness", "dof_damping"),
    *("body_subtreemass", "body_invweight0", "dof_invweight0", "dof_M0", "actuator_acc0"),
    *("tendon_invweight0", "tendon_length0", "actuator_length0"),
    *("cam_pos0", "cam_poscom0", "cam_mat0", "light_pos0", "light_poscom0", "light_dir0"),
)
"""What is scaled, and what the engine computes from it."""
_STATISTICS = ("meaninertia", "meanmass", "meansize", "extent")


class PhysicsScaler:
    """Multiplies the physics of objects, by the ids of their root bodies, in a compiled model."""

    def __init__(self, model: mujoco.MjModel, roots: Iterable[int]) -> None:
        self._model = model
        self._compiled = {name: getattr(model, name).copy() for name in _CHANGED}
        self._statistics = {name: getattr(model.stat, name) for name in _STATISTICS}
        self._bodies = np.isin(model.body_rootid, list(roots))
        hinged = model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE
        self._joints = hinged & self._bodies[model.jnt_bodyid]
        self._dofs = self._joints[model.dof_jntid]
        self._is_scaled = False

    def apply(self, *, mass: float = 1.0, friction: float = 1.0, spring: float = 1.0) -> None:
        """Scale what was compiled, not what is there; factors of 1 bring that back to the bit.

        Call it before a reset: no state is touched, and none is right for the new model. Factors
        are on masses and inertias of the objects, on the sliding friction of all surfaces, the
        robot's included, and on stiffness and damping of the hinges of objects.
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
