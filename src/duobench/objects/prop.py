"""A prop: what a task puts on the table, as a small tree of rigid parts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from duobench.errors import UnknownNameError
from duobench.objects.solid import Solid
from duobench.spatial import SE3


@dataclass(frozen=True, kw_only=True, slots=True)
class Hinge:
    """A spring-loaded hinge between a part and the one that carries it."""

    axis: tuple[float, float, float]
    """Axis in the part's frame, through its origin; the angle grows counter-clockwise about it."""
    limits: tuple[float, float]
    """Range in radians."""
    stiffness: float = 0.0
    """Spring in N·m/rad, slack at zero."""
    damping: float = 0.0
    """Viscous damping in N·m·s/rad."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Part:
    """A rigid part that hangs on another one."""

    name: str
    """Name within the prop; the body is called `<prop>/<name>`, and so is its hinge."""
    solid: Solid
    """What it is, in the part's own frame."""
    pose: SE3 = field(default_factory=SE3)
    """Pose in the frame of the part that carries it, at hinge angle zero."""
    hinge: Hinge | None = None
    """Hinge, or None for a part that is fixed to its carrier."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Variant:
    """What one variant of a prop leaves out of its root part."""

    without_shapes: frozenset[int] = frozenset()
    """Numbers of the solid's shapes that cannot be felt."""
    without_images: frozenset[int] = frozenset()
    """Numbers of the solid's images that cannot be seen."""
    printed: Solid | None = None
    """The root part as it is printed; None for the whole solid."""


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
    choice: str | None = None
    """Name of the layout's variant that decides which of its shapes are there, if any does."""
    variants: Mapping[str, Variant] = field(default_factory=dict)
    """What is left out for each value of that variant."""

    def prints(self, variants: Mapping[str, str]) -> tuple[Solid, ...]:
        """What to print for a layout: the root part, then the others.

        Args:
            variants: Those of the layout, `Layout.variants`.

        Raises:
            UnknownNameError: They lack a value of the prop's choice.
        """
        root = None
        if self.choice is not None:
            value = variants.get(self.choice)
            if value is None or value not in self.variants:
                raise UnknownNameError(f"variant of {self.name}", value, self.variants)
            root = self.variants[value].printed
        return (root or self.solid, *(part.solid for part in self.parts))

    def part_name(self, part: str) -> str:
        """Full name of a part's body and hinge."""
        return f"{self.name}/{part}"
