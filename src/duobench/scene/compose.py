"""Compose the whole model: options, workcell, robot, cameras, and a task's props."""

from __future__ import annotations

from collections.abc import Iterable

import mujoco

from duobench.errors import DuoBenchError
from duobench.objects.prop import Prop
from duobench.robot.cameras import NATIVE_HEIGHT, NATIVE_WIDTH, OVERVIEW_VIEW, View
from duobench.robot.workcell import FLOOR_Z, ROOM_HEIGHT, ROOM_X, ROOM_Y
from duobench.scene.cameras import add_head_camera, add_overview_camera
from duobench.scene.props import add_prop
from duobench.scene.robot.arms import add_robot
from duobench.scene.workcell import SCENE_CENTRE, SCENE_EXTENT, add_workcell
from duobench.types import CONTROL_HZ

SUBSTEPS = 16
"""Physics steps in one control step."""
TIMESTEP = 1.0 / (CONTROL_HZ * SUBSTEPS)
"""Physics time step in seconds, 1/480."""
MEMORY_BYTES = 32 * 2**20
"""Arena for contacts and constraints; twenty marbles in a cup need about a tenth of it."""
SHADOW_MAP_SIZE = 704
"""Side of the shadow map in texels; together with its reach, 2.5 mm a texel, about a pixel of a
square wrist image. Rendering the map is the slowest part of an image on a processor."""
SHADOW_REACH = 0.62
"""Half the side of the shadow map as a share of the scene's extent: table and arms."""
BALL_SLICES, BALL_STACKS = 12, 6
"""Fineness of balls in images, 120 triangles: twenty marbles must not cost as much as the robot."""


def compose(props: Iterable[Prop] = (), overview: View = OVERVIEW_VIEW) -> mujoco.MjSpec:
    """Build the model's specification.

    Args:
        props: The task's objects, each with a unique name.
        overview: What the camera for people sees.

    Returns:
        A specification that is ready to be compiled. Body, joint and geom names are those of
        `scene.naming` and of the props.

    Raises:
        DuoBenchError: Two props share a name, or the overview is seen from outside the room.
    """
    _check_in_room(overview)
    spec = mujoco.MjSpec()
    spec.modelname = "duobench"
    spec.compiler.degree = False
    spec.memory = MEMORY_BYTES
    spec.option.timestep = TIMESTEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    # Elliptic cones with a high impedance ratio keep grasped objects from creeping out of the
    # pads; they are also what the published gripper model asks for.
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 10.0
    # A diverged simulation must be reported, not silently reset by the engine.
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    spec.stat.center, spec.stat.extent = SCENE_CENTRE, SCENE_EXTENT
    spec.visual.quality.shadowsize = SHADOW_MAP_SIZE
    spec.visual.quality.offsamples = 0
    # Lights are far away and highlights soft, so one quad a side looks the same as many.
    spec.visual.quality.numquads = 1
    spec.visual.quality.numslices = BALL_SLICES
    spec.visual.quality.numstacks = BALL_STACKS
    spec.visual.map.shadowclip = SHADOW_REACH
    # Properties of the offscreen buffer, large enough for a native image.
    getattr(spec.visual, "global").offwidth = NATIVE_WIDTH
    getattr(spec.visual, "global").offheight = NATIVE_HEIGHT
    spec.visual.map.znear = 0.01
    spec.visual.map.zfar = 5.0
    add_workcell(spec)
    add_robot(spec)
    add_head_camera(spec.worldbody)
    add_overview_camera(spec.worldbody, overview)
    seen: set[str] = set()
    for prop in props:
        if prop.name in seen:
            raise DuoBenchError(f"Two props are called {prop.name!r}; give each its own name.")
        seen.add(prop.name)
        add_prop(spec, prop)
    return spec


def _check_in_room(view: View) -> None:
    """Reject an eye outside: walls and ceiling would be seen from behind, or not at all."""
    room = {"x": ROOM_X, "y": ROOM_Y, "z": (FLOOR_Z, FLOOR_Z + ROOM_HEIGHT)}
    if not all(low < at < high for at, (low, high) in zip(view.eye, room.values(), strict=True)):
        ends = ", ".join(f"{axis} {low:.2f} to {high:.2f}" for axis, (low, high) in room.items())
        raise DuoBenchError(
            f"A camera for people stands inside the room ({ends} m); the eye {view.eye} does not."
        )
