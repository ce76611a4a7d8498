"""Physics steps whose forces are the solution of the engine's equations."""

from __future__ import annotations

from collections.abc import Callable, Iterator

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
        """Run steps of a model."""
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
