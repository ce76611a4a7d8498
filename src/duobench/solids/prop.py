"""A prop: what a task puts on the table, as a small tree of rigid parts."""

from __future__ import annotations

from dataclasses import dataclass, field

from duobench.solids.solid import Solid
from duobench.spatial import SE3


@dataclass(frozen=True, kw_only=True, slots=True)
class Hinge:
    """A spring-loaded hinge between a part and the one that carries it."""

    axis: tuple[float, float, float]
    """Axis in the part's frame; the joint angle grows counter-clockwise about it."""
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """A point on the axis in the part's frame, in metres."""
    limits: tuple[float, float]
    """Range in radians."""
    stiffness: float = 0.0
    """Spring in N·m/rad."""
    rest: float = 0.0
    """Angle at which the spring is slack, in radians."""
    damping: float = 0.0
    """Viscous damping in N·m·s/rad."""
    friction: float = 0.0
    """Dry friction in N·m."""
    armature: float = 0.0
    """Rotor inertia that is added to the part's, in kg·m²."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Part:
    """A rigid part that hangs on another one."""

    name: str
    """Name within the prop; the body is called `<prop>/<name>`, and so is its hinge."""
    solid: Solid
    pose: SE3 = field(default_factory=SE3)
    """Pose in the frame of the part that carries it, at hinge angle zero."""
    hinge: Hinge | None = None
    """Hinge, or None for a part that is fixed to its carrier."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Prop:
    """A named object of a task."""

    name: str
    """Name of the body; unique in the task."""
    solid: Solid
    """The root part, in the prop's own frame."""
    parts: tuple[Part, ...] = ()
    """Further parts, each carried by the root."""
    fixed: bool = False
    """Whether it stands still wherever the layout puts it, as if screwed to the table."""

    def part_name(self, part: str) -> str:
        """Full name of a part's body and hinge."""
        return f"{self.name}/{part}"
