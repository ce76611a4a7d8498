"""Parts of the scene that geoms belong to, as the numbers of a segmentation."""

from collections.abc import Mapping

import mujoco
import numpy as np
from numpy.typing import NDArray

from duobench.core.types import SIDES
from duobench.world.objects.segmentation import (
    ARMS,
    CAMERA,
    GRIPPERS,
    NOTHING,
    ROOM,
)
from duobench.world.scene.naming import FLOOR, gripper_name
from duobench.world.scene.workcell import world_parts
from duobench.world.sim.offscreen import FURNITURE


def labels_of(model: mujoco.MjModel, ids: Mapping[str, int]) -> NDArray[np.int32]:
    """Numbers by geom, and at the negative indices of the renderer: furniture, and nothing."""
    labels = np.full(model.ngeom - FURNITURE, NOTHING, dtype=np.int32)
    labels[FURNITURE] = ids[ROOM]
    parts = world_parts()
    for geom in range(model.ngeom):
        body = model.body(int(model.geom_bodyid[geom]))
        if body.id == 0:
            place = geom - int(body.geomadr[0])
            part = parts[place] if place < len(parts) else CAMERA
        else:
            part = _part(body.name, int(model.geom_type[geom]))
        labels[geom] = ids[part]
    return labels


def _part(body: str, kind: int) -> str:
    """Part of the scene that a geom of a kind on a body belongs to."""
    for side in SIDES:
        if body.startswith(gripper_name(side)):
            return GRIPPERS[side]
        if body.startswith(f"{side}/"):
            # Links are rendered as meshes, and the camera on the last one as boxes.
            is_box = kind == mujoco.mjtGeom.mjGEOM_BOX.value
            return CAMERA if is_box else ARMS[side]
    return ROOM if body == FLOOR else body
