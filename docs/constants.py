"""Numbers that pages have in their sentences, by name.

A place for one is `<!-- number:NAME -->12<!-- / -->`, which a reader of the page does not see;
`make docs` writes the number (tables.py).
"""

from collections.abc import Iterable, Mapping
from inspect import signature

from dev.benchmarks import bounds
from duobench import __version__
from duobench.core.randomness import SUITE_VERSION
from duobench.core.types import CONTROL_HZ
from duobench.data.schema import SCHEMA
from duobench.envs.config import IMAGE_SIZE
from duobench.envs.registration import VERSION
from duobench.evaluation.replay.sources import LAYOUTS
from duobench.evaluation.replay.viewer import MAX_ITEMS
from duobench.printing import jig, recipe
from duobench.printing.formats import BED_STEP
from duobench.real.calibration import places
from duobench.real.cell import Workspace
from duobench.real.doctor import examine
from duobench.real.drivers import frames, robotiq
from duobench.real.guard import FINGER_MARGIN, MARGIN, PROP_MARGIN, TABLE_DEPTH
from duobench.real.rig import (
    DAMPING_RATIOS,
    JOINT_TORQUES,
    MAX_FORCE,
    MAX_TOOL_SPEED,
    ArmConfig,
    GripperConfig,
)
from duobench.real.sessions.cameras import FILM_RATE
from duobench.real.sessions.status_page import SILENCE_S
from duobench.real.sessions.trials import TrialsSession
from duobench.real.watchdog import STOP_AFTER_S
from duobench.results.records import RECORD_SCHEMA
from duobench.results.report import SUMMARY_SCHEMA
from duobench.results.run import RUN_SCHEMA, TimeLimits
from duobench.results.suite import SUITES, Suite, find_tasks
from duobench.tasks import catalog
from duobench.tasks.shifts.shift import LEVELS
from duobench.web.messages import MAX_MESSAGE
from duobench.web.server import MAX_PEERS
from duobench.world.objects import chest, hexagon_peg, joint_blocks, shapes
from duobench.world.objects.solid import PLA_DENSITY
from duobench.world.robot.cameras import NATIVE_HEIGHT, NATIVE_WIDTH
from duobench.world.robot.frames import ROBOT
from duobench.world.robot.workcell import FLOOR_Z
from duobench.world.scene.compose import SUBSTEPS
from duobench.world.sim.placement import REACH_X, REACH_Y


def mm(metres: float) -> str:
    """Return a length in millimetres."""
    return f"{1000 * metres:g}"


def percent(share: float) -> str:
    """Return a share in percent, without the sign."""
    return f"{100 * share:g}"


def span(ends: Iterable[float], unit: float = 1) -> str:
    """Return the ends of a range."""
    return " to ".join(f"{end / unit:g}" for end in ends)


def arm(name: str) -> str:
    """Return the default of a field of an arm, the first and the last of several."""
    value = getattr(ArmConfig(), name)
    ends = (value[0], value[-1]) if isinstance(value, tuple) else (value,)
    return " … ".join(f"{end:g}" for end in ends)


NUMBERS: Mapping[str, str] = {
    # Evaluations
    "control rate": f"{CONTROL_HZ:g}",
    "substeps": str(SUBSTEPS),
    "physics rate": f"{CONTROL_HZ * SUBSTEPS:g}",
    "last episode": str(Suite(tasks=find_tasks(())).indices[-1]),
    "act timeout": f"{TimeLimits().act_timeout:g}",
    "episode timeout": f"{TimeLimits().episode_timeout:g}",
    "robust episodes": str(SUITES["robust"].episodes),
    "robust shifts": str(len(SUITES["robust"].shifts) - 1),
    "bounds episodes": f"{3 * LEVELS * len(catalog.names()) * bounds.EPISODES:,}",
    # Versions
    "package version": __version__,
    "suite version": SUITE_VERSION,
    "id version": str(VERSION),
    "record schema": str(RECORD_SCHEMA),
    "run schema": str(RUN_SCHEMA),
    "summary schema": str(SUMMARY_SCHEMA),
    "recording schema": str(SCHEMA),
    # Frames and images
    "image size": " × ".join(map(str, IMAGE_SIZE)),
    "lens size": f"{NATIVE_WIDTH} × {NATIVE_HEIGHT}",
    "tool offset": f"{ROBOT.gripper.tool_offset:.4f}",
    "floor": f"{FLOOR_Z:.4f}",
    "reach x": span(REACH_X),
    "reach y": span(REACH_Y),
    # Pages in a browser
    "layouts": str(LAYOUTS),
    "most viewed": str(MAX_ITEMS),
    "largest message": f"{MAX_MESSAGE:,}",
    "browsers": str(MAX_PEERS),
    # Printing
    "density": f"{PLA_DENSITY:g}",
    "infill": percent(recipe.SPARSE),
    "mass tolerance": percent(recipe.TOLERANCE),
    "bed step": mm(BED_STEP),
    "printer": mm(shapes.PRINTER),
    "free width": mm(shapes.KEPT_FREE[0]),
    "free depth": mm(shapes.KEPT_FREE[1]),
    "thinnest wall": mm(shapes.THINNEST_WALL),
    "joint play": mm(shapes.JOINT_PLAY),
    "overlap": mm(shapes.OVERLAP),
    "square peg play": mm(joint_blocks.CLEARANCE),
    "hexagonal peg play": mm(hexagon_peg.CLEARANCE),
    "lug hole": mm(2 * chest.HOLE_RADIUS),
    "barrel hole": mm(2 * chest.THREAD_RADIUS),
    "lid play": mm(chest.GAP),
    "post play": mm(chest.POST_PLAY),
    "jig line": mm(jig.LINE),
    "jig widths": span(jig.ACROSS, 0.001),
    "jig fronts": span(jig.FRONT, 0.001),
    "foot front": mm(jig.Foot().front),
    "foot width": mm(jig.Foot().width),
    # Real arms
    "arm stiffness": arm("stiffness"),
    "arm damping": arm("damping"),
    "arm torque_threshold": arm("torque_threshold"),
    "arm force_threshold": arm("force_threshold"),
    "arm moment_threshold": arm("moment_threshold"),
    "arm speed_fraction": arm("speed_fraction"),
    "arm tool_speed": arm("tool_speed"),
    "arm acceleration": arm("acceleration"),
    "arm home_fraction": arm("home_fraction"),
    "gripper force": f"{GripperConfig().newtons(ROBOT.gripper):.0f}",
    "gripper silence": f"{robotiq.SILENT_S:g}",
    "largest tool speed": f"{MAX_TOOL_SPEED:g}",
    "largest force": f"{MAX_FORCE:g}",
    "strong joint": f"{JOINT_TORQUES[0]:g}",
    "weak joint": f"{JOINT_TORQUES[-1]:g}",
    "damping ratios": span(DAMPING_RATIOS),
    "workspace x": span((Workspace().low[0], Workspace().high[0])),
    "workspace y": f"{Workspace().high[1]:g}",
    "margin": mm(MARGIN),
    "finger margin": mm(FINGER_MARGIN),
    "table depth": mm(TABLE_DEPTH),
    "prop margin": mm(PROP_MARGIN),
    "stop after": f"{STOP_AFTER_S:g}",
    "page silence": f"{SILENCE_S:g}",
    "film rate": str(FILM_RATE),
    "trials": str(signature(TrialsSession).parameters["episodes"].default),
    "stale image": f"{frames.STALE_S:g}",
    "fewest views": str(places.FEWEST_VIEWS),
    "scale error": percent(places.LARGEST_SCALE_ERROR),
    "noted mm": mm(places.NOTED_M),
    "noted degrees": f"{places.NOTED_DEG:g}",
    "refused mm": mm(places.REFUSED_M),
    "refused degrees": f"{places.REFUSED_DEG:g}",
    "least in time": percent(examine.LEAST_SUCCESS),
    "least image rate": percent(examine.LEAST_RATE),
    "largest shift": f"{examine.LARGEST_SHIFT_PX:g}",
    "slowest gripper": f"{1000 * examine.LONGEST_ANSWER_S:g}",
}
