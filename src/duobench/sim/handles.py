"""Names to ids, once, when a simulation is built; a misspelt name fails here."""

from __future__ import annotations

from collections.abc import Iterable

import mujoco
import numpy as np
from numpy.typing import NDArray

from duobench.errors import UnknownNameError

_KINDS = {
    mujoco.mjtObj.mjOBJ_BODY: ("body", "nbody"),
    mujoco.mjtObj.mjOBJ_JOINT: ("joint", "njnt"),
    mujoco.mjtObj.mjOBJ_SITE: ("site", "nsite"),
    mujoco.mjtObj.mjOBJ_ACTUATOR: ("actuator", "nu"),
}


def names_of(model: mujoco.MjModel, kind: mujoco.mjtObj) -> list[str]:
    """Every non-empty name of one kind, in the model's order."""
    count = getattr(model, _KINDS[kind][1])
    names = (mujoco.mj_id2name(model, kind, number) for number in range(count))
    return [name for name in names if name]


def resolve(model: mujoco.MjModel, kind: mujoco.mjtObj, name: str) -> int:
    """Id of a named element.

    Raises:
        UnknownNameError: No element of that kind has the name; near misses are listed.
    """
    number = mujoco.mj_name2id(model, kind, name)
    if number < 0:
        raise UnknownNameError(_KINDS[kind][0], name, names_of(model, kind))
    return number


def resolve_all(
    model: mujoco.MjModel, kind: mujoco.mjtObj, names: Iterable[str]
) -> NDArray[np.int64]:
    """Ids of several named elements, in the order of the names."""
    return np.array([resolve(model, kind, name) for name in names], dtype=np.int64)
