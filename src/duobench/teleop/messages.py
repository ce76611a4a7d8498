"""Messages of a page: the operator's hands and requests."""

import math
import threading
from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from typing import Annotated, Literal

import msgspec

from duobench.core.errors import escaped
from duobench.core.spatial import SE3, length
from duobench.web.messages import PageMessage, SelectItem

FARTHEST = 100.0
"""Largest coordinate of a hand in metres; only differences of poses matter."""
NORM_TOLERANCE = 1e-3
"""Tolerance of the length of a quaternion."""
LONGEST_INSTRUCTION = 300
"""Characters of an instruction that an operator types."""
LONGEST_NAME = 60
"""Characters of an operator's pseudonym."""
LONGEST_QUEUE = 1024
"""Messages that may wait; beyond, the oldest are forgotten."""

PageDevice = Literal["mouse", "gamepad", "headset"]
"""Device that drives a page; keys go with the mouse."""
Share = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
"""Pressed share of a trigger, 0 to 1."""
Pose = tuple[float, float, float, float, float, float, float]
"""x y z in metres, then the quaternion w x y z."""


class Buttons(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The buttons on a hand that are pressed."""

    keep: bool = False
    discard: bool = False
    restore: bool = False
    recentre: bool = False
    """The operator moves to another place: both hands let go."""


class Hand(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One hand at one moment."""

    pose: Pose
    """Pose in the world frame or in any other that stands upright beside it."""
    sure: bool
    """Whether the device tracks it."""
    squeeze: Share
    """The clutch: how far it is squeezed."""
    trigger: Share
    """The gripper: 0 open, 1 closed."""
    buttons: Buttons = Buttons()

    def __post_init__(self) -> None:
        if not all(abs(number) <= FARTHEST for number in self.pose[:3]):
            raise ValueError(
                f"a hand is at most {FARTHEST:g} m away, got {list(self.pose[:3])}"
            )
        norm = length(self.pose[3:])
        if not abs(norm - 1.0) <= NORM_TOLERANCE:
            raise ValueError(f"a quaternion (w x y z) has length one, got {norm:g}")

    @property
    def world_from_hand(self) -> SE3:
        """Pose of the hand."""
        return SE3.from_wxyz(self.pose[3:], self.pose[:3])


class Hands(PageMessage, frozen=True):
    """Both hands at one moment."""

    sent: float
    """Time at which it was sent, in ms of the sender's clock."""
    seq: Annotated[int, msgspec.Meta(ge=0, lt=2**53)]
    """Number of the message; it grows."""
    left: Hand | None
    """The left hand; None where the device has none."""
    right: Hand | None
    devices: tuple[PageDevice, ...] = ()
    """Devices that have moved, squeezed or pressed since the message before."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.sent) and self.sent >= 0.0):
            raise ValueError(f"`sent` is a time in ms from 0 on, got {self.sent}")


class Keep(PageMessage, frozen=True):
    """Keep the episode."""


class Discard(PageMessage, frozen=True):
    """Discard the episode, and begin the next one."""


class Restore(PageMessage, frozen=True):
    """Ask again about the episode that was discarded last."""


class Hold(PageMessage, frozen=True):
    """Both hands let go and both arms stand still; any visitor of the page may say so."""


class GoOn(PageMessage, frozen=True):
    """The operator goes on after a hold in the simulation; arms of a rig go home instead."""


class Recentre(PageMessage, frozen=True):
    """The operator moves to another place: both hands let go."""


class Alone(PageMessage, frozen=True):
    """Let the world run though nobody leads, or no longer; a policy pauses, or goes on."""


class Why(PageMessage, frozen=True):
    """Reason why the last take-over of a policy began; empty for the next usual one."""

    text: Annotated[str, msgspec.Meta(max_length=LONGEST_INSTRUCTION)] = ""
    """One line that can be printed."""

    def __post_init__(self) -> None:
        _check_line("a reason", self.text)


class Instruction(PageMessage, frozen=True):
    """Instruction that the operator gives to the episode; empty for the task's own words."""

    text: Annotated[str, msgspec.Meta(max_length=LONGEST_INSTRUCTION)]
    """One line that can be printed."""

    def __post_init__(self) -> None:
        _check_line("an instruction", self.text)


def _check_line(what: str, text: str) -> None:
    """Reject a text that is not one line that can be printed."""
    if text != escaped(text) or len(text.splitlines()) > 1:
        raise ValueError(f"{what} is one line that can be printed")


class Operator(PageMessage, frozen=True):
    """Pseudonym of the operator who leads from now on; empty for none."""

    name: Annotated[str, msgspec.Meta(max_length=LONGEST_NAME)]
    """One line that can be printed."""

    def __post_init__(self) -> None:
        _check_line("a pseudonym", self.name)


Message = (
    Hands
    | Keep
    | Discard
    | Restore
    | Hold
    | GoOn
    | Recentre
    | Alone
    | Why
    | Instruction
    | Operator
    | SelectItem
)
"""Everything that an operator may send."""
ANYONE = (Hold,)
"""Messages that visitors who watch may send too."""


class Inbox:
    """Messages of an operator that wait to be followed; any thread may put one in."""

    def __init__(self) -> None:
        self._waiting: deque[tuple[Message | None, float]] = deque(maxlen=LONGEST_QUEUE)
        self._is_fuller = threading.Event()

    def put(self, message: Message | None, now_s: float) -> None:
        """Let a message wait, with its time of arrival; None says that the operator has gone."""
        self._waiting.append((message, now_s))
        self._is_fuller.set()

    def wait(self, timeout_s: float) -> None:
        """Wait for a message, or for so many seconds."""
        if not self._waiting:
            self._is_fuller.wait(timeout_s)
        self._is_fuller.clear()

    def forget(self, *kinds: type) -> None:
        """Remove waiting messages of some kinds; they are ignored."""
        with suppress(IndexError):  # another thread takes messages out too
            for _ in range(len(self._waiting)):
                message, now_s = self._waiting.popleft()
                if not isinstance(message, kinds):
                    self._waiting.append((message, now_s))

    def __iter__(self) -> Iterator[tuple[Message | None, float]]:
        """Take messages out, the oldest first; those that are not asked for wait on."""
        while self._waiting:
            yield self._waiting.popleft()
