"""Prop: an object that a task puts on the table, as a small tree of rigid parts."""

import hashlib
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

import msgspec

from duobench.core.errors import FabricationError, TaskError, UnknownNameError
from duobench.core.spatial import SE3
from duobench.world.objects.shapes import Shape
from duobench.world.objects.solid import Solid

T = TypeVar("T")

MOST_TURNED = 4 * math.tau
"""Largest angle of a hinge, in radians: a knob turns a few times, and 90 was meant in degrees."""


class Built(Generic[T]):
    """A field given as a value, or as a function that is called when the value is first read.

    So describing an object computes no geometry.
    """

    def __init__(self, kind: type[T], default: Callable[[], T] | None = None) -> None:
        self._kind, self._default = kind, default

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __set__(self, instance: object, value: T | Callable[[], T]) -> None:
        if not callable(value):
            self._check(instance, value)
        vars(instance)[self._name] = value

    def __get__(self, instance: object | None, owner: type) -> T:
        if instance is None:
            if self._default is None:
                raise AttributeError(self._name)
            return self._default  # type: ignore[return-value] - each instance calls it
        value: Any = vars(instance)[self._name]
        if callable(value):
            value = value()
            self._check(instance, value)
            vars(instance)[self._name] = value
        return value

    def _check(self, instance: object, value: object) -> None:
        if not isinstance(value, self._kind):
            is_shape = isinstance(value, Shape)
            raise TaskError(
                f"The {self._name} of {vars(instance)['name']!r} is a {self._kind.__name__}, or a "
                f"function that makes one; got a {type(value).__name__}."
                + (
                    " A shape alone is Solid(shapes=(shape,), rgba=RED)."
                    if is_shape
                    else ""
                )
            )


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

    def __post_init__(self) -> None:
        low, high = self.limits
        if not -MOST_TURNED <= low < high <= MOST_TURNED:
            raise TaskError(
                "The limits of a hinge are two angles in radians, the smaller one first, within "
                f"{MOST_TURNED:.1f} of 0; got {self.limits}."
            )


@dataclass(frozen=True, kw_only=True)
class Part:
    """A rigid part that hangs on another one."""

    name: str
    """Name within the prop; the body is called `<prop>/<name>`, and so is its hinge."""
    solid: Built[Solid] = Built(Solid)
    """Solid in the part's own frame; may be given as a function that makes it."""
    pose: SE3 = field(default_factory=SE3)
    """Pose in the frame of the part that carries it, at hinge angle zero."""
    hinge: Hinge | None = None
    """Hinge, or None for a part that is fixed to its carrier."""
    print_turn: SE3 = field(default_factory=SE3)
    """Rotation from the part's frame to the printer's, whose z points up."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Variant:
    """Variant of a prop: the shapes of its root part that it leaves out."""

    without_shapes: frozenset[int] = frozenset()
    """Numbers of the solid's shapes that cannot be felt."""
    without_images: frozenset[int] = frozenset()
    """Numbers of the solid's images that cannot be seen."""
    printed: Solid | None = None
    """The root part as it is printed; None for the whole solid, where no shapes are left out."""


@dataclass(frozen=True, kw_only=True)
class Prop:
    """A named object of a task."""

    name: str
    """Name of the body; unique in the task."""
    solid: Built[Solid] = Built(Solid)
    """The root part, in the prop's own frame; may be given as a function that makes it."""
    parts: tuple[Part, ...] = ()
    """Further parts, each carried by the root."""
    fixed: bool = False
    """Whether it stands still wherever the layout puts it, as if screwed to the table."""
    choice: str | None = None
    """Name of the layout's variant that decides which of its shapes are there, if any does."""
    variants: Built[Mapping[str, Variant]] = Built(Mapping, dict)
    """Omissions for each value of that variant; may be given as a function."""
    print_turn: SE3 = field(default_factory=SE3)
    """Rotation from the prop's frame to the printer's, whose z points up; pieces have their own."""

    def prints(self, variants: Mapping[str, str]) -> tuple[Solid, ...]:
        """Parts to print for a layout: the root part, then the others.

        Args:
            variants: Those of the layout, `Layout.variants`.

        Raises:
            UnknownNameError: They lack a value of the prop's choice.
            FabricationError: The variant leaves out shapes, and has nothing to print without them.
        """
        root = None
        if self.choice is not None:
            value = variants.get(self.choice)
            if value is None or value not in self.variants:
                raise UnknownNameError(f"variant of {self.name}", value, self.variants)
            root = self.variants[value].printed
            if root is None and self.variants[value].without_shapes:
                raise FabricationError(
                    f"Variant {value!r} of {self.name!r} leaves out shapes, and does not say what "
                    "is printed: give it `printed`, the solid without them."
                )
        return (root or self.solid, *(part.solid for part in self.parts))

    def part_name(self, part: str) -> str:
        """Full name of a part's body and hinge."""
        return f"{self.name}/{part}"


def digest_of(props: Iterable[Prop]) -> str:
    """SHA-256 of all that objects are in a simulation, whatever that was read from."""
    content = [
        [
            prop.name,
            prop.fixed,
            prop.choice,
            dict(prop.variants),
            prop.solid,
            [[part.name, part.pose, part.hinge, part.solid] for part in prop.parts],
        ]
        for prop in props
    ]
    data = msgspec.msgpack.encode(
        content, enc_hook=lambda array: [array.shape, array.tobytes()]
    )
    return hashlib.sha256(data).hexdigest()
