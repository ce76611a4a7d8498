"""The world of a rehearsal: one simulation of both arms, the table and a task's objects.

It stands behind the drivers of `drivers.rehearsal`, so that everything above them runs unchanged.
The arms are led by joint impedance with the gains of the rig, feel what they touch, and stop with a
reflex at the rig's thresholds. Time is that of the rig's clock; of one that leaps the world leaves
out what is too much.
"""

import math
import threading
from collections.abc import Callable, Iterator
from typing import Any

import mujoco
import numpy as np

from duobench.core.errors import BackendError, SimulationError, escaped
from duobench.core.spatial import SE3
from duobench.core.types import (
    ARM_JOINTS,
    CONTROL_HZ,
    SIDES,
    Array,
    Side,
)
from duobench.real.catalog import load_driver
from duobench.real.clock import Clock, Ticker
from duobench.real.rig import ArmConfig
from duobench.results.labels import Fault, FaultKind
from duobench.tasks.task import Task
from duobench.world.robot.frames import Robot
from duobench.world.scene.compose import SUBSTEPS
from duobench.world.scene.naming import (
    arm_joint_names,
    drive_names,
    gripper_name,
    tcp_name,
)
from duobench.world.sim.layout import Layout
from duobench.world.sim.placement import MAX_OVERLAP
from duobench.world.sim.simulation import Simulation

STEP_S = 1.0 / (CONTROL_HZ * SUBSTEPS)
"""Seconds of a physics step: that of the simulation, a twentieth of a core on a usual computer."""
MAX_BEHIND_S = 0.05
"""Seconds that physics catches up with at once; of a longer delay the rest is left out."""
FILTER_S = 0.02
"""Time constant of what an arm feels, in seconds: a bump of one physics step is no contact."""
FEEL_EVERY = 4
"""Physics steps from one look at what the arms feel to the next: 120 a second."""
HAND_EVERY = 8
"""Physics steps from one look at the fingers to the next: 60 a second, twice as often as asked."""
HAND_M = 0.002
"""Standard deviation of where a person puts an object, in metres along x and y (estimated)."""
HAND_RAD = math.radians(1.5)
"""Standard deviation of how it is turned, in radians (estimated)."""
PLACING_S = 0.5
"""Seconds that objects have to come to rest, and cameras to see them."""
STILL = 0.06
"""Speed of the fingers, in their whole ways a second, under which they rest."""
_TRIES = 20
_DAMPED = 1e-6 * np.eye(6)
_CONTACT = mujoco.mjtConstraint.mjCNSTR_CONTACT_FRICTIONLESS.value
"""First kind of constraint that is a contact."""
RELEASE = "The emergency stop is pressed. Release it, then recover the arms."


def gripper_driver(robot: Robot) -> Any:
    """Driver of a robot's grippers, which has an imitation of one for rehearsals."""
    return load_driver("grippers", robot.gripper.driver)


class MountedArm:
    """One arm of the world, as it stands on its mount; numbers are (7,) in radians and N·m."""

    def __init__(self) -> None:
        self.config = ArmConfig()
        """Gains and thresholds that it has been given."""
        self.lead = np.zeros(ARM_JOINTS)
        """Damping over stiffness, in seconds: damping acts on the speed that is missing."""
        self.target = np.zeros(ARM_JOINTS)
        self.speed = np.zeros(ARM_JOINTS)
        self.joints = np.zeros(ARM_JOINTS)
        self.velocities = np.zeros(ARM_JOINTS)
        self.torques = np.zeros(ARM_JOINTS)
        self.external = np.zeros(ARM_JOINTS)
        """Torques of what it touches, filtered."""
        self.wrench = np.zeros(6)
        """Force in N and moment in N·m at its tool, in the table frame."""
        self.is_tracking = False
        self.fault: Fault | None = None

    def stop(self, fault: Fault | None = None) -> None:
        """Stay where it is, and follow no more commands; the first fault is kept."""
        self.target, self.speed = self.joints.copy(), np.zeros(ARM_JOINTS)
        self.is_tracking, self.fault = False, self.fault or fault

    def reflex(self) -> str | None:
        """Return the name of the reflex that stops the arm, as its library has it, or None."""
        if (np.abs(self.external) > self.config.torque_threshold).any():
            return "joint_reflex"
        if (np.abs(self.wrench) > self.config.tool_thresholds).any():
            return "cartesian_reflex"
        return None


class RehearsalWorld:
    """Both arms, grippers and the objects on the table, on a rig's clock.

    Its methods may be called from any thread. Objects lie on the table once `place` has put them.
    """

    def __init__(self, clock: Clock, robot: Robot) -> None:
        self.clock = clock
        self.robot = robot
        """Description of the arms."""
        self.lock = threading.RLock()
        """Lock for reading `simulation` while the world runs."""
        self.arms = {side: MountedArm() for side in SIDES}
        imitation = gripper_driver(robot).imitation
        self.grippers: dict[Side, Any] = {side: imitation() for side in SIDES}
        """Imitated grippers by mount; a test cuts their power here."""
        self.is_stopped = False
        """Whether a person has pressed the emergency stop of both arms."""
        self.look_again: Callable[[], None] = lambda: None
        """Has cameras see the objects before `place` returns."""
        self._random = np.random.default_rng(0)  # of the hands that place objects
        self._users: set[int] = set()
        self._ticker: Ticker | None = None
        self._time, self._steps = 0.0, 0
        self._has_failed = False
        self._sides = [arm_joint_names(side) for side in SIDES]
        self._install(Simulation(robot=robot))
        model = self.simulation.model
        self._own = (
            model.nq,
            model.nv,
            model.nu,
        )  # of the robot, which is compiled first
        for side in SIDES:
            self._measure(side)
            self.arms[side].stop()

    # --- while it runs ---------------------------------------------------------------------------

    def enter(self, device: object) -> None:
        """A device is connected: time passes from now on. Twice is harmless."""
        self._users.add(id(device))
        if self._ticker is None:
            self._time = self.clock.now()
            self._ticker = self.clock.every(STEP_S, self._tick, "rehearsal")

    def leave(self, device: object) -> None:
        """A device is let go of; after the last one the world stands still."""
        self._users.discard(id(device))
        if not self._users and self._ticker is not None:
            self._ticker.stop()
            self._ticker = None

    def press_stop(self) -> None:
        """A person presses the emergency stop: both arms stop."""
        with self.lock:
            self.is_stopped = True
            for arm in self.arms.values():
                arm.stop(FaultKind.PERSON.fault("User Stop pressed!"))

    def release_stop(self) -> None:
        """The emergency stop is released; the arms still have to be recovered."""
        self.is_stopped = False

    def scene(self) -> tuple[mujoco.MjModel, tuple[Array, ...]]:
        """The model, and what moves or changes in it: joints, fixed objects, and colours."""
        with self.lock:
            model, data = self.simulation.model, self.simulation.data
            moved = data.qpos, data.mocap_pos, data.mocap_quat, model.geom_rgba
            return model, tuple(np.array(each, dtype=np.float64) for each in moved)

    # --- placing ---------------------------------------------------------------------------------

    def place(self, task: Task, layout: Layout) -> None:
        """Put a task's objects where a layout says, with the errors of a hand.

        Errors become smaller where objects would be in each other's way.

        Raises:
            BackendError: A gripper holds something, or an arm is in the way.
        """
        for side, gripper in self.grippers.items():
            if gripper.has_object:
                raise BackendError(
                    f"The {side} gripper holds something: open it, then place the objects."
                )
        with self.lock:
            before = self.simulation
            state, variants = before.get_state(), before.variants
            if set(before.props) != {prop.name for prop in task.props}:
                self._install(Simulation(task.props, robot=self.robot))
            objection: str | None = None
            for by_hand in self._attempts(layout):
                self._put(by_hand, before.data)
                objection = self._objection()
                if objection is None:
                    break
            else:
                self._install(before)
                before.variants = variants
                before.set_state(state)
                raise BackendError(objection or "The objects cannot be placed.")
        self.clock.wait_until(self.clock.now() + PLACING_S)
        self.look_again()

    def _attempts(self, layout: Layout) -> Iterator[Layout]:
        """Layouts by hand, ever nearer to the one that is wanted, which is the last one."""
        for number in range(_TRIES):
            share = 1.0 - number / (_TRIES - 1)
            poses: dict[str, SE3] = {}
            for name, pose in layout.poses.items():
                x, y, turn = share * self._random.normal(
                    0.0, (HAND_M, HAND_M, HAND_RAD)
                )
                there = SE3.at(*(pose.translation + np.array([x, y, 0.0])), yaw=turn)
                poses[name] = there @ SE3(pose.rotation, np.zeros(3))
            yield Layout(poses=poses, variants=layout.variants)

    def _put(self, layout: Layout, robot: mujoco.MjData) -> None:
        """Put objects where a layout says, as new, beside a robot that stays as it is."""
        simulation, (nq, nv, nu) = self.simulation, self._own
        qpos = robot.qpos[:nq].copy()
        qvel = robot.qvel[:nv].copy()
        ctrl = robot.ctrl[:nu].copy()
        simulation.reset_data()
        data = simulation.data
        if (
            np.isfinite(qpos).all() and np.isfinite(qvel).all()
        ):  # or physics had failed: home
            data.qpos[:nq] = qpos
            data.qvel[:nv] = qvel
            data.ctrl[:nu] = ctrl
        simulation.apply(layout)
        self._has_failed = False

    def _objection(self) -> str | None:
        """Return why the objects cannot lie where they are, or None."""
        simulation = self.simulation
        for name in simulation.props:
            touching = simulation.contacts.partners(name)
            for side in SIDES:
                if any(owner.startswith(f"{side}/") for owner in touching):
                    return (
                        f"The {side} arm is where the {name.replace('_', ' ')} belongs: send the "
                        "arms home, then place the objects."
                    )
        for one, other, depth in simulation.contacts.deepest(MAX_OVERLAP):
            if one in simulation.props or other in simulation.props:
                return f"{one} and {other} overlap by {1000.0 * depth:.1f} mm."
        return None

    # --- physics ---------------------------------------------------------------------------------

    def _install(self, simulation: Simulation) -> None:
        """Make the world a simulation, whose arms get the gains of the rig."""
        self.simulation = simulation
        model, data = simulation.model, simulation.data
        # Sparse matrices are factored wrongly in rare cases; see `Simulation.advance`.
        model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        self._places = simulation.duo.joints
        joints = [[model.joint(name) for name in names] for names in self._sides]
        self._dofs = np.array(
            [[int(joint.dofadr[0]) for joint in row] for row in joints]
        )
        self._motors = np.array(
            [[model.actuator(name).id for name in row] for row in self._sides]
        )
        self._hands = [model.actuator(gripper_name(side)).id for side in SIDES]
        gripper = self.robot.gripper
        drives = [
            [model.joint(name) for name in drive_names(s, gripper)] for s in SIDES
        ]
        self._drives = [[int(joint.qposadr[0]) for joint in row] for row in drives]
        self._drive_dofs = [[int(joint.dofadr[0]) for joint in row] for row in drives]
        self._tools = [model.site(tcp_name(side)).id for side in SIDES]
        self._felt = np.zeros(model.nv)
        self._jacobian = np.zeros((6, model.nv))
        self._data, self._model = data, model
        for side in SIDES:
            self.set_gains(side, self.arms[side].config)

    def set_gains(self, side: Side, config: ArmConfig) -> None:
        """Lead an arm with the stiffness and damping of the rig, and let it stop by its limits."""
        with self.lock:
            self.arms[side].config = config
            self.arms[side].lead = np.divide(config.damping, config.stiffness)
            motors, model = self._motors[side.index], self._model
            model.actuator_gainprm[motors, 0] = config.stiffness
            model.actuator_biasprm[motors, 1] = -np.array(config.stiffness)
            model.actuator_biasprm[motors, 2] = -np.array(config.damping)

    def _tick(self) -> None:
        with self.lock:
            try:
                if not self._has_failed:
                    self._catch_up()
            except Exception as error:  # noqa: BLE001 - a fault tells of it
                self._has_failed = True
                text = f"The physics of the rehearsal failed: {escaped(str(error))}"
                for arm in self.arms.values():
                    arm.stop(FaultKind.CONTROLLER.fault(text))

    def _catch_up(self) -> None:
        now = self.clock.now()
        self._time = max(self._time, now - MAX_BEHIND_S)
        while self._time + 0.999 * STEP_S <= now:
            self._step()
        for side in SIDES:
            self._measure(side)

    def _step(self) -> None:
        """One physics step: forces and integration, then where everything is."""
        model, data = self._model, self._data
        for side, arm in self.arms.items():
            data.ctrl[self._motors[side.index]] = arm.target + arm.lead * arm.speed
        mujoco.mj_step2(model, data)
        if self._steps % FEEL_EVERY == 0:
            self._feel()
        mujoco.mj_step1(model, data)
        if data.warning.number.any():
            raise SimulationError("it became unstable. Place the objects again.")
        self._steps += 1
        self._time += STEP_S
        if self._steps % HAND_EVERY == 0:
            for side in SIDES:
                self._move_hand(side)

    def _feel(self) -> None:
        """Update what the arms feel of the contacts of this step; too much is a reflex."""
        data, felt = self._data, self._felt
        felt[:] = 0.0
        if data.nefc:
            forces = np.where(data.efc_type >= _CONTACT, data.efc_force, 0.0)
            mujoco.mj_mulJacTVec(self._model, data, felt, forces)
        for side, arm in self.arms.items():
            dofs, jacobian = self._dofs[side.index], self._jacobian
            change = felt[dofs] - arm.external
            arm.external = arm.external + FEEL_EVERY * STEP_S / FILTER_S * change
            tool = self._tools[side.index]
            mujoco.mj_jacSite(self._model, data, jacobian[:3], jacobian[3:], tool)
            own = jacobian[:, dofs]
            wrench = np.linalg.solve(own @ own.T + _DAMPED, own @ arm.external)
            arm.wrench = wrench.astype(np.float64)
            if arm.is_tracking and (name := arm.reflex()) is not None:
                self._measure(side)
                arm.stop(
                    FaultKind.CONTACT.fault(f'motion aborted by reflex! ["{name}"]')
                )

    def _measure(self, side: Side) -> None:
        arm = self.arms[side]
        data = self._data
        dofs = self._dofs[side.index]
        arm.joints = data.qpos[self._places[side.index]]
        arm.velocities = data.qvel[dofs]
        arm.torques = data.qfrc_actuator[dofs] + data.qfrc_gravcomp[dofs]

    def _move_hand(self, side: Side) -> None:
        """Lead the fingers of a gripper to where it says, and tell them how far it is."""
        gripper = self.grippers[side]
        data = self._data
        index = side.index
        low, high = gripper.ends
        angles = data.qpos[self._drives[index]].tolist()
        kind = self.robot.gripper
        share = sum(angles) / (len(angles) * kind.drive_closed)
        gripper.move(low + min(max(share, 0.0), 1.0) * (high - low), self._time)
        hand = self._hands[index]
        target = gripper.target
        if target is not None:
            data.ctrl[hand] = kind.ctrl_closed * (target - low) / (high - low)
        elif (
            np.abs(data.qvel[self._drive_dofs[index]]).max() > STILL * kind.drive_closed
        ):
            data.ctrl[hand] = (
                kind.ctrl_closed * share
            )  # stop; a grip that rests is kept
