"""The gripper at the end of both arms, described once.

The scene builds its model by this description (`scene.gripper`), the simulation and the guard find
its parts by it, and real arms take its driver from it. Another gripper is another description, the
builder of its model, and its driver.
"""

import math
from dataclasses import dataclass

from duobench.core.spatial import SE3


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    eq=False,
)
class Gripper:
    """A gripper of two fingers; its parts are named within it, as in `left/gripper/left_pad`."""

    name: str
    fingers: tuple[str, str]
    """Its fingers; a part of one begins with its name, and all other parts are the palm."""
    pad: str
    """The part of a finger that grasps."""
    drive: str
    """The joint of a finger that the actuator moves."""
    drive_closed: float
    """Angle of these joints in radians at which the pads meet; they are open at 0."""
    ctrl_closed: float
    """Input of the actuator for closed; 0 is open."""
    stroke: float
    """Largest gap between the pads in metres: opening 1."""
    flange_from_base: SE3
    """Pose of its base in the flange."""
    tool_offset: float
    """Tool centre point, which is between the pads, beyond the flange along z, in metres."""
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
    driver: str
    """Driver of the real one below `duobench.real.drivers`; a rig's file names the module."""
    libraries: tuple[str, ...]
    """Libraries of the driver, as pip knows them."""

    @property
    def pads(self) -> tuple[str, ...]:
        """Bodies of the pads."""
        return tuple(f"{finger}_{self.pad}" for finger in self.fingers)

    @property
    def drives(self) -> tuple[str, ...]:
        """Joints that the actuator moves, one a finger."""
        return tuple(f"{finger}_{self.drive}" for finger in self.fingers)

    @property
    def word(self) -> str:
        """Name of its driver in a rig's file."""
        return self.driver.partition(":")[0]

    def finger_of(self, part: str) -> str | None:
        """Return the finger that a part belongs to; None for one of the palm."""
        for finger in self.fingers:
            if part.startswith(f"{finger}_"):
                return finger
        return None


ROBOTIQ_2F85 = Gripper(
    name="Robotiq 2F-85",
    fingers=("left", "right"),
    pad="pad",
    drive="driver",
    drive_closed=0.8 / (2 * 0.485),  # length and share of the tendon [Menagerie]
    ctrl_closed=255.0,
    stroke=0.085,  # data sheet
    flange_from_base=SE3.about((0.0, 0.0, 1.0), math.pi / 2),
    tool_offset=0.1493,  # facts of the platform
    reach=0.25,  # 0.186 measured, open and closed
    mass=0.900,
    speeds=(0.020, 0.150),  # data sheet
    forces=(20.0, 235.0),  # data sheet
    force=100.0,  # what a printed part withstands, and holds the heaviest object of the benchmark
    driver="robotiq:RobotiqGripper",
    libraries=("pymodbus", "pyserial"),
)
GRIPPER = ROBOTIQ_2F85
"""The gripper on both arms."""
