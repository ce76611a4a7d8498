"""The links of one Franka Research 3 arm as numbers; nothing here needs an engine.

Kinematics, inertias, armature and friction are those of MuJoCo Menagerie's `franka_fr3`
(Apache-2.0); joint ranges are the manufacturer's data sheet; servo gains are the ones that
Menagerie publishes for position control.
"""

from dataclasses import dataclass

BLACK = (0.2, 0.2, 0.2, 1.0)
WHITE = (1.0, 1.0, 1.0, 1.0)
RED = (1.0, 0.072272, 0.039546, 1.0)

Vector = tuple[float, ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class Link:
    """One rigid part of the robot: where it hangs on the one before it, mass, and images."""

    position: Vector = (0.0, 0.0, 0.0)
    """Position in the frame of the one before it, in metres."""
    wxyz: Vector = (1.0, 0.0, 0.0, 0.0)
    """Orientation in that frame, as a quaternion of any length."""
    mass: float | None = None
    """Mass in kg; None where the link stands still or its geoms decide."""
    centre: Vector = ()
    """Centre of mass in the link's frame, in metres."""
    axes_wxyz: Vector = ()
    """Orientation of the principal axes of inertia in the link's frame."""
    inertia: Vector = ()
    """Moments of inertia about them in kg·m²."""
    visuals: tuple[tuple[str, Vector], ...] = ()
    """Meshes and their colours."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Joint:
    """A revolute joint about its body's z axis, with its position servo."""

    limits: tuple[float, float]
    """Range in radians."""
    torque: float
    """Largest torque in N·m."""
    armature: float
    """Inertia of the motor in kg·m²."""
    friction: float
    """Dry friction in N·m."""
    kp: float
    """Stiffness of the servo in N·m/rad."""


@dataclass(frozen=True, kw_only=True, slots=True)
class ArmLink(Link):
    """One link of the arm."""

    joint: Joint | None = None
    """Its joint to the one before it; None for the base."""


# The published model has eleven more images: buttons, plugs and lettering, less than a pixel in
# any camera. `dev/tools/meshes` leaves them out.
LINKS = (
    ArmLink(visuals=(("link0_3", WHITE), ("link0_5", RED), ("link0_6", BLACK))),
    ArmLink(
        position=(0.0, 0.0, 0.333),
        mass=2.92747,
        centre=(4.128e-07, -0.0181251, -0.0386036),
        axes_wxyz=(0.998098, -0.0605364, 0.00380499, 0.0110109),
        inertia=(0.0239286, 0.0227246, 0.00610634),
        joint=Joint(limits=(-2.7437, 2.7437), torque=87, armature=0.195, friction=1.137, kp=4500),
        visuals=(("link1", WHITE),),
    ),
    ArmLink(
        wxyz=(1.0, -1.0, 0.0, 0.0),
        mass=2.93554,
        centre=(0.00318289, -0.0743222, 0.00881461),
        axes_wxyz=(0.502599, 0.584437, -0.465998, 0.434366),
        inertia=(0.0629567, 0.0411924, 0.0246371),
        joint=Joint(limits=(-1.7837, 1.7837), torque=87, armature=0.195, friction=1.137, kp=4500),
        visuals=(("link2", WHITE),),
    ),
    ArmLink(
        position=(0.0, -0.316, 0.0),
        wxyz=(1.0, 1.0, 0.0, 0.0),
        mass=2.2449,
        centre=(0.0407016, -0.00482006, -0.0289731),
        axes_wxyz=(0.921025, -0.244161, 0.155272, 0.260745),
        inertia=(0.0267409, 0.0189869, 0.0171587),
        joint=Joint(limits=(-2.9007, 2.9007), torque=87, armature=0.195, friction=1.137, kp=3500),
        visuals=(("link3_0", WHITE), ("link3_1", BLACK)),
    ),
    ArmLink(
        position=(0.0825, 0.0, 0.0),
        wxyz=(1.0, 1.0, 0.0, 0.0),
        mass=2.6156,
        centre=(-0.0459101, 0.0630493, -0.00851879),
        axes_wxyz=(0.438018, 0.803311, 0.00937812, 0.403414),
        inertia=(0.05139, 0.0372717, 0.0160047),
        joint=Joint(limits=(-3.0421, -0.1518), torque=87, armature=0.195, friction=1.137, kp=3500),
        visuals=(("link4_0", WHITE), ("link4_1", BLACK)),
    ),
    ArmLink(
        position=(-0.0825, 0.384, 0.0),
        wxyz=(1.0, -1.0, 0.0, 0.0),
        mass=2.32712,
        centre=(-0.00160396, 0.0292536, -0.0972966),
        axes_wxyz=(0.919031, 0.125604, 0.0751531, -0.366003),
        inertia=(0.0579335, 0.0449144, 0.0130634),
        joint=Joint(limits=(-2.8065, 2.8065), torque=12, armature=0.074, friction=0.763, kp=2000),
        visuals=(("link5_0", WHITE), ("link5_2", BLACK)),
    ),
    ArmLink(
        wxyz=(1.0, 1.0, 0.0, 0.0),
        mass=1.81704,
        centre=(0.0597131, -0.0410295, -0.0101693),
        axes_wxyz=(0.621301, 0.552665, 0.510011, 0.220081),
        inertia=(0.0175039, 0.0161123, 0.00193529),
        joint=Joint(limits=(0.5445, 4.5169), torque=12, armature=0.074, friction=0.44, kp=2000),
        visuals=(("link6_1", WHITE), ("link6_2", WHITE), ("link6_6", BLACK)),
    ),
    ArmLink(
        position=(0.088, 0.0, 0.0),
        wxyz=(1.0, 1.0, 0.0, 0.0),
        mass=0.627143,
        centre=(0.00452258, 0.00862619, -0.0161633),
        axes_wxyz=(0.727579, 0.0978688, -0.24906, 0.63168),
        inertia=(0.000223836, 0.000223642, 5.64132e-07),
        joint=Joint(limits=(-3.0159, 3.0159), torque=12, armature=0.074, friction=0.248, kp=2000),
        visuals=(("link7_1", WHITE), ("link7_2", WHITE), ("link7_3", BLACK)),
    ),
)
"""Link 0 (the base) to link 7."""
