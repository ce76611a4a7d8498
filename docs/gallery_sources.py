"""What the images of the gallery are drawn from, kept beside them to tell when they are old.

Numbers rather than pixels: the last bit of a pixel differs from one processor to the next. What the
renderer does with the numbers is not among them, nor how the arms move between two stages.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from gallery_shots import (
    CAMERA_SIZE,
    FILM_FRAMES,
    FILM_QUALITY,
    FILM_SAMPLES,
    FILM_SIZE,
    LATER,
    LOOK,
    QUALITY,
    SAMPLES,
    STAGE_SIZE,
    START_SIZE,
    shot,
)

from duobench.tasks.task import Task
from duobench.world.looks.catalog import look
from duobench.world.scene.compose import compose
from duobench.world.sim.offscreen import VISIBLE_GROUPS

DIGITS = 9
"""Decimals that count: fewer are written by hand, and sums on two processors agree in more."""


def sources(task: Task, reached: Iterable[Sequence[int]]) -> dict[str, Any]:
    """Return what the images of a task are drawn from, the same on every machine.

    Args:
        task: The task.
        reached: Control step and stage, each time the stage rose.
    """
    sizes = {"start": START_SIZE, "camera": CAMERA_SIZE, "stage": STAGE_SIZE}
    found = {
        "shot": asdict(shot(task.id)),
        "reached": list(reached),
        "later": LATER,
        "images": {**sizes, "samples": SAMPLES, "quality": QUALITY},
        "film": {
            "size": FILM_SIZE,
            "frames": FILM_FRAMES,
            "samples": FILM_SAMPLES,
            "quality": FILM_QUALITY,
        },
        "look": look(LOOK).to_json(),
        "model": model_digest(task),
    }
    return json.loads(json.dumps(found))


def model_digest(task: Task) -> str:
    """SHA-256 of all that is drawn of a task's model: shapes, colours, lights and cameras.

    It is taken before the model is compiled, because the engine may turn a mesh as it likes.
    """
    spec = compose(task.props, task.overview)
    total = hashlib.sha256()
    drawn = [geom for geom in spec.geoms if geom.group < VISIBLE_GROUPS]
    shown = {geom.meshname for geom in drawn}
    for elements, fields in (
        (spec.bodies, "name pos quat"),
        (drawn, "name type pos quat size rgba group meshname material"),
        (spec.materials, "name rgba emission specular shininess"),
        (spec.textures, "name width height data"),
        (spec.lights, "name pos dir ambient diffuse specular castshadow"),
        (spec.cameras, "name pos quat fovy focal_length sensor_size"),
        ([spec.visual.quality], "shadowsize offsamples numslices numstacks numquads"),
        ([spec.visual.map], "shadowclip znear zfar"),
        ([spec.visual.headlight], "ambient diffuse specular"),
        ([spec.stat], "center extent"),
    ):
        for element in elements:
            values = {
                field: _plain(getattr(element, field)) for field in fields.split()
            }
            total.update(f"{values}\n".encode())
    for mesh in spec.meshes:
        if mesh.name in shown:
            # Each point once: the cut of a surface into triangles may differ, and hardly shows.
            points = {
                tuple(point) for point in _plain(np.reshape(mesh.uservert, (-1, 3)))
            }
            total.update(f"{mesh.name} {sorted(points)}\n".encode())
    return total.hexdigest()


def _plain(value: Any) -> Any:
    """Return a value of a specification as text or rounded numbers."""
    if isinstance(value, str | bytes):
        return value
    # Adding zero turns -0.0 into 0.0.
    return (np.round(np.asarray(value, dtype=np.float64), DIGITS) + 0.0).tolist()
