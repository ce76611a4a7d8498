"""Definition of a task: objects, layout, stages, instruction, horizon. A task is data."""

import math
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, cast

import numpy as np

from duobench.core.errors import (
    DuoBenchError,
    LayoutError,
    TaskError,
    UnknownNameError,
    check_known,
    escaped,
)
from duobench.core.randomness import (
    EVAL,
    Choice,
    Uniform,
    generator,
)
from duobench.core.spatial import SE3
from duobench.core.types import (
    LONGEST,
    as_count,
    check_several,
    check_unit,
)
from duobench.tasks.object_state import Numbers, ObjectState, usual_numbers
from duobench.tasks.stages.progress import Stage
from duobench.world.objects.prop import Prop
from duobench.world.robot.cameras import OVERVIEW_VIEW, View
from duobench.world.sim.layout import Layout

MOST_YAW = 3 * math.pi
"""Largest yaw of a placement, in radians: a whole turn about any angle; 10 was meant in degrees."""
MAX_REJECTED = 10_000
"""Samples in a row that a task may reject before they end in an error."""


class Category(StrEnum):
    """The four kinds of coordination [paper, bimanual task taxonomy]."""

    ASYMMETRIC_SUPPORT = "asymmetric support"
    BIMANUAL_MANIPULATION = "bimanual manipulation"
    SEQUENTIAL_HANDOFF = "sequential handoff"
    PARALLEL_EXECUTION = "parallel execution"


@dataclass(frozen=True, kw_only=True, slots=True)
class Placement:
    """Start of a prop: its frame's position on the table and its turn about the vertical."""

    x: Uniform
    """Metres in the table frame."""
    y: Uniform
    """Metres in the table frame."""
    z: float = 0.0
    """Height of the prop's origin above the table top, in metres."""
    yaw: Uniform = Uniform(0.0, 0.0)
    """Radians about the vertical."""

    def __post_init__(self) -> None:
        for name, span in (("x", self.x), ("y", self.y), ("yaw", self.yaw)):
            if not isinstance(span, Uniform):  # pyright: ignore[reportUnnecessaryIsInstance]
                raise TaskError(
                    f"The {name} of a Placement is a range, such as Uniform(0.4, 0.6) or "
                    f"around(0.5, 0.1); around(0.5, 0) is one place. Got {span!r}."
                )
        turn = self.yaw.low, self.yaw.high
        check_unit("The yaw of a Placement", "radians", MOST_YAW, *turn)
        ends = self.x.low, self.x.high, self.y.low, self.y.high, self.z
        check_unit("A position in a Placement", "metres", LONGEST, *ends)

    @property
    def is_always_the_same(self) -> bool:
        """Whether every sample is the same."""
        return all(span.low == span.high for span in (self.x, self.y, self.yaw))

    def sample(self, rng: np.random.Generator) -> SE3:
        """One pose in the table frame, upright."""
        x = self.x.sample(rng)
        y = self.y.sample(rng)
        yaw = self.yaw.sample(rng)
        return SE3.at(
            x,
            y,
            self.z,
            yaw=yaw,
        )


@dataclass(frozen=True, kw_only=True, slots=True)
class Task:
    """One task of the benchmark."""

    id: str
    """Name in lower case with underscores."""
    title: str
    """Name as the paper writes it."""
    category: Category
    instruction: str
    """Instruction for a policy; `{name}` stands for a variant of the layout."""
    paraphrases: tuple[str, ...] = ()
    """The instruction in other words, for demonstrations whose instructions vary."""
    kept_paraphrases: tuple[str, ...] = ()
    """Words that no demonstration has, to ask whether a policy understands new ones."""
    horizon: int
    """Control steps after which an episode is cut off."""
    props: tuple[Prop, ...]
    placements: Mapping[str, Placement]
    """Start of each prop, unless `arrange` places it."""
    variants: Mapping[str, Choice] = field(default_factory=dict[str, Choice])
    """Named choices that belong to the layout."""
    stages: tuple[Stage, ...]
    accept: Callable[[Layout], bool] = lambda _layout: True
    """Whether a sampled layout is valid, beyond not overlapping."""
    arrange: Callable[[Layout], Layout] = lambda layout: layout
    """Adds the poses that follow from the sampled ones, such as marbles in a cup."""
    overview: View = OVERVIEW_VIEW
    """View of `render` and videos; a task whose work faces the robot needs one of its own."""
    object_numbers: tuple[Numbers, ...] | None = None
    """Numbers of its object state; None takes those that `duobench.tasks.object_state`
    describes."""
    expert: str | None = None
    """Import path `module:attribute` of its expert's script, such as "my_task:script"."""
    printable: bool = False
    """Whether its objects can be printed."""
    real: bool = False
    """Whether the paper rebuilt it on the real robot."""

    def __post_init__(self) -> None:
        check_several(f"`props` of task {self.id!r}", self.props, Prop)
        check_several(f"`stages` of task {self.id!r}", self.stages, Stage)
        _check_named(f"`placements` of task {self.id!r}", self.placements, Placement)
        _check_named(f"`variants` of task {self.id!r}", self.variants, Choice)
        stages = [
            text for stage in self.stages for text in (stage.name, stage.instruction)
        ]
        words = (*self.instructions, *self.kept_paraphrases)
        for text in (self.id, self.title, *words, *stages):
            if text != escaped(text):
                raise DuoBenchError(
                    f"The texts of task {self.id!a} are printable, got {text!a}."
                )
        for text in (*words, *(stage.instruction for stage in self.stages)):
            _check_fields(text)
        if as_count(self.horizon) is None:
            raise TaskError(
                f"The horizon of task {self.id!r} is a whole number of control steps from 1 on, "
                f"got {self.horizon!r}."
            )
        names = [prop.name for prop in self.props]
        twice = [name for name, count in Counter(names).items() if count > 1]
        if twice:
            raise TaskError(
                f"Task {self.id!r} has several props called {', '.join(map(repr, twice))}; give "
                "each a name of its own."
            )
        for name in self.placements:
            check_known("prop in placements", name, names)
        if not self.stages:
            raise DuoBenchError(f"Task {self.id!r} needs at least one stage.")

    @property
    def max_stage(self) -> int:
        """Number of the last stage."""
        return len(self.stages)

    @property
    def instructions(self) -> tuple[str, ...]:
        """The instruction, which is number 0, and its paraphrases."""
        return (self.instruction, *self.paraphrases)

    @property
    def object_state(self) -> ObjectState:
        """State of all objects as numbers; see `duobench.tasks.object_state`."""
        numbers = self.object_numbers
        if numbers is None:
            placed = self.placements
            still = {
                prop.name for prop in self.props if prop.fixed and prop.name in placed
            }
            still = {name for name in still if placed[name].is_always_the_same}
            numbers = usual_numbers(self.props, still, self.variants)
        return ObjectState(parts=numbers)

    def layouts(self, seed: int, split: str = EVAL) -> Iterator[Layout]:
        """Candidate layouts without end, a pure function of (task, suite version, split, seed).

        Raises:
            UnknownNameError: There is no such split.
            LayoutError: The task accepts none of its own samples, or leaves a prop unplaced.
        """
        rng = generator(self.id, seed, split)
        rejected = 0
        while rejected < MAX_REJECTED:
            sampled = Layout(
                poses={name: p.sample(rng) for name, p in self.placements.items()},
                variants={
                    name: choice.sample(rng) for name, choice in self.variants.items()
                },
            )
            layout = self.arranged(sampled)
            rejected += 1
            if self.accept(layout):
                rejected = 0
                yield layout
        raise LayoutError(
            f"Task {self.id!r} accepts none of {MAX_REJECTED} samples in a row; loosen `accept` or "
            "widen the placements."
        )

    def arranged(self, sampled: Layout) -> Layout:
        """A layout with the poses that follow from the sampled ones.

        Raises:
            LayoutError: It leaves a prop unplaced.
        """
        needed = {prop.name for prop in self.props}
        try:
            layout = self.arrange(sampled)
            if not isinstance(layout, Layout):  # pyright: ignore[reportUnnecessaryIsInstance]
                raise LayoutError(
                    f"`arrange` of task {self.id!r} returns no Layout, but {layout!r}."
                )
            missing = needed - layout.poses.keys()
            if not missing:
                return layout
        except KeyError as error:  # `arrange` may need the pose of a prop that has none
            missing = needed & {error.args[0]}
            if not missing:
                raise
        raise LayoutError(
            f"Task {self.id!r} has no placement for {', '.join(map(repr, sorted(missing)))}. "
            "Give each prop one, or have `arrange` add its pose."
        )

    def instruct(self, layout: Layout, number: int = 0) -> str:
        """The instruction for a layout.

        Args:
            layout: How the episode begins.
            number: Which of `instructions`.

        Raises:
            UnknownNameError: It names a variant that the layout lacks.
        """
        return _filled(self.instructions[number], layout)

    def subinstructions(self, layout: Layout) -> dict[int, str]:
        """Instruction at each stage 0 to n-1 to reach the next one.

        Raises:
            UnknownNameError: An instruction names a variant that the layout lacks.
        """
        return {
            n: _filled(stage.instruction, layout) for n, stage in enumerate(self.stages)
        }


def _check_named(
    what: str,
    named: object,
    kind: type,
) -> None:
    if not isinstance(named, Mapping):
        raise TaskError(f"{what} is a dict by name, got a {type(named).__name__}.")
    for name, value in cast("Mapping[Any, Any]", named).items():
        check_several(f"{what}, {name!r},", [value], kind)


def _check_fields(instruction: str) -> None:
    try:
        instruction.format_map(defaultdict[str, str](str))
    except (ValueError, AttributeError, IndexError) as error:
        raise TaskError(
            f"The instruction {instruction!r} cannot be filled in: write {{name}} for a variant of "
            "the layout, and {{ or }} for a brace."
        ) from error


def _filled(instruction: str, layout: Layout) -> str:
    try:
        return instruction.format(**layout.variants)
    except KeyError as error:
        known = layout.variants
        raise UnknownNameError(
            "variant in an instruction", error.args[0], known
        ) from error
