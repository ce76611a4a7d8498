"""Layouts: the initial state of an episode, as a value."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np

from duobench.core.errors import LayoutError
from duobench.core.spatial import SE3


@dataclass(frozen=True, kw_only=True, slots=True)
class Layout:
    """Initial state of an episode; it is stored with it and can be given instead of a seed."""

    poses: Mapping[str, SE3]
    """Pose of every prop in the table frame."""
    variants: Mapping[str, str] = field(default_factory=dict)
    """Named choices, such as which cup holds the marbles."""

    def __post_init__(self) -> None:
        for name, pose in self.poses.items():
            if not (
                np.isfinite(pose.rotation).all() and np.isfinite(pose.translation).all()
            ):
                raise LayoutError(
                    f"The pose of {name!r} is not finite: {pose.tquat.tolist()}."
                )

    def to_json(self) -> dict[str, Any]:
        """Return plain data: poses as x y z qx qy qz qw."""
        return {
            "poses": {
                name: [float(v) for v in pose.tquat]
                for name, pose in self.poses.items()
            },
            "variants": dict(self.variants),
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Self:
        """Read the result of `to_json`."""
        try:
            poses = {
                name: SE3.from_tquat(values) for name, values in data["poses"].items()
            }
            return cls(poses=poses, variants=dict(data.get("variants", {})))
        except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
            raise LayoutError(
                f"This is no layout: {error!r}. A layout is "
                '{"poses": {object: [x, y, z, qx, qy, qz, qw]}, "variants": {name: value}}.'
            ) from error
