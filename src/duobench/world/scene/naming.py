"""Names inside the compiled model, in one place: `left/joint1`, `right/tcp`, `chest/lid`."""

from duobench.core.types import ARM_JOINTS, Side
from duobench.world.robot.gripper import Gripper

TABLE = "table"
"""Body of the table top."""
FLOOR = "floor"
"""Body of the floor, apart from the world's: beside an endless plane the engine would compare every
body with all that stands still, which takes 3 to 5 % of a step (measured)."""


def arm_joint_names(side: Side) -> tuple[str, ...]:
    """The seven joints of one arm, also the names of their actuators."""
    return tuple(f"{side}/joint{number}" for number in range(1, ARM_JOINTS + 1))


def tcp_name(side: Side) -> str:
    """Site at the tool centre point; z points out of the gripper, fingers open along y."""
    return f"{side}/tcp"


def flange_name(side: Side) -> str:
    """Site at the flange."""
    return f"{side}/flange"


def gripper_name(side: Side) -> str:
    """Prefix of the gripper's bodies and geoms, and the name of its actuator."""
    return f"{side}/gripper"


def drive_names(side: Side, gripper: Gripper) -> tuple[str, ...]:
    """Joints of one gripper that its actuator moves."""
    return tuple(f"{gripper_name(side)}/{name}" for name in gripper.drives)


def pad_names(side: Side, gripper: Gripper) -> tuple[str, ...]:
    """The two pad bodies of one gripper."""
    return tuple(f"{gripper_name(side)}/{name}" for name in gripper.pads)
