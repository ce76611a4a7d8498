"""Options of an environment, and about one of its resets."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Self

from duobench.core.backend import (
    DEPTH,
    SEGMENTATION,
    Wanted,
)
from duobench.core.errors import (
    OptionError,
    UnknownNameError,
    UnknownOptionError,
    check_known,
    escaped,
)
from duobench.core.randomness import EVAL, SPLITS
from duobench.core.types import (
    as_count,
    as_flag,
    as_size,
    as_whole,
)
from duobench.envs import action_modes
from duobench.envs.camera_options import (
    CAMERA_OPTIONS,
    camera_options,
    name_of,
    wanted_images,
)
from duobench.envs.rewards import REWARDS, STAGE
from duobench.tasks.shifts.shift import NO_SHIFT, Shift
from duobench.world.looks.catalog import DEFAULT, as_look
from duobench.world.looks.look import Look
from duobench.world.robot.cameras import (
    HEAD,
    NATIVE_HEIGHT,
    NATIVE_WIDTH,
    POLICY_CAMERAS,
    Camera,
)
from duobench.world.robot.frames import Robot, other_robot, robot_with
from duobench.world.robot.gripper import DEFAULT_GRIPPER
from duobench.world.robot.joints import check_speed_fraction
from duobench.world.robot.mounts import DEFAULT_MOUNT

RENDER_MODES = ("rgb_array",)
RENDERED = "rgb_array gives images; duobench view bin_sort shows the task in a browser."
FIXED, VARIED = "fixed", "varied"
INSTRUCTIONS = (FIXED, VARIED)
IMAGE_SIZE = (224, 224)
"""Default height and width of an image in an observation, in pixels."""
RENDER_SIZE = (480, 640)
"""Default height and width of the image that `render` gives, in pixels."""
ELSEWHERE = {
    **dict.fromkeys(
        ("num_envs", "n_envs"),
        'duobench.make_vec("bin_sort", num_envs=4) makes several environments.',
    ),
    "seed": "A seed is given to reset: env.reset(seed=0).",
    "headless": "No window is opened; images are rendered offscreen.",
    "max_steps": "The number of steps is horizon, such as horizon=300.",
}
"""Options here in place of those of other environments."""


@dataclass(frozen=True, kw_only=True, slots=True)
class EnvConfig:
    """Configuration of an environment; the defaults are the evaluation protocol.

    Plain data: it is written into every record and compared with what a policy expects.
    """

    cameras: tuple[str | Camera, ...] = POLICY_CAMERAS
    """Cameras that the observation shows: names of the robot's, and cameras of one's own."""
    image_size: tuple[int, int] = IMAGE_SIZE
    """Height and width of their images in pixels; at most 720 x 1280."""
    image_sizes: Mapping[str, tuple[int, int]] = field(default_factory=dict, hash=False)
    """Height and width by camera, of those with another size than `image_size`."""
    depth: tuple[str, ...] = ()
    """Cameras, with or without images among `cameras`, whose depth the observation holds."""
    segmentation: tuple[str, ...] = ()
    """Cameras whose pixels the observation names the parts of, as `env.segmentation_ids`."""
    object_state: bool = False
    """Whether the observation holds `environment_state`, the privileged numbers of the objects."""
    flat_obs: bool = False
    """Whether the observation is a `Dict` of one level, with `head_image` instead of `pixels`, as
    libraries of reinforcement learning take it; policies of the benchmark take the nested one."""
    action_mode: str = action_modes.JOINT.name
    """One of `ACTION_MODES`."""
    binary_gripper: bool = False
    """Whether openings are rounded to open or closed."""
    chunk: int | None = None
    """Actions in one step, as an array (chunk, n); None takes single actions (n,)."""
    horizon: int | None = None
    """Control steps after which an episode is truncated; None takes the task's."""
    instructions: str = FIXED
    """Which instruction policies get: the task's ("fixed"), or in each episode one that is sampled
    from it and the task's paraphrases ("varied")."""
    reward: str = STAGE
    """Reward of a step: stage / last stage, as in the paper ("stage"), or what the step adds to it
    ("progress"), or to that and how near the next stage is ("dense"). With "stage", waiting before
    the last stage returns more than finishing: train with one of the others."""
    split: str = EVAL
    """Layouts that resets sample from: "eval", or "train" for demonstrations."""
    speed_fraction: float = 1.0
    """Part of the joints' speed limits that simulated arms use: below 1, they keep the slower
    limits of real arms, of which a rig's file says the fraction, and 0.05 rad of distance from the
    ends of the joints' ranges. Actions and spaces stay as they are; targets beyond are clipped."""
    gripper: str = DEFAULT_GRIPPER
    """Gripper on both arms, one of `GRIPPERS`, or the path "module:ATTRIBUTE" of one's own."""
    mount: str = DEFAULT_MOUNT
    """Mounting of the arms, one of `MOUNTS`."""
    render_mode: str | None = None
    """ "rgb_array", for `render`."""
    render_size: tuple[int, int] = RENDER_SIZE
    """Height and width of the image that `render` gives, in pixels; at most 720 x 1280."""
    look: str | Look = DEFAULT
    """How images look: a name of `duobench.world.looks.catalog.look`, or a look of one's own."""
    shift: Shift = NO_SHIFT
    """Shift from the usual episodes; see the page robustness."""

    def __post_init__(self) -> None:
        action_modes.get(self.action_mode)
        robot_with(self.gripper, self.mount)
        check_known("split", self.split, SPLITS)
        check_known("kind of instructions", self.instructions, INSTRUCTIONS)
        check_known("reward", self.reward, REWARDS)
        if self.render_mode is not None and self.render_mode not in RENDER_MODES:
            raise UnknownNameError(
                f"Unknown render mode {self.render_mode!r}. {RENDERED}"
            )
        for name in _FLAGS:
            value = getattr(self, name)
            if not isinstance(value, bool):
                raise OptionError(f"{name} is True or False, got {value!r}.")
        if not isinstance(self.speed_fraction, int | float):
            raise OptionError(
                f"speed_fraction is a number, got {self.speed_fraction!r}."
            )
        check_speed_fraction(self.speed_fraction)
        _check_size("image_size", self.image_size)
        _check_cameras(self)
        _check_size("render_size", self.render_size)
        _check_count("chunk", self.chunk)
        _check_count("horizon", self.horizon)
        if not isinstance(self.look, Look | str):
            raise OptionError(
                f"A look is a name, a Look or its JSON form; got {self.look!r}."
            )
        as_look(self.look)
        if not isinstance(self.shift, Shift):
            raise OptionError(
                f"A shift is a Shift, its name or its fields; got {self.shift!r}."
            )

    @property
    def robot(self) -> Robot:
        """Description of the arms."""
        return robot_with(self.gripper, self.mount)

    @property
    def other_robot(self) -> str:
        """Gripper and mount that are not the paper's, in a word; empty where both are."""
        return other_robot(self.gripper, self.mount)

    @property
    def camera_names(self) -> tuple[str, ...]:
        """Names of the cameras that the observation shows."""
        return tuple(map(name_of, self.cameras))

    @property
    def wanted(self) -> Wanted:
        """Images of an observation, by their kind; a kind that is not asked for is not there."""
        return wanted_images(
            self.cameras,
            self.depth,
            self.segmentation,
            self.image_size,
            self.image_sizes,
        )

    @classmethod
    def from_options(cls, options: Mapping[str, Any]) -> Self:
        """Make a configuration of keyword arguments, which may be looser than the fields.

        Args:
            options: Values of the fields by name. `cameras` may also be True (all), False (none),
                one camera or several in their order, or sizes by name; `depth` and `segmentation`
                True (all of `cameras`, or of the robot's where there are none), False, or names; a
                size one number for a square; `look` and a camera the JSON form of one; `shift` a
                name such as "look-3", or the JSON form. Numbers may be NumPy's, and a size a list.

        Raises:
            UnknownOptionError: There is no such option.
            UnknownNameError: There is no such camera, mode, split or look.
            OptionError: A value is invalid.
        """
        known = [field.name for field in fields(cls)]
        what = "option: unexpected keyword argument"  # in Python's words
        for name in options:
            if name in ELSEWHERE:
                raise UnknownOptionError(f"Unknown {what} {name!r}. {ELSEWHERE[name]}")
            if name not in known:
                raise UnknownOptionError(what, name, known)
        values = {
            name: value for name, value in options.items() if name not in CAMERA_OPTIONS
        }
        for name in _FORMS.keys() & values.keys():
            values[name] = _FORMS[name](values[name])
        return cls(**values, **camera_options(options))


def _size(value: Any) -> Any:
    return as_size(value) or value


def _number(value: Any) -> Any:
    return value if (number := as_whole(value)) is None else number


def _look(value: Any) -> Any:
    return as_look(value) if isinstance(value, Mapping) else value


def _shift(value: Any) -> Any:
    if isinstance(value, Mapping):
        for name in value:
            check_known(
                "field of a shift", str(name), [field.name for field in fields(Shift)]
            )
        return Shift(**value)
    return Shift.parse(value) if isinstance(value, str) else value


_FLAGS = ("object_state", "flat_obs", "binary_gripper")
_FORMS: Mapping[str, Callable[[Any], Any]] = {
    "image_size": _size,
    "render_size": _size,
    **dict.fromkeys(_FLAGS, as_flag),
    "chunk": _number,
    "horizon": _number,
    "look": _look,
    "shift": _shift,
}
"""Functions that give a looser value the form of its field, and leave anything else as it is."""


_SIZED = {HEAD: (128, 128)}
"""Sizes by name, for messages."""


def _check_cameras(config: EnvConfig) -> None:
    if not isinstance(config.cameras, tuple):
        raise OptionError(
            "cameras is True, False, a camera, a list of them, or sizes by name, such as "
            f"{_SIZED}; got {config.cameras!r}."
        )
    for name in (DEPTH, SEGMENTATION):
        value = getattr(config, name)
        if not isinstance(value, tuple):
            raise OptionError(
                f"{name} is True, False, the name of a camera, or a list of names; got {value!r}."
            )
        if any(isinstance(camera, Camera) for camera in value):
            raise OptionError(
                f"{name} takes names; a camera of one's own stands in cameras, and {name} has its "
                f"name; got {value!r}."
            )
    if not isinstance(config.image_sizes, Mapping):
        raise OptionError(
            f"image_sizes is sizes by the name of a camera, such as {_SIZED}; got "
            f"{config.image_sizes!r}."
        )
    for name, size in config.image_sizes.items():
        _check_size(f"The size of camera {name!r}", size)
    _ = config.wanted  # rejects unknown names, and one name of two cameras


def _check_size(name: str, value: Any) -> None:
    is_size = isinstance(value, tuple) and all(isinstance(part, int) for part in value)
    if (
        not (is_size and as_size(value))
        or value[0] > NATIVE_HEIGHT
        or value[1] > NATIVE_WIDTH
    ):
        raise OptionError(
            f"{name} is (height, width) in pixels, at most {(NATIVE_HEIGHT, NATIVE_WIDTH)}, or one "
            f"number for a square; got {value!r}."
        )


def _check_count(name: str, value: Any) -> None:
    if value is not None and not (isinstance(value, int) and as_count(value)):
        raise OptionError(f"{name} is a positive whole number, got {value!r}.")


LAYOUT, LAYOUT_SEED, SPLIT, LOOK = "layout", "layout_seed", "split", "look"
INSTRUCTION = "instruction"
OF_SIMULATION = (LAYOUT, LAYOUT_SEED, SPLIT, LOOK, INSTRUCTION)
"""Options of a reset in simulation; see `SimEnv`."""
OF_OTHERS = ("lerobot_new_rollout",)
"""Options that programs pass to every environment, and that ours ignores."""


SEEDS_END = 2**63
"""Seeds are below it: vector environments of Gymnasium put them into info as 64 bits."""


def checked_seed(seed: Any) -> int | None:
    """The seed of a reset as an integer; NumPy's integers are taken too."""
    if seed is None:
        return None
    number = as_whole(seed)
    if number is None or number < 0:
        raise OptionError(f"A seed is a whole number from 0 on, got {seed!r}.")
    if number >= SEEDS_END:
        raise OptionError(f"A seed is below 2**63, got {seed!r}.")
    return number


def checked_reset_options(
    options: Any, known: Collection[str] | None = None
) -> dict[str, Any]:
    """The options of a reset as a new dict, all of them among `known`, if that is given."""
    if options is not None and not isinstance(options, Mapping):
        raise OptionError(f"The options of a reset are a dict, got {options!r}.")
    given = {
        name: value for name, value in (options or {}).items() if name not in OF_OTHERS
    }
    if known is not None:
        for name in given:
            if name == "seed":
                raise UnknownNameError(
                    f"Unknown option of a reset 'seed'. {ELSEWHERE[name]}"
                )
            check_known("option of a reset", name, known)
    return given


def checked_instruction(value: Any, count: int) -> int | str:
    """The instruction of an episode: text, or the number of one of the task's `count`.

    Number 0, and None, are the task's own; the others are its paraphrases.
    """
    if isinstance(value, str):
        if value.strip() and value == escaped(value):
            return value
        raise OptionError(f"An instruction is text that can be printed, got {value!a}.")
    number = 0 if value is None else as_whole(value)
    if number is None or not 0 <= number < count:
        raise OptionError(
            f"An instruction is text, or a number from 0 to {count - 1}: the task's own and its "
            f"paraphrases; got {value!r}."
        )
    return number
