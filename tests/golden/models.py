"""What the physics of a task is made of: masses, springs, friction, shapes, servos, options.

An episode shows only what it happens to depend on, and across machines only for its first second.
The inputs of the physics can be compared exactly and as a whole. Numbers of a task's objects are
written out, so that a difference tells what changed; of the robot and of long lists there are
digests, one for each property.

Numbers are rounded, to `DIGITS` significant digits or, lengths and directions, to `DECIMALS`
places: the last bits of a sine do not matter. Of a hull the description is used, and where it is,
not what the compiler computes from its mesh.
"""

import hashlib
import json
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from dev.benchmarks.kernels import model_digests
from duobench.world.objects.prop import Prop
from duobench.world.objects.shapes import ShapeKind
from duobench.world.objects.solid import Solid
from duobench.world.scene.compose import compose

DIGITS = 8
DECIMALS = 9
"""More than any number in the sources has: one that lies between two rounded ones could go up on
one machine and down on the next."""
NOISE = 14
"""Decimal places from which on a number is nothing but rounding errors about zero."""

Description = dict[str, Any]


QUANTITIES = {
    "opt": "timestep gravity integrator cone jacobian solver iterations tolerance ls_iterations "
    "ls_tolerance noslip_iterations noslip_tolerance ccd_iterations ccd_tolerance impratio density "
    "viscosity wind disableflags enableflags disableactuator",
    "size": "nq nv nu na nbody njnt ngeom nmocap neq ntendon npair",
    "body": "mass inertia ipos pos gravcomp",
    "jnt": "type axis pos range limited stiffness stiffnesspoly springyield actfrcrange "
    "actfrclimited margin solref solimp",
    "dof": "damping dampingpoly armature frictionloss solref solimp",
    "actuator": "trntype gear gaintype gainprm biastype biasprm dyntype dynprm ctrlrange "
    "ctrllimited forcerange forcelimited armature damping delay",
    "eq": "type data solref solimp active0",
    "tendon": "range limited stiffness damping frictionloss lengthspring",
    "geom": "contype conaffinity condim friction solref solimp solmix margin gap priority adhesion "
    "surfacevel",
}
"""Names of what is compared, by the beginning of its name in a model."""
TURNS = ("quat", "iquat")
HINGE_TYPE = mujoco.mjtJoint.mjJNT_HINGE
HINGE = ("stiffness", "range", "axis", "pos")
HINGE_DOF = ("damping", "armature", "frictionloss")


def significant(values: ArrayLike) -> Any:
    """Numbers with `DIGITS` significant digits, as a list or a plain number."""
    array = np.round(np.asarray(values, dtype=np.float64), NOISE)
    rounded = [float(f"{value:.{DIGITS}g}") + 0.0 for value in array.ravel().tolist()]
    return np.reshape(rounded, array.shape).tolist()


def lengths(values: ArrayLike) -> Any:
    """Numbers with `DECIMALS` places, as a list; there is no minus zero."""
    return (np.round(np.asarray(values, dtype=np.float64), DECIMALS) + 0.0).tolist()


def digest(value: object) -> str:
    """The beginning of the SHA-256 of something's JSON text."""
    return hashlib.sha256(json.dumps(value).encode()).hexdigest()[:12]


def describe(props: tuple[Prop, ...]) -> dict[str, Description]:
    """The physical inputs of the model with these objects, by part of the model."""
    model = compose(props).compile()
    solids: dict[str, Solid] = {}
    for prop in props:
        solids[prop.name] = prop.solid
        solids |= {prop.part_name(part.name): part.solid for part in prop.parts}
    numbers = {name: model.body(name).id for name in solids}
    options, sizes = QUANTITIES["opt"].split(), QUANTITIES["size"].split()
    station = [number for number in range(model.nbody) if number not in numbers.values()]
    return {
        "compiled": {"arrays": digest(model_digests(model))},
        "options": {name: significant(getattr(model.opt, name)) for name in options},
        "sizes": {name: int(getattr(model, name)) for name in sizes},
        **_station(model, np.array(station)),
        **{name: _object(model, number, solids[name]) for name, number in numbers.items()},
    }


def _station(model: mujoco.MjModel, bodies: np.ndarray) -> dict[str, Description]:
    """Digests of table and robot: of every body that is no part of the task's objects."""
    joints = np.isin(model.jnt_bodyid, bodies)
    dofs = np.isin(model.dof_bodyid, bodies)
    geoms = _colliding(model, bodies)
    return {
        "station bodies": _digests(model, "body", bodies)
        | {
            name: digest(_turns(getattr(model, f"body_{name}")[bodies]))
            for name in ("quat", "iquat")
        },
        "station joints": _digests(model, "jnt", joints)
        | {f"dof {name}": value for name, value in _digests(model, "dof", dofs).items()}
        | {"rest": digest(significant(model.qpos_spring[model.jnt_qposadr[joints]]))},
        "station servos": _digests(model, "actuator"),
        "station linkages": _digests(model, "eq")
        | {f"tendon {name}": value for name, value in _digests(model, "tendon").items()}
        | {"shares": digest(significant(model.wrap_prm))},
        "station contacts": _digests(model, "geom", geoms)
        | {"shapes": digest(_primitives(model, geoms))}
        | {"excluded": digest(sorted(model.exclude_signature.tolist()))},
    }


def _object(model: mujoco.MjModel, body: int, solid: Solid) -> Description:
    """A part of an object: what it weighs, what it touches with, and what it hangs on."""
    geoms = _colliding(model, np.array([body]))
    hulls = [shape for shape in solid.shapes if shape.kind is ShapeKind.HULL]
    placed = [lengths(model.body_pos[body]), _turns(model.body_quat[[body]])]
    drawn = [lengths([*hull.pose.rotation, hull.pose.translation, *hull.points]) for hull in hulls]
    told: Description = {
        "mass": significant(model.body_mass[body]),
        "inertia": significant(model.body_inertia[body]),
        "centre": lengths(model.body_ipos[body]),
        "shapes": len(geoms),
        "friction": _distinct(model.geom_friction[geoms]),
        "contact": digest(list(_digests(model, "geom", geoms).values())),
        "geometry": digest([placed, _primitives(model, geoms), drawn]),
    }
    joints = np.flatnonzero((model.jnt_bodyid == body) & (model.jnt_type == HINGE_TYPE))
    for joint in joints.tolist():
        dof, angle = model.jnt_dofadr[joint], model.jnt_qposadr[joint]
        told |= {name: significant(getattr(model, f"jnt_{name}")[joint]) for name in HINGE}
        told |= {name: significant(getattr(model, f"dof_{name}")[dof]) for name in HINGE_DOF}
        told["rest"] = significant(model.qpos_spring[angle])
        told["others"] = digest([_digests(model, "jnt", [joint]), _digests(model, "dof", [dof])])
    return told


def _colliding(model: mujoco.MjModel, bodies: np.ndarray) -> np.ndarray:
    """Numbers of the geoms of some bodies that can touch anything."""
    touchable = (model.geom_contype | model.geom_conaffinity) != 0
    return np.flatnonzero(touchable & np.isin(model.geom_bodyid, bodies))


def _primitives(model: mujoco.MjModel, geoms: np.ndarray) -> list[Any]:
    """Type, size and pose of each geom that is no mesh, and the type alone of one that is."""
    told = []
    for geom in geoms.tolist():
        told.append([int(model.geom_type[geom])])
        if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_MESH:
            told[-1] += [lengths(model.geom_size[geom]), lengths(model.geom_pos[geom])]
            told[-1].append(_turns(model.geom_quat[[geom]]))
    return told


def _turns(quaternions: np.ndarray) -> list[Any]:
    """Rotation matrices: of the two quaternions of a turn, either may come out."""
    matrix = np.empty(9)
    turns = []
    for quaternion in quaternions:
        mujoco.mju_quat2Mat(matrix, quaternion)
        turns.append(lengths(matrix))
    return turns


def _digests(model: mujoco.MjModel, kind: str, rows: Any = ...) -> dict[str, str]:
    arrays = {name: getattr(model, f"{kind}_{name}")[rows] for name in QUANTITIES[kind].split()}
    return {name: digest(significant(array)) for name, array in arrays.items()}


def _distinct(rows: np.ndarray) -> list[Any]:
    """Each row once, in the order of their first appearance."""
    return [list(row) for row in dict.fromkeys(map(tuple, significant(rows)))]
