"""The gripper at the end of both arms, described once.

The simulation and the guard find its parts by this description, which names the builder of its
model and its driver. Another gripper is another description with its own of both.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from duobench.core.spatial import SE3
from duobench.core.types import CONTROL_HZ


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    eq=False,
)
class Gripper:
    """A gripper of two fingers; its parts are named within it, as in `left/gripper/left_pad`."""

    name: str
    """Name for people."""
    model: str
    """Import path of a function `add(spec, gripper, side, body, flange)`, which hangs its model on
    a body, in whose frame the flange has a pose."""
    fingers: tuple[str, str]
    """Its fingers; a part of one begins with its name, and all other parts are the palm."""
    pad: str
    """The part of a finger that grasps."""
    drive: str
    """The joint of a finger that the actuator moves."""
    drive_closed: float
    """Position of these joints in radians or metres at which the pads meet; at 0 they are open."""
    ctrl_closed: float
    """Input of the actuator for closed; 0 is open."""
    stroke: float
    """Largest gap between the pads in metres: opening 1."""
    yaw: float = 0.0
    """Turn in radians about the flange's z that it is mounted with; frames of flange and tool are
    turned with it, and at home the last joint is turned back."""
    flange_from_base: SE3
    """Pose of its base in the flange."""
    tool_offset: float
    """Tool centre point, which is between the pads, beyond the flange along z, in metres."""
    tips: float
    """Reach of its pads beyond the tool centre point, along z, around a 32 mm cube, in metres."""
    camera: tuple[float, float, float]
    """Lens of the camera on the wrist, in the flange frame, in metres."""
    bracket: tuple[float, float, float]
    """Middle of that camera's bracket (8 x 32 x 52 mm), in the flange frame, in metres."""
    reach: float
    """No point of it is further from its pads, in metres."""
    mass: float
    """Mass in kg, fingers included."""
    speeds: tuple[float, float]
    """Speeds in m/s that the gap can be told to change with."""
    forces: tuple[float, float]
    """Forces in N that the pads can be told to press with."""
    force: float
    """The force in N that they press with in simulation; the speed there is the largest."""
    hold_steps: int = 1
    """Control steps from one target of its fingers to the next, on a fixed grid from the reset on:
    a newer one stops a running motion, which takes its time."""
    driver: str
    """Import path of the driver of the real one; a rig's file has the name of its module."""
    libraries: tuple[str, ...]
    """Libraries of the driver, as pip knows them."""
    is_on_arm: bool = False
    """Whether the driver reaches it through the control box of its arm."""

    @property
    def pads(self) -> tuple[str, ...]:
        """Bodies of the pads."""
        return tuple(f"{finger}_{self.pad}" for finger in self.fingers)

    @property
    def drives(self) -> tuple[str, ...]:
        """Joints that the actuator moves, one a finger."""
        return tuple(f"{finger}_{self.drive}" for finger in self.fingers)

    def takes_target(self, step: Any) -> Any:
        """Whether it takes a new target in a control step, counted from the reset; also arrays."""
        return step % self.hold_steps == 0

    @property
    def closing_steps(self) -> float:
        """Control steps from open to closed, at its largest speed."""
        return CONTROL_HZ * self.stroke / self.speeds[1]

    @property
    def word(self) -> str:
        """Name of its driver in a rig's file."""
        return self.driver.partition(":")[0].rpartition(".")[2]

    def finger_of(self, part: str) -> str | None:
        """Return the finger that a part belongs to; None for one of the palm."""
        for finger in self.fingers:
            if part.startswith(f"{finger}_"):
                return finger
        return None


RESTART_S = 0.025
"""Seconds for which fingers of a Franka Hand stand still where a newer target replaces what runs:
13 to 25 ms in 51 of 52 tries with franky-sim, 1 to 12 of them its stop."""
ROBOTIQ_2F85 = Gripper(
    name="Robotiq 2F-85",
    model="duobench.world.scene.robotiq_2f85:add_gripper",
    fingers=("left", "right"),
    pad="pad",
    drive="driver",
    drive_closed=0.8 / (2 * 0.485),  # length and share of the tendon [Menagerie]
    ctrl_closed=255.0,
    stroke=0.085,  # data sheet
    flange_from_base=SE3.about((0.0, 0.0, 1.0), math.pi / 2),
    tool_offset=0.1493,  # facts of the platform
    tips=0.0229,  # measured; 0.0097 where it is open
    camera=(0.050, 0.0, 0.067),  # manufacturer's camera mount
    bracket=(0.046, 0.0, 0.020),
    reach=0.25,  # 0.186 measured, open and closed
    mass=0.900,
    speeds=(0.020, 0.150),  # data sheet
    forces=(20.0, 235.0),  # data sheet
    force=100.0,  # what a printed part withstands, and holds the heaviest object of the benchmark
    driver="duobench.real.drivers.robotiq:RobotiqGripper",
    libraries=("pymodbus", "pyserial"),
)
FRANKA_HAND = Gripper(
    name="Franka Hand",
    model="duobench.world.scene.franka_hand:add_gripper",
    fingers=("left", "right"),
    pad="tip",
    drive="slide",
    drive_closed=0.040,  # each finger's half of the stroke
    ctrl_closed=0.080,
    stroke=0.080,  # data sheet
    yaw=-math.pi / 4,  # [Menagerie franka_emika_panda]
    flange_from_base=SE3(),
    tool_offset=0.1034,  # manufacturer's robot description
    tips=0.0085,
    # Sees both tips, and little of the palm.
    camera=(0.056, 0.0, 0.035),
    bracket=(0.046, 0.0, -0.002),
    reach=0.20,  # 0.17 measured, open and closed
    mass=0.760,  # [Menagerie]; data sheet: about 0.7
    speeds=(0.010, 0.100),  # data sheet: at most 50 mm/s a finger
    forces=(10.0, 70.0),  # data sheet: 70 N continuously
    force=70.0,
    hold_steps=round(8 * RESTART_S * CONTROL_HZ),  # an eighth of the time at most
    driver="duobench.real.drivers.franka_hand:FrankaHand",
    libraries=("franky-control",),
    is_on_arm=True,
)
GRIPPERS: Mapping[str, Gripper] = {
    "robotiq_2f85": ROBOTIQ_2F85,
    "franka_hand": FRANKA_HAND,
}
"""Grippers by the names that options, records and files have for them."""
DEFAULT_GRIPPER = "robotiq_2f85"
"""Gripper of the paper."""
