"""A Franka Hand by franky, through the control box of its arm.

Its server moves the fingers to a width, or closes them on something with a force that it then
holds, and each call blocks until that has ended. Targets come thirty times a second. One rule leads
from one to the other, here and in simulation: at most every `hold_steps` control steps a new target
stops what runs; one that closes is a grasp with the set force, one that opens is a move, and a grip
that holds something is left alone by targets that close further. Tried on no hardware.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

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
HOLD_S = FRANKA_HAND.hold_steps / CONTROL_HZ
"""Seconds from the start of one motion to the next."""
HOMING_S = 15.0
"""Seconds in which the fingers have to find the ends of their way."""
SAME = 0.0005
"""Difference of two widths in metres below which they are one."""
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
    grasps: bool
    """Whether they press with the set force on what they meet, and hold it."""


class HandPort(Protocol):
    """Connection to a hand; errors of it are `BackendError`."""

    @property
    def is_moving(self) -> bool:
        """Whether a motion runs."""
        ...

    def open(self) -> None:
        """Reach the hand."""

    def read(self) -> HandState:
        """Its state now."""
        ...

    def home(self) -> None:
        """Begin to move through the whole range."""

    def start(self, motion: Motion) -> None:
        """Begin a motion, where none runs; return at once."""

    def stop(self) -> None:
        """Stop what runs; a grip is let go of only by the next motion."""

    def close(self) -> None:
        """Let go of it."""


class FrankyPort:
    """A `HandPort` over `franky.Gripper`, whose calls that block run in a thread of their own."""

    def __init__(self, config: GripperConfig) -> None:
        self._config = config
        self._speed = config.mm_per_s(FRANKA_HAND) / 1000.0
        self._force = config.newtons(FRANKA_HAND)
        self._hand: Any = None
        self._errors: tuple[type[BaseException], ...] = (OSError,)
        self._thread: threading.Thread | None = None

    @property
    def is_moving(self) -> bool:
        """Whether a call still blocks."""
        return self._thread is not None and self._thread.is_alive()

    def open(self) -> None:
        """Reach the hand."""
        library = load_extra(
            "franky", "hardware", "Hands need the library franky", BackendError
        )
        self._errors = (OSError, RuntimeError, library.Exception)
        self._hand = self._asked(library.Gripper, self._config.port)

    def read(self) -> HandState:
        """Its state now."""
        state = self._asked(lambda: self._hand.state)
        return HandState(
            width=state.width,
            max_width=state.max_width,
            is_grasped=state.is_grasped,
        )

    def home(self) -> None:
        """Begin to move through the whole range."""
        self._run(self._hand.homing)

    def start(self, motion: Motion) -> None:
        """Begin a motion."""
        if not motion.grasps:
            self._run(self._hand.move, motion.width, self._speed)
            return
        # Whatever is met between open and closed counts as grasped.
        stroke = FRANKA_HAND.stroke
        self._run(
            self._hand.grasp, motion.width, self._speed, self._force, stroke, stroke
        )

    def stop(self) -> None:
        """Stop what runs, and wait until its call has returned."""
        self._asked(self._hand.stop)
        if self._thread is not None:
            self._thread.join(SILENT_S)

    def close(self) -> None:
        """Let go of it."""
        self._hand = None

    def _run(self, call: Callable[..., Any], *given: float) -> None:
        def run() -> None:
            # A call that is stopped raises; what is wrong shows in the next reading.
            try:
                call(*given)
            except self._errors:
                return

        self._thread = threading.Thread(target=run, name="franka hand", daemon=True)
        self._thread.start()

    def _asked(self, call: Callable[..., Any], *given: Any) -> Any:
        try:
            return call(*given)
        except self._errors as error:
            raise BackendError(
                f"The hand at {self._config.port} does not answer: {error}"
            ) from error


class ImitatedHand:
    """Server of a hand, without a line between: others move the fingers and say where they are.

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
        self._ways: list[Motion] = []  # that still have to be made
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
        motion = self._ways[0] if self._ways else self._holds
        return None if motion is None else 1.0 - motion.width / FRANKA_HAND.stroke

    def open(self) -> None:
        """Reach it.

        Raises:
            BackendError: It has no power.
        """
        if not self.has_power:
            raise BackendError("The imitated hand has no power.")

    def read(self) -> HandState:
        """Its state now."""
        self.open()
        stroke = FRANKA_HAND.stroke
        return HandState(
            width=stroke * (1.0 - self.position),
            max_width=stroke if self._is_homed else 0.0,
            is_grasped=self.has_object,
        )

    def home(self) -> None:
        """Begin to move through the whole range."""
        self._homes = True
        self._begin(
            Motion(width=0.0, grasps=False),
            Motion(width=FRANKA_HAND.stroke, grasps=False),
        )

    def start(self, motion: Motion) -> None:
        """Begin a motion."""
        self.motions.append(motion)
        self._begin(motion)

    def stop(self) -> None:
        """Stop what runs."""
        self._ways, self._homes = [], False

    def close(self) -> None:
        """Nothing is held."""

    def move(self, position: float, now: float) -> None:
        """Say where the fingers are, as a closed share, at a time in seconds."""
        self.position = position
        if self._moved_at < 0.0 or abs(position - self._seen) > SAME:
            self._seen, self._moved_at = position, now
        target = self.target
        if target is None or not self._ways:
            return
        is_there = abs(target - position) * FRANKA_HAND.stroke <= SAME
        is_blocked = now - self._moved_at >= BLOCKED_S
        if is_there or is_blocked:
            motion = self._ways.pop(0)
            self._moved_at = -1.0
            self._holds = motion if motion.grasps and not is_there else None
            if self._homes and not self._ways:
                self._is_homed, self._homes = True, False

    def _begin(self, *ways: Motion) -> None:
        if self._ways:
            raise BackendError("The hand is still moving; stop it first.")
        self._ways, self._holds, self._moved_at = [*ways], None, -1.0


class FrankaHand:
    """A gripper that a ticker of the clock asks 30 times a second, and tells what is new."""

    imitation = ImitatedHand
    """Stands for the hardware in a rehearsal."""

    def __init__(
        self,
        config: GripperConfig,
        clock: Clock,
        *,
        port: HandPort | None = None,
    ) -> None:
        self._config = config
        self._clock = clock
        self._port: HandPort = port or FrankyPort(config)
        self._ticker: Ticker | None = None
        self._lock = threading.Lock()  # over what other threads want
        self._goal: float | None = None
        self._told: float | None = None
        self._is_holding = False
        self._wants_homing = False
        self._newest: tuple[float, HandState] | None = None
        self._trouble = ""
        self._next_start = 0.0
        self._was_active = False

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
        with self._lock:
            self._goal, self._is_holding, self._wants_homing = None, False, True
        end = self._clock.now() + HOMING_S
        while self._clock.now() < end:
            self._clock.wait_until(self._clock.now() + 1.0 / READ_HZ)
            reading = self.read()
            if self._is_holding:
                raise BackendError(
                    f"The homing of the hand at {self._config.port} was stopped."
                )
            if reading.fault is not None:
                raise BackendError(reading.fault.text)
            if reading.is_active and not self._wants_homing:
                return
        raise BackendError(
            f"The hand at {self._config.port} was not homed within {HOMING_S:g} s."
        )

    def read(self) -> GripperReading:
        """The latest reading; its fault says what is wrong now, silence included."""
        if self._newest is None:
            raise BackendError("A gripper is read after it was connected.")
        time_s, state = self._newest
        return GripperReading(
            time_s=time_s,
            opening=min(max(state.width / FRANKA_HAND.stroke, 0.0), 1.0),
            is_active=state.max_width > 0.0,
            has_object=state.is_grasped,
            fault=self._fault(time_s, state),
        )

    def command(self, opening: float) -> None:
        """Go to an opening, 0 closed to 1 open; beyond them is the nearer end. Returns at once."""
        if not math.isfinite(opening):
            raise ActionError(f"An opening is a number from 0 to 1, got {opening}.")
        with self._lock:
            if not self._wants_homing:
                self._goal = FRANKA_HAND.stroke * min(max(opening, 0.0), 1.0)
                self._is_holding = False

    def hold(self) -> None:
        """Stop the fingers if they move; a grip keeps its force, a homing ends unfinished."""
        with self._lock:
            self._is_holding, self._wants_homing = True, False

    def recover(self) -> None:
        """Forget that it was homed: it lost its power, and has to be homed again."""
        self._was_active = False

    def close(self) -> None:
        """Let go of it; it keeps what it holds. Closing twice is harmless."""
        if self._ticker is not None:
            self._ticker.stop()
            self._ticker = None
            self._port.close()

    @classmethod
    def rehearse(
        cls,
        config: GripperConfig,
        clock: Clock,
        world: RehearsalWorld,
        side: Side,
    ) -> FrankaHand:
        """The hand of a side of a rehearsal."""
        return cls(config, clock, port=_WorldPort(world, side))

    def _fault(self, time_s: float, state: HandState) -> Fault | None:
        port = self._config.port
        silence = self._clock.now() - time_s
        if silence > SILENT_S:
            text = f"The hand at {port} has not answered for {silence:.1f} s ({self._trouble})."
            return FaultKind.COMMUNICATION.fault(text)
        if self._was_active and state.max_width <= 0.0 and not self._wants_homing:
            text = f"The hand at {port} is homed no more; it lost its power."
            return FaultKind.COMMUNICATION.fault(text)
        return None

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
        with self._lock:
            goal, is_holding, homes = self._goal, self._is_holding, self._wants_homing
        if is_holding:
            if self._port.is_moving:
                self._port.stop()
            self._told = None
            return
        if homes:
            if self._told != math.inf:
                self._told = math.inf
                self._port.home()
            elif not self._port.is_moving:
                self._wants_homing, self._told = False, None
            return
        now = self._clock.now()
        if goal is None or state.max_width <= 0.0 or now < self._next_start:
            return
        if self._told is not None and abs(goal - self._told) < SAME:
            return
        self._told = goal
        if state.is_grasped and goal < state.width:
            return  # it presses already
        self._next_start = now + HOLD_S
        if self._port.is_moving:
            self._port.stop()
        self._port.start(Motion(width=goal, grasps=goal < state.width - SAME))


class _WorldPort:
    """Leads to an imitated hand of a rehearsal, and lets the world's time pass."""

    def __init__(self, world: RehearsalWorld, side: Side) -> None:
        self._world = world
        self._hand: ImitatedHand = world.grippers[side]

    @property
    def is_moving(self) -> bool:
        return self._hand.is_moving

    def open(self) -> None:
        self._hand.open()
        self._world.enter(self)

    def read(self) -> HandState:
        with self._world.lock:
            return self._hand.read()

    def home(self) -> None:
        with self._world.lock:
            self._hand.home()

    def start(self, motion: Motion) -> None:
        with self._world.lock:
            self._hand.start(motion)

    def stop(self) -> None:
        with self._world.lock:
            self._hand.stop()

    def close(self) -> None:
        self._world.leave(self)
