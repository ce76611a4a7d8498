"""One compiled model and its state: stepping, saving, restoring, placing, and asking."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NoReturn

import mujoco
import numpy as np

from duobench.core.errors import DuoBenchError, LayoutError, SimulationError
from duobench.core.spatial import SE3
from duobench.core.types import Array, DuoCommand, DuoState
from duobench.world.objects.prop import Prop
from duobench.world.robot.cameras import OVERVIEW_VIEW, View
from duobench.world.robot.frames import ROBOT, Robot
from duobench.world.scene.compose import compose
from duobench.world.sim.contacts import Contacts
from duobench.world.sim.duo import Duo, resolve
from duobench.world.sim.layout import Layout
from duobench.world.sim.questions import CLEARLY, Questions

_CHANGED = (
    "body_mass",
    "body_inertia",
    "geom_friction",
    "jnt_stiffness",
    "dof_damping",
    "body_subtreemass",
    "body_invweight0",
    "dof_invweight0",
    "dof_M0",
    "actuator_acc0",
    "tendon_invweight0",
    "tendon_length0",
    "actuator_length0",
    "cam_pos0",
    "cam_poscom0",
    "cam_mat0",
    "light_pos0",
    "light_poscom0",
    "light_dir0",
)
"""Quantities that are scaled, and those that the engine computes from them."""
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

    def apply(
        self, *, mass: float = 1.0, friction: float = 1.0, spring: float = 1.0
    ) -> None:
        """Scale what was compiled, not what is there; factors of 1 bring that back to the bit.

        Call it before a reset: no state is touched, and none is right for the new model. Factors
        are on masses and inertias of the objects, on the sliding friction of all surfaces, the
        robot's included, and on the stiffness of the hinges of objects, with the mass of what such
        a spring moves. Damping of a hinge has the factor of the mass on it.
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
        # What shuts a lid, its spring or its weight, and what slows it down have one factor: lids
        # stay open by themselves for as long as they usually do.
        factors = np.full(model.nbody, float(mass))
        factors[model.jnt_bodyid[self._joints & (model.jnt_stiffness > 0.0)]] = spring
        model.body_mass[self._bodies] *= factors[self._bodies]
        model.body_inertia[self._bodies] *= factors[self._bodies, None]
        model.geom_friction[:, 0] *= friction
        model.jnt_stiffness[self._joints] *= spring
        model.dof_damping[self._dofs] *= factors[model.dof_bodyid[self._dofs]]
        mujoco.mj_setConst(model, mujoco.MjData(model))


STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)
"""Everything that the next physics step depends on, warm start and controls included."""

SETTLE_SPEED = 0.005
SETTLE_ANGULAR_SPEED = 0.1
"""Every object at rest is slower than this, in m/s and rad/s, as when a reset ends in time."""
MAX_SETTLE_STEPS = 45
"""A reset waits at most this many control steps for objects to come to rest."""


FEW_CORNERS = 24
"""Up to so many points a loop over floats finds the lowest one faster than arrays do."""
Places = list[int] | slice
SOLVED = 0.1
"""Forces (N, N m) that may be missing in a step that counts as solved. Of 670,000 steps of cups in
shaking hands 21 missed more than 0.4, and all others less than 0.01."""


def raise_on_warning(counts: Iterable[int], where: str) -> None:
    """Raise where the engine warned.

    Args:
        counts: How often it did, for each kind of warning.
        where: When or where that was, for people.
    """
    names = [
        f"{mujoco.mjtWarning(kind).name.removeprefix('mjWARN_').lower()} x{count}"
        for kind, count in enumerate(counts)
        if count
    ]
    if names:
        raise SimulationError(
            f"The physics engine warned {where}: {', '.join(names)}. The episode is not valid; "
            "reset the environment."
        )


def _columns(starts: list[int]) -> list[Places]:
    """Three places from each start on, by column: slices, which are read faster, if they can be."""
    step = starts[1] - starts[0] if len(starts) > 1 else 1
    span = range(starts[0], starts[0] + step * len(starts), step)
    is_even = starts == list(span)
    return [
        slice(span.start + axis, span.stop + axis, step)
        if is_even
        else [start + axis for start in starts]
        for axis in range(3)
    ]


class Simulation(Questions):
    """The FR3 Duo and a task's props, stepping at the control rate."""

    def __init__(
        self,
        props: Iterable[Prop] = (),
        overview: View = OVERVIEW_VIEW,
        robot: Robot = ROBOT,
    ) -> None:
        props = tuple(props)
        self.robot = robot
        """Description of the arms."""
        self.model: mujoco.MjModel = compose(props, overview, robot).compile()
        self.data = mujoco.MjData(self.model)
        self.variants: Mapping[str, str] = {}
        """The variants of the layout that was applied last."""
        # What a variant switches in the model, and as it was compiled, with everything on.
        self._switches = (
            self.model.geom_contype,
            self.model.geom_conaffinity,
            self.model.geom_rgba,
        )
        self._compiled = [array.copy() for array in self._switches]
        self.touches = self._compiled[0], self._compiled[1]
        """Geoms that may touch, as contype and conaffinity, where all shapes of props are there."""
        self.duo = Duo(self.model, self.data, robot)
        self.contacts = Contacts(self.model, self.data, robot.gripper)
        super().__init__({prop.name: prop for prop in props}, self.model, self.data)
        corners = self._corners.items()
        self._places: dict[int, tuple[tuple[str, ...], list[Places], list[Places]]] = {}
        """Names of many props, and places of their positions and velocities, by the names'
        identity: to hash them takes longer than what the places are for."""
        self._positions = self.data.xpos.reshape(-1)
        self._few = {
            name: c.T.tolist() for name, c in corners if c.shape[1] <= FEW_CORNERS
        }
        self._boxes = {
            name: (
                self._bodies[name],
                ((c.max(axis=1) + c.min(axis=1)) / 2).tolist(),
                ((c.max(axis=1) - c.min(axis=1)) / 2).tolist(),
                c[:, c[2].argmin()].tolist(),
            )
            for name, c in corners
        }
        """Body, middle and half size of the box around the corners, and the lowest corner while it
        stands, of each prop."""
        self._state_size = mujoco.mj_stateSize(self.model, STATE)
        # Degrees of freedom of the props, hinges included, and what counts as rest for each.
        roots = [self._bodies[name] for name in self.props]
        self._loose = np.flatnonzero(
            np.isin(self.model.body_rootid[self.model.dof_bodyid], roots)
        )
        joints = self.model.dof_jntid[self._loose]
        slides = self.model.jnt_type[joints] == mujoco.mjtJoint.mjJNT_FREE
        slides &= self._loose - self.model.jnt_dofadr[joints] < 3  # noqa: PLR2004 - x, y and z
        self._settled = np.where(slides, SETTLE_SPEED, SETTLE_ANGULAR_SPEED)
        self.scaler = PhysicsScaler(self.model, roots)
        self._is_sparse = bool(mujoco.mj_isSparse(self.model))
        self._missing = np.empty(self.model.nv)
        self.reset_data()
        self.forward()

    # --- state ---------------------------------------------------------------------------------

    def reset_data(self) -> None:
        """Forget everything: time, velocities, controls, warm start; arms home, grippers open.

        Call `forward` before the next step, once everything is where it shall be.
        """
        mujoco.mj_resetData(self.model, self.data)
        self.duo.set_configuration(self.robot.home_command)

    def forward(self) -> None:
        """Bring poses, velocities and contacts up to date with the state, without moving time."""
        mujoco.mj_step1(self.model, self.data)
        self.contacts.update()

    def get_state(self) -> Array:
        """The full state (n,); continuing from it is bit-exact."""
        state = np.empty(self._state_size)
        mujoco.mj_getState(self.model, self.data, state, STATE)
        return state

    def set_state(self, state: Array) -> None:
        """Continue from a saved state of the same model.

        In an environment use its `restore_state`, which also brings what this state does not hold.
        """
        if np.shape(state) != (self._state_size,):
            raise SimulationError(
                f"A state of this model has {self._state_size} numbers, got shape "
                f"{np.shape(state)}: it was saved by another task or version."
            )
        # Residues of what was simulated before must not survive: the engine keeps the contact
        # list and solver statistics of the last step beside the state.
        mujoco.mj_resetData(self.model, self.data)
        mujoco.mj_setState(
            self.model, self.data, np.asarray(state, dtype=np.float64), STATE
        )
        self.forward()

    def __reduce__(self) -> NoReturn:
        """Reject `pickle` and `copy`, whose copies would no longer see the engine's memory."""
        raise DuoBenchError(
            "A simulation cannot be pickled or copied, and so cannot its environment. Make another "
            "environment in the same way, and give it what `save_state` of this one returns."
        )

    # --- motion --------------------------------------------------------------------------------

    def step(self, command: DuoCommand) -> DuoState:
        """Advance one control step towards a command, and read the state; see `advance`."""
        self.advance(command)
        return self.duo.read()

    def advance(self, command: DuoCommand) -> None:
        """Advance one control step (1/30 s, 16 physics steps) towards a command.

        The targets move linearly over the step. Afterwards poses, velocities and contacts are those
        of the new state.

        MuJoCo 4.0.0 factors the sparse matrices of large models wrongly in rare cases: its solver
        ends far from the solution, and a marble in a jerked cup leaves it at the speed of a bullet.
        A step in which that happens is repeated with dense matrices, which take three times as long
        in `pour_marbles`, the only task with so large a model. MuJoCo 4.0.1 mends it
        [https://github.com/google-deepmind/mujoco/issues/3767].
        """
        before = self.get_state() if self._is_sparse else None
        if not self._run(command, checked=self._is_sparse):
            assert before is not None  # only what was checked can be unsolved
            options = self.model.opt
            usual, options.jacobian = options.jacobian, mujoco.mjtJacobian.mjJAC_DENSE
            self.set_state(before)
            self._run(command, checked=False)
            options.jacobian = usual
            mujoco.mj_step1(self.model, self.data)
        raise_on_warning(
            self.data.warning.number.tolist(), f"at t = {self.data.time:.3f} s"
        )
        self.contacts.update()

    def _run(self, command: DuoCommand, *, checked: bool) -> bool:
        """Each step is its second half (forces, integration) and the next one's first half."""
        for _ in self.duo.interpolate(command):
            mujoco.mj_step2(self.model, self.data)
            if checked and not self._is_solved():
                return False
            mujoco.mj_step1(self.model, self.data)
        return True

    def _is_solved(self) -> bool:
        """Whether the accelerations of the last step are those that its forces cause."""
        data, missing = self.data, self._missing
        mujoco.mj_mulM(self.model, data, missing, data.qacc)
        missing -= data.qfrc_smooth
        missing -= data.qfrc_constraint
        # Written so that what is not a number counts as unsolved.
        return bool(np.abs(missing, out=missing).max() <= SOLVED)

    def settle(self) -> int:
        """Hold the arms still until every object is at rest, and set time to zero.

        Returns the control steps it took, at most `MAX_SETTLE_STEPS`.
        """
        command = self.duo.command()
        steps = 0
        is_settled = False
        while steps < MAX_SETTLE_STEPS and not is_settled:
            self.advance(command)
            steps += 1
            is_settled = self.is_settled()
        self.data.time = 0.0
        return steps

    def is_settled(self, share: float = 1.0) -> bool:
        """Whether every object is slower than a share of what counts as rest at a reset."""
        speeds = np.abs(self.data.qvel[self._loose])
        return bool((speeds < share * self._settled).all())

    # --- props ---------------------------------------------------------------------------------

    def apply(self, layout: Layout) -> None:
        """Put every prop where a layout says, at rest, and choose the variants of its shapes."""
        given, needed = set(layout.poses), set(self.props)
        if given != needed:
            raise LayoutError(
                f"The layout must place exactly {sorted(needed)}: missing "
                f"{sorted(needed - given)}, unknown {sorted(given - needed)}."
            )
        self.choose(layout.variants)
        for name, pose in layout.poses.items():
            self.place(name, pose)
        self.forward()

    def choose(self, variants: Mapping[str, str]) -> None:
        """Switch the shapes of all props to what a layout chose; no pose changes."""
        for prop in self.props.values():
            if prop.choice is not None:
                self._choose(prop, variants.get(prop.choice))
        self.variants = dict(variants)

    def _choose(self, prop: Prop, value: str | None) -> None:
        """Leave out of a prop what one of its variants leaves out, and nothing else."""
        chosen = prop.variants.get(value) if value is not None else None
        if chosen is None:
            raise LayoutError(
                f"{prop.name!r} has a variant {prop.choice!r}, one of {', '.join(prop.variants)}; "
                f"the layout says {value!r}."
            )
        model, root = self.model, self.model.body(prop.name)
        geoms = slice(root.geomadr[0], root.geomadr[0] + root.geomnum[0])
        for array, compiled in zip(self._switches, self._compiled, strict=True):
            array[geoms] = compiled[geoms]
        for number in chosen.without_shapes:
            geom = model.geom(f"{prop.name}:{number}").id
            model.geom_contype[geom] = model.geom_conaffinity[geom] = 0
        # A single box or ball is its own image.
        kind = "image" if root.geomnum[0] > len(prop.solid.shapes) else ""
        for number in chosen.without_images:
            model.geom_rgba[model.geom(f"{prop.name}:{kind}{number}").id, 3] = 0.0

    def place(self, name: str, pose: SE3) -> None:
        """Put a prop at a pose in the table frame, at rest; call `forward` after the last one."""
        if self.props[name].fixed:
            number = self.model.body(name).mocapid[0]
            self.data.mocap_pos[number] = pose.translation
            self.data.mocap_quat[number] = pose.wxyz
        else:
            joint = self.model.joint(name)
            start = joint.qposadr[0]
            self.data.qpos[start : start + 3] = pose.translation
            self.data.qpos[start + 3 : start + 7] = pose.wxyz
            self.data.qvel[joint.dofadr[0] : joint.dofadr[0] + 6] = 0.0

    def position(self, body: str) -> Array:
        """Origin (3,) of a body in the table frame; a view that the next step overwrites."""
        return self._xpos[self.body_id(body)]

    def rotation(self, body: str) -> Array:
        """Rotation matrix (3, 3) of a body in the table frame; a view."""
        return self._xmat[self.body_id(body)].reshape(3, 3)

    def pose(self, body: str) -> SE3:
        """Pose of a body in the table frame."""
        return SE3(self.rotation(body), self.position(body))

    def site_pose(self, site: str) -> SE3:
        """Pose of a site in the table frame."""
        number = resolve(self.model, mujoco.mjtObj.mjOBJ_SITE, site)
        return SE3(
            self.data.site_xmat[number].reshape(3, 3), self.data.site_xpos[number]
        )

    def _numbers(self, array: Array, row: int | slice) -> Any:
        return array[row].tolist()

    def _number(self, array: Array, place: int) -> float:
        return array.item(place)

    def chosen(
        self, choice: str, rows: Mapping[str, Sequence[float]]
    ) -> Sequence[float]:
        """The row of numbers that belongs to what the layout chose."""
        return rows[self.variants[choice]]

    def heights_inside(
        self,
        props: tuple[str, ...],
        vessel: str,
        *,
        radius: float,
        low: float,
        high: float,
    ) -> dict[int, float]:
        """Heights in a vessel of those of many props that are in it, by number.

        Positions have the same bits as those of `relative_position`, in a fraction of the time.

        Args:
            props: Their names.
            vessel: The body in whose frame they are.
            radius: Radius in metres of an upright cylinder about that frame's z axis.
            low: Bottom of the cylinder, in metres.
            high: Top of the cylinder, in metres.
        """
        _, places, _ = self._places_of(props)
        row = self._bodies[vessel]
        ox, oy, oz = self._xpos[row].tolist()
        xx, xy, xz, yx, yy, yz, zx, zy, zz = self._xmat[row].tolist()
        middle = (low + high) / 2
        centre = ox + middle * xz, oy + middle * yz, oz + middle * zz
        far = math.hypot(radius, high - middle) + CLEARLY
        columns: list[list[float]] = []
        for place, at in zip(places, centre, strict=True):
            column = self._positions[place].tolist()
            if min(column) > at + far or max(column) < at - far:
                return {}  # all are beside a ball around the cylinder
            columns.append(column)
        near = (radius - CLEARLY) ** 2
        found: dict[int, float] = {}
        points = zip(*columns, strict=True)
        for number, (px, py, pz) in enumerate(points):
            x, y, z = px - ox, py - oy, pz - oz
            up = xz * x + yz * y + zz * z
            if low <= up <= high and (
                x * x + y * y + z * z < near
                or math.hypot(xx * x + yx * y + zx * z, xy * x + yy * y + zy * z)
                <= radius
            ):
                found[number] = up
        return found

    def are_slower(
        self,
        props: tuple[str, ...],
        frame: str,
        limit: float,
        *,
        within: float,
    ) -> bool:
        """Whether `relative_speed` of many free props is clearly below a limit, at a glance.

        Args:
            props: Their names.
            frame: The free prop in whose frame they move.
            limit: Speed in m/s.
            within: How far from its origin they are at most, in metres.
        """
        _, _, places = self._places_of(props)
        velocity = self._velocity(frame)
        fastest = math.hypot(*velocity[3:]) * within
        for place, along in zip(places, velocity[:3], strict=True):
            column = self._qvel[place].tolist()
            fastest += max(max(column) - along, along - min(column))
        return fastest < limit - CLEARLY

    def _places_of(
        self, props: tuple[str, ...]
    ) -> tuple[tuple[str, ...], list[Places], list[Places]]:
        """Names of free props, and places of x, y and z of positions and of velocities."""
        found = self._places.get(id(props))
        if found is None:
            bodies = [3 * self.body_id(name) for name in props]
            dofs = [self._dofs[name] for name in props]
            found = self._places[id(props)] = props, _columns(bodies), _columns(dofs)
        return found

    def height_bounds(self, prop: str) -> tuple[float, float] | None:
        """Bounds as in `Questions`: of the box around the corners, and one corner's height."""
        row, (cx, cy, cz), (half_x, half_y, half_z), (a, b, c) = self._boxes[prop]
        x, y, z = self._xmat[row, 6:].tolist()
        origin = self._xpos.item(row, 2)
        middle = origin + cx * x + cy * y + cz * z
        lowest = middle - (half_x * abs(x) + half_y * abs(y) + half_z * abs(z))
        return lowest, origin + a * x + b * y + c * z

    def _lowest(
        self,
        prop: str,
        x: float,
        y: float,
        z: float,
    ) -> float:
        if prop in self._few:
            return min([a * x + b * y + c * z for a, b, c in self._few[prop]])
        a, b, c = self._corners[prop]
        return float((a * x + b * y + c * z).min())
