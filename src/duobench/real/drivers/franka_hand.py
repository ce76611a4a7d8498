"""A Franka Hand by franky, through the control box of its arm.

Its server moves the fingers to a width, or closes them on something with a force that it then
holds, and each call blocks until that has ended. Targets come thirty times a second. One rule leads
from one to the other, here and in simulation: at most every `hold_steps` control steps a new target
stops what runs; one that closes is a grasp with the set force, one that opens is a move. A grip
that holds something is left alone by targets that close further. Tried with
franky-sim, and on no hardware. There a stop takes 1 to 12 ms, a motion that was stopped is never
answered, and each of those makes later calls 10 ms slower.
"""

from __future__ import annotations

import math
import threading
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from duobench.core.errors import ActionError, BackendError
from duobench.core.machine import load_extra
from duobench.core.types import CONTROL_HZ, Side
from duobench.real.clock import Clock, Ticker
from duobench.real.devices import GripperReading
from duobench.real.rig import GripperConfig
from duobench.results.labels import Fault, FaultKind
from duobench.world.robot.gripper import FRANKA_HAND

if TYPE_CHECKING:
    from duobench.real.rehearsal import RehearsalWorld

READ_HZ = 30.0
SILENT_S = 0.5
"""Age of the last answer at which silence is a fault."""
STROKE = FRANKA_HAND.stroke
HOLD_S = FRANKA_HAND.hold_steps / CONTROL_HZ
"""Seconds from the start of one motion to the next."""
HOMING_S = 15.0
"""Seconds in which the fingers have to find the ends of their way."""
SAME = 0.0005
"""Difference of two widths in metres below which they are one."""
EMPTY = 0.002
"""Width in metres up to which fingers that press hold nothing but each other."""
BLOCKED_S = 0.1
"""Seconds without movement after which something is in the way of an imitated hand."""


@dataclass(frozen=True, kw_only=True, slots=True)
class HandState:
    """Answer of a hand."""

    width: float
    """Gap between the fingers in metres."""
    max_width: float
    """Gap that homing has found in metres; 0 before."""
    is_grasped: bool


@dataclass(frozen=True, kw_only=True, slots=True)
class Motion:
    """Motion of the fingers."""

    width: float
    """Gap at its end in metres."""
    grasps: bool = False
    """Whether they press with the set force on what they meet, and hold it."""


class FrankyPort:
    """A hand over `franky.Gripper`; what it raises is a `BackendError`.

    Calls that block have a thread each: a server that never answers one that was stopped, as that
    of franky-sim, keeps nobody waiting.
    """

    def __init__(self, config: GripperConfig) -> None:
        self._config = config
        self._hand: Any = None
        self._running: threading.Thread | None = None
        self._errors: tuple[type[BaseException], ...] = (OSError,)

    @property
    def is_moving(self) -> bool:
        """Whether a motion runs."""
        return self._running is not None and self._running.is_alive()

    def open(self) -> None:
        """Reach the hand."""
        needed = "Hands need the library franky"
        library = load_extra("franky", "hardware", needed, BackendError)
        self._errors = (OSError, RuntimeError, library.Exception)
        self._hand = self._asked(library.Gripper, self._config.port)

    def read(self) -> Any:
        """Its state now, with the names of `HandState`."""
        return self._asked(lambda: self._hand.state)

    def home(self) -> None:
        """Begin to move through the whole range."""
        self._begin(self._hand.homing)

    def start(self, motion: Motion) -> None:
        """Begin a motion, where none runs."""
        speed = self._config.mm_per_s(FRANKA_HAND) / 1000.0
        if not motion.grasps:
            self._begin(self._hand.move, motion.width, speed)
            return
        # Whatever is met between open and closed counts as grasped.
        force, ends = self._config.newtons(FRANKA_HAND), (STROKE, STROKE)
        self._begin(self._hand.grasp, motion.width, speed, force, *ends)

    def stop(self) -> None:
        """Stop what runs."""
        self._asked(self._hand.stop)
        self._running = None

    def close(self) -> None:
        """Let go of it."""
        self._hand = None

    def _begin(self, call: Any, *given: float) -> None:
        def run() -> None:
            with suppress(*self._errors):  # one that is stopped raises
                call(*given)

        self._running = threading.Thread(target=run, name="franka hand", daemon=True)
        self._running.start()

    def _asked(self, call: Any, *given: Any) -> Any:
        try:
            return call(*given)
        except self._errors as error:
            raise BackendError(
                f"The hand at {self._config.port} does not answer: {error}"
            ) from error


class ImitatedHand:
    """A hand of a rehearsal, in the place of a `FrankyPort`.

    The owner of the fingers calls `move` with their closed share as time passes, and leads them to
    `target`.
    """

    ends = (0.0, 1.0)

    def __init__(self, *, is_active: bool = False) -> None:
        self.has_power = True
        """Whether it answers."""
        self.position = 0.0
        """Closed share of the fingers."""
        self.motions: list[Motion] = []
        """Motions that were begun."""
        self._ways: tuple[Motion, ...] = ()  # that still have to be made
        self._is_homed, self._homes = is_active, False
        self._holds: Motion | None = None
        self._seen, self._moved_at = 0.0, -1.0

    @property
    def is_moving(self) -> bool:
        """Whether a motion runs."""
        return bool(self._ways)

    @property
    def has_object(self) -> bool:
        """Whether it holds something."""
        return self._holds is not None

    @property
    def target(self) -> float | None:
        """Closed share that the fingers go to; None while they stay as they are."""
        motion = next(iter(self._ways), self._holds)
        return None if motion is None else 1.0 - motion.width / STROKE

    def open(self) -> None:
        """Reach it."""
        if not self.has_power:
            raise BackendError("The imitated hand has no power.")

    def read(self) -> HandState:
        """Its state now."""
        self.open()
        return HandState(
            width=STROKE * (1.0 - self.position),
            max_width=STROKE if self._is_homed else 0.0,
            is_grasped=self.has_object,
        )

    def home(self) -> None:
        """Begin to move through the whole range."""
        self._homes = True
        self._begin(Motion(width=0.0), Motion(width=STROKE))

    def start(self, motion: Motion) -> None:
        """Begin a motion, where none runs."""
        self.motions.append(motion)
        self._begin(motion)

    def stop(self) -> None:
        """Stop what runs."""
        self._ways, self._homes = (), False

    def close(self) -> None:
        """Do nothing."""

    def move(self, position: float, now: float) -> None:
        """Say where the fingers are, as a closed share, at a time in seconds."""
        self.position = position
        if self._moved_at < 0.0 or abs(position - self._seen) > SAME:
            self._seen, self._moved_at = position, now
        ways, target = self._ways, self.target
        if not ways or target is None:
            return
        is_there = abs(target - position) * STROKE <= SAME
        if is_there or now - self._moved_at >= BLOCKED_S:
            self._holds = ways[0] if ways[0].grasps and not is_there else None
            self._ways, self._moved_at = ways[1:], -1.0
            if self._homes and not self._ways:
                self._is_homed, self._homes = True, False

    def _begin(self, *ways: Motion) -> None:
        if self._ways:
            raise BackendError("The hand is still moving; stop it first.")
        self._ways, self._holds, self._moved_at = ways, None, -1.0


class FrankaHand:
    """A gripper that a ticker of the clock asks 30 times a second, and tells what is new."""

    imitation = ImitatedHand
    """Stands for the hardware in a rehearsal."""
    knows_ends = (
        "a Franka Hand says its gap in metres, and finds its ends when it is activated"
    )
    """Sentence on why nobody measures them."""

    def __init__(
        self,
        config: GripperConfig,
        clock: Clock,
        *,
        port: FrankyPort | ImitatedHand | None = None,
    ) -> None:
        self._config, self._clock = config, clock
        self._port = port or FrankyPort(config)
        self._ticker: Ticker | None = None
        self._goal: float | None = None
        self._told: float | None = None
        self._is_holding = self._homes = self._is_homing = False
        self._newest: tuple[float, HandState] | None = None
        self._trouble = ""
        self._next_start = 0.0
        self._was_active = False

    @classmethod
    def rehearse(
        cls, config: GripperConfig, clock: Clock, world: RehearsalWorld, side: Side
    ) -> FrankaHand:
        """The hand of a side of a rehearsal."""
        return cls(config, clock, port=world.grippers[side])

    def connect(self) -> None:
        """Reach the hand and ask it; nothing moves."""
        if self._ticker is None:
            self._port.open()
            self._newest = self._clock.now(), self._port.read()
            name = f"hand {self._config.port}"
            self._ticker = self._clock.every(1.0 / READ_HZ, self._tick, name)

    def activate(self) -> None:
        """Move the fingers through their whole range, unless it has done so already.

        Only with a person's consent: anything between the fingers is squeezed.
        """
        if self.read().is_active:
            return
        self._goal, self._is_holding, self._homes = None, False, True
        end = self._clock.now() + HOMING_S
        while self._homes and self._clock.now() < end:
            self._clock.wait_until(self._clock.now() + 1.0 / READ_HZ)
            fault = self.read().fault
            if fault is not None:
                raise BackendError(fault.text)
        if not self.read().is_active:
            raise BackendError(
                f"The hand at {self._config.port} was not homed: it was stopped, or took over "
                f"{HOMING_S:g} s."
            )

    def read(self) -> GripperReading:
        """The latest reading; its fault says what is wrong now, silence included."""
        if self._newest is None:
            raise BackendError("A gripper is read after it was connected.")
        time_s, state = self._newest
        return GripperReading(
            time_s=time_s,
            opening=min(max(state.width / STROKE, 0.0), 1.0),
            is_active=state.max_width > 0.0,
            has_object=state.is_grasped and state.width > EMPTY,
            fault=self._fault(time_s, state),
        )

    def command(self, opening: float) -> None:
        """Go to an opening, 0 closed to 1 open; beyond them is the nearer end. Returns at once."""
        if not math.isfinite(opening):
            raise ActionError(f"An opening is a number from 0 to 1, got {opening}.")
        if not self._homes:
            self._goal = STROKE * min(max(opening, 0.0), 1.0)
            self._is_holding = False

    def hold(self) -> None:
        """Stop the fingers if they move; a grip keeps its force, a homing ends unfinished."""
        self._is_holding, self._homes = True, False

    def recover(self) -> None:
        """Forget that it was homed: it lost its power, and has to be homed again."""
        self._was_active = False

    def close(self) -> None:
        """Let go of it; it keeps what it holds. Closing twice is harmless."""
        if self._ticker is not None:
            self._ticker.stop()
            self._ticker = None
            self._port.close()

    def _fault(self, time_s: float, state: HandState) -> Fault | None:
        silence = self._clock.now() - time_s
        if silence > SILENT_S:
            text = f"has not answered for {silence:.1f} s ({self._trouble})."
        elif self._was_active and state.max_width <= 0.0 and not self._homes:
            text = "is homed no more; it lost its power."
        else:
            return None
        return FaultKind.COMMUNICATION.fault(f"The hand at {self._config.port} {text}")

    def _tick(self) -> None:
        try:
            state = self._port.read()
            self._newest = self._clock.now(), state
            self._was_active |= state.max_width > 0.0
            self._lead(state)
        except BackendError as error:
            self._trouble = str(error)

    def _lead(self, state: HandState) -> None:
        """Stop what runs, or begin what is wanted, by the rule."""
        port, goal, now = self._port, self._goal, self._clock.now()
        if self._is_holding:
            if port.is_moving:
                port.stop()
            self._told, self._is_homing = None, False
        elif self._homes:
            if not self._is_homing:
                self._is_homing = True
                port.home()
            elif not port.is_moving:
                self._homes = self._is_homing = False
        elif goal is not None and state.max_width > 0.0 and now >= self._next_start:
            if self._told is not None and abs(goal - self._told) < SAME:
                return
            if not (state.is_grasped and goal < state.width):  # it presses already
                self._next_start = now + HOLD_S
                if port.is_moving:
                    port.stop()
                port.start(Motion(width=goal, grasps=goal < state.width - SAME))
            self._told = goal
