"""What can be chosen about an environment, and what was chosen about this one."""

from __future__ import annotations

import operator
from collections.abc import Hashable, Iterable, Mapping
from dataclasses import dataclass, fields
from typing import Any

from duobench.envs import action_modes
from duobench.errors import OptionError, check_known
from duobench.randomness import EVAL, SPLITS
from duobench.scene.cameras import NATIVE_HEIGHT, NATIVE_WIDTH
from duobench.scene.look import Look
from duobench.scene.looks import DEFAULT, as_look
from duobench.types import CONTROL_HZ, POLICY_CAMERAS

RENDER_MODES = ("rgb_array",)
IMAGE_SIZE = (224, 224)
"""Default height and width of an image in an observation, in pixels."""
RENDER_SIZE = (480, 640)
"""Default height and width of the image that `render` gives, in pixels."""


@dataclass(frozen=True, kw_only=True, slots=True)
class EnvConfig:
    """Configuration of an environment; the defaults are the evaluation protocol.

    Plain data: it is written into every record and compared with what a policy expects.
    """

    cameras: tuple[str, ...] = POLICY_CAMERAS
    """Cameras that the observation shows."""
    image_size: tuple[int, int] = IMAGE_SIZE
    """Height and width of their images in pixels; at most 720 x 1280."""
    action_mode: str = action_modes.JOINT.name
    """One of `ACTION_MODES`."""
    binary_gripper: bool = False
    """Whether openings are rounded to open or closed."""
    chunk: int | None = None
    """Actions in one step, as an array (chunk, n); None takes single actions (n,)."""
    horizon: int | None = None
    """Control steps after which an episode is truncated; None takes the task's."""
    split: str = EVAL
    """Layouts that resets sample from: "eval", or "train" for demonstrations."""
    control_rate_hz: float = CONTROL_HZ
    """Control steps a second; there is one rate."""
    render_mode: str | None = None
    """ "rgb_array", for `render`."""
    render_size: tuple[int, int] = RENDER_SIZE
    """Height and width of the image that `render` gives, in pixels; at most 720 x 1280."""
    look: str | Look = DEFAULT
    """How images look: a name of `duobench.scene.looks.look`, or a look of one's own."""

    def __post_init__(self) -> None:
        """Reject invalid values; give looser ones, see `from_options`, the form of their field."""
        action_modes.get(self.action_mode)
        check_known("split", self.split, SPLITS)
        if self.render_mode is not None:
            check_known("render mode", self.render_mode, RENDER_MODES)
        if not isinstance(self.binary_gripper, Hashable) or self.binary_gripper not in (0, 1):
            raise OptionError(f"binary_gripper is True or False, got {self.binary_gripper!r}.")
        if self.control_rate_hz != CONTROL_HZ:
            raise OptionError(f"The control rate is {CONTROL_HZ:g} Hz, got {self.control_rate_hz}.")
        look = as_look(self.look)
        values = {
            "cameras": _cameras(self.cameras),
            "image_size": _size("image_size", self.image_size),
            "render_size": _size("render_size", self.render_size),
            "binary_gripper": bool(self.binary_gripper),
            "chunk": _count("chunk", self.chunk),
            "horizon": _count("horizon", self.horizon),
            "look": self.look if isinstance(self.look, str) else look,
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)

    @staticmethod
    def from_options(options: Mapping[str, Any]) -> EnvConfig:
        """From keyword arguments, which may be looser than the fields.

        Args:
            options: Values of the fields by name. `cameras` may also be True (all), False (none),
                one name or any iterable of names; `image_size` one number for a square; `look`
                the JSON form of one. Whole numbers may be NumPy's.

        Raises:
            UnknownNameError: There is no such option, camera, mode, split or look.
            OptionError: A value is invalid.
        """
        known = [field.name for field in fields(EnvConfig)]
        for name in options:
            check_known("option", name, known)
        return EnvConfig(**options)


def checked_seed(seed: Any) -> int | None:
    """The seed of a reset as an integer; NumPy's integers are taken too.

    Raises:
        OptionError: It is no whole number, or negative.
    """
    if seed is None:
        return None
    number = _whole(seed)
    if number is None or number < 0:
        raise OptionError(f"A seed is a whole number from 0 on, got {seed!r}.")
    return number


def checked_reset_options(options: Any) -> dict[str, Any]:
    """The options of a reset as a new dict.

    Raises:
        OptionError: They are no mapping.
    """
    if options is not None and not isinstance(options, Mapping):
        raise OptionError(f"The options of a reset are a dict, got {options!r}.")
    return dict(options or {})


def _cameras(value: Any) -> tuple[str, ...]:
    if isinstance(value, bool):
        return POLICY_CAMERAS if value else ()
    if not isinstance(value, Iterable):
        raise OptionError(
            f"cameras is True, False, the name of a camera or several; got {value!r}."
        )
    names = (value,) if isinstance(value, str) else tuple(value)
    for name in names:
        check_known("camera", name, POLICY_CAMERAS)
    return names


def _size(name: str, value: Any) -> tuple[int, int]:
    is_square = name == "image_size" and _whole(value) is not None
    pixels = (value, value) if is_square else value
    if isinstance(pixels, (tuple, list)):
        match [_whole(part) for part in pixels]:
            case [int(height), int(width)] if (
                0 < height <= NATIVE_HEIGHT and 0 < width <= NATIVE_WIDTH
            ):
                return height, width
    square = ", or one number for a square" if name == "image_size" else ""
    raise OptionError(
        f"{name} is (height, width) in pixels, at most {(NATIVE_HEIGHT, NATIVE_WIDTH)}{square}; "
        f"got {value!r}."
    )


def _count(name: str, value: Any) -> int | None:
    number = _whole(value)
    if value is not None and (number is None or number < 1):
        raise OptionError(f"{name} is a positive whole number, got {value!r}.")
    return number


def _whole(value: Any) -> int | None:
    """A whole number, Python's or NumPy's, as an int; None for anything else, also for a bool."""
    if isinstance(value, bool):
        return None
    try:
        return operator.index(value)
    except TypeError:
        return None
