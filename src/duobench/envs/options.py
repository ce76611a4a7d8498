"""The options of `duobench.make` and `duobench.make_vec`, as editors complete them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypedDict

if TYPE_CHECKING:
    from duobench.looks.look import Look
    from duobench.shifts.shift import Shift


class EnvOptions(TypedDict, total=False):
    """What `EnvConfig.from_options` takes, which says more of each, and Gymnasium's time limit."""

    cameras: bool | str | Iterable[str]
    image_size: int | Sequence[int]
    object_state: bool
    action_mode: str
    binary_gripper: bool
    chunk: int | None
    horizon: int | None
    instructions: str
    split: str
    speed_fraction: float
    control_rate_hz: float
    render_mode: str | None
    render_size: int | Sequence[int]
    look: str | Look | Mapping[str, Any]
    shift: str | Shift | Mapping[str, Any]
    max_episode_steps: int
