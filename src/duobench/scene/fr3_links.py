"""The links of one Franka Research 3 arm as numbers; nothing here needs an engine.

Kinematics, inertias, armature and friction are those of MuJoCo Menagerie's `franka_fr3`
(Apache-2.0); joint ranges are the manufacturer's data sheet; servo gains are the ones that
Menagerie publishes for position control.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

BLACK = (0.2, 0.2, 0.2, 1.0)
WHITE = (1.0, 1.0, 1.0, 1.0)
RED = (1.0, 0.072272, 0.039546, 1.0)

Vector = tuple[float, ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class Inertial:
    """Mass properties of a body in its own frame."""

    mass: float
    position: Vector
    wxyz: Vector
    diagonal: Vector


@dataclass(frozen=True, kw_only=True, slots=True)
class Joint:
    """A revolute joint about its body's z axis, with its position servo."""

    limits: tuple[float, float]
    torque: float
    armature: float
    friction: float
    kp: float


@dataclass(frozen=True, kw_only=True, slots=True)
class Link:
    """One link: where it hangs on the one before it, and what it looks like."""

    position: Vector = (0.0, 0.0, 0.0)
    wxyz: Vector = (1.0, 0.0, 0.0, 0.0)
    inertial: Inertial | None = None
    joint: Joint | None = None
    visuals: tuple[tuple[str, Vector], ...]


# The published model has eleven more images: buttons, plugs and lettering, less than a pixel in
# any camera. `tools/meshes` leaves them out.
LINKS = (
    Link(
        visuals=(
            ("link0_3", WHITE),
            ("link0_5", RED),
            ("link0_6", BLACK),
        ),
    ),
    Link(
        position=(0.0, 0.0, 0.333),
        inertial=Inertial(
            mass=2.92747,
            position=(4.128e-07, -0.0181251, -0.0386036),
            wxyz=(0.998098, -0.0605364, 0.00380499, 0.0110109),
            diagonal=(0.0239286, 0.0227246, 0.00610634),
        ),
        joint=Joint(limits=(-2.7437, 2.7437), torque=87, armature=0.195, friction=1.137, kp=4500),
        visuals=(("link1", WHITE),),
    ),
    Link(
        wxyz=(1.0, -1.0, 0.0, 0.0),
        inertial=Inertial(
            mass=2.93554,
            position=(0.00318289, -0.0743222, 0.00881461),
            wxyz=(0.502599, 0.584437, -0.465998, 0.434366),
            diagonal=(0.0629567, 0.0411924, 0.0246371),
        ),
        joint=Joint(limits=(-1.7837, 1.7837), torque=87, armature=0.195, friction=1.137, kp=4500),
        visuals=(("link2", WHITE),),
    ),
    Link(
        position=(0.0, -0.316, 0.0),
        wxyz=(1.0, 1.0, 0.0, 0.0),
        inertial=Inertial(
            mass=2.2449,
            position=(0.0407016, -0.00482006, -0.0289731),
            wxyz=(0.921025, -0.244161, 0.155272, 0.260745),
            diagonal=(0.0267409, 0.0189869, 0.0171587),
        ),
        joint=Joint(limits=(-2.9007, 2.9007), torque=87, armature=0.195, friction=1.137, kp=3500),
        visuals=(("link3_0", WHITE), ("link3_1", BLACK)),
    ),
    Link(
        position=(0.0825, 0.0, 0.0),
        wxyz=(1.0, 1.0, 0.0, 0.0),
        inertial=Inertial(
            mass=2.6156,
            position=(-0.0459101, 0.0630493, -0.00851879),
            wxyz=(0.438018, 0.803311, 0.00937812, 0.403414),
            diagonal=(0.05139, 0.0372717, 0.0160047),
        ),
        joint=Joint(limits=(-3.0421, -0.1518), torque=87, armature=0.195, friction=1.137, kp=3500),
        visuals=(("link4_0", WHITE), ("link4_1", BLACK)),
    ),
    Link(
        position=(-0.0825, 0.384, 0.0),
        wxyz=(1.0, -1.0, 0.0, 0.0),
        inertial=Inertial(
            mass=2.32712,
            position=(-0.00160396, 0.0292536, -0.0972966),
            wxyz=(0.919031, 0.125604, 0.0751531, -0.366003),
            diagonal=(0.0579335, 0.0449144, 0.0130634),
        ),
        joint=Joint(limits=(-2.8065, 2.8065), torque=12, armature=0.074, friction=0.763, kp=2000),
        visuals=(("link5_0", WHITE), ("link5_2", BLACK)),
    ),
    Link(
        wxyz=(1.0, 1.0, 0.0, 0.0),
        inertial=Inertial(
            mass=1.81704,
            position=(0.0597131, -0.0410295, -0.0101693),
            wxyz=(0.621301, 0.552665, 0.510011, 0.220081),
            diagonal=(0.0175039, 0.0161123, 0.00193529),
        ),
        joint=Joint(limits=(0.5445, 4.5169), torque=12, armature=0.074, friction=0.44, kp=2000),
        visuals=(
            ("link6_1", WHITE),
            ("link6_2", WHITE),
            ("link6_6", BLACK),
        ),
    ),
    Link(
        position=(0.088, 0.0, 0.0),
        wxyz=(1.0, 1.0, 0.0, 0.0),
        inertial=Inertial(
            mass=0.627143,
            position=(0.00452258, 0.00862619, -0.0161633),
            wxyz=(0.727579, 0.0978688, -0.24906, 0.63168),
            diagonal=(0.000223836, 0.000223642, 5.64132e-07),
        ),
        joint=Joint(limits=(-3.0159, 3.0159), torque=12, armature=0.074, friction=0.248, kp=2000),
        visuals=(
            ("link7_1", WHITE),
            ("link7_2", WHITE),
            ("link7_3", BLACK),
        ),
    ),
)
"""Link 0 (the base) to link 7."""

JOINT_RANGES = np.array([link.joint.limits for link in LINKS if link.joint is not None])
"""Joint ranges (7, 2) in radians."""
JOINT_RANGES.setflags(write=False)
