"""A scripted person who watches a policy, takes over by the clutch, and puts things right.

It comes through the door of people: hands of a page, in lockstep. What it sees is the simulator's
state, and what it does an entry says, see `entries`.
"""

from collections.abc import Callable

import numpy as np

from dev.tools.entries import Entry
from duobench.core.spatial import SE3
from duobench.core.types import CONTROL_HZ, SIDES, Side
from duobench.envs.sim_env import sim_of
from duobench.tasks.experts.motion import Arms, Script
from duobench.teleop.messages import Discard, Hand, Hands, Keep, Message, Why
from duobench.teleop.teleoperation import Teleoperation, TeleopState

ROOM_FROM_WORLD = SE3.at(0.3, -0.2, 1.1)
"""The person stands somewhere else; the axes are those of the room."""
GAP = 12
"""Control steps after the first take-over at which the person lets go once, and for how many."""
GAP_STEPS = 6
LATE_S, LOST_S = 6.0, 0.5
"""Seconds without a new stage, about twice those of the slowest demonstrations, and seconds without
a stage that was reached, after which a policy has failed."""

Sees = Callable[[Teleoperation], str | None]
"""Reason to take over now; None while the policy does well."""


class StandsStill:
    """Sees that commanded targets have not moved for a second."""

    def __init__(self) -> None:
        self._last = np.zeros(0)
        self._steps = 0

    def __call__(self, session: Teleoperation) -> str | None:
        """The reason, once it is seen."""
        now = session.env.base.backend.last_command.flat
        self._steps = self._steps + 1 if np.array_equal(now, self._last) else 0
        self._last = now
        return "stuck" if self._steps >= CONTROL_HZ else None


class Fails:
    """Sees that a policy stands still, gets no further, or has lost what it had reached.

    The page tells a person as much.
    """

    def __init__(self) -> None:
        self._stands_still = StandsStill()
        self._best = self._since = self._lost = 0

    def __call__(self, session: Teleoperation) -> str | None:
        """The reason, once it is seen."""
        told = session.status()
        stage, step = told["stage"], told["step"]
        if stage > self._best:
            self._best, self._since = stage, step
        self._lost = self._lost + 1 if stage < self._best else 0
        if self._lost >= LOST_S * CONTROL_HZ:
            return "dropped"
        is_late = step - self._since >= LATE_S * CONTROL_HZ
        stuck = self._stands_still(session) or ("stuck" if is_late else None)
        return None if told["success"] else stuck


class AtStep:
    """Takes over at a step, for a reason."""

    def __init__(self, step: int, why: str) -> None:
        self._step = step
        self._why = why

    def __call__(self, session: Teleoperation) -> str | None:
        """The reason, from that step on."""
        return self._why if session.status()["step"] >= self._step else None


class Corrector:
    """Leads through a session whose policy plays, one message for each control step.

    Kept are episodes that the person led to success.

    Args:
        session: The session, in lockstep.
        entry: Puts an episode right from wherever it is.
        sees: Makes what an episode, by its number, is watched with.
        lets_go: Whether the hands let go once for a moment, so that the policy leads in between.
    """

    def __init__(
        self,
        session: Teleoperation,
        entry: Entry,
        sees: Callable[[int], Sees],
        *,
        lets_go: bool = False,
    ) -> None:
        self._session = session
        self._entry = entry
        self._sees = sees
        self._lets_go = lets_go
        self._number = 0
        self._begin()

    def message(self) -> Message:
        """What the person sends now."""
        state = self._session.state
        if state is TeleopState.DECIDE:
            is_led = self._arms is not None
            return Keep() if is_led and self._session.status()["success"] else Discard()
        if self._why:
            why, self._why = self._why, ""
            return Why(text=why)
        self._number += 1
        if state is TeleopState.WAITING:
            self._begin()
            return self._hands(squeeze=self._number % 2)
        return self._hands(squeeze=self._lead())

    def _lead(self) -> float:
        """Move the hands, or watch; how far they are squeezed."""
        if self._arms is None:
            self._why = self._watch(self._session) or ""
            if not self._why:
                return 0.0
            self._enter()
            return 1.0
        self._led += 1
        if self._lets_go and GAP <= self._led < GAP + GAP_STEPS:
            return 0.0
        is_back = self._lets_go and self._led == GAP + GAP_STEPS
        is_done = next(self._script, self) is self and not is_back
        if is_back or (is_done and not self._session.status()["success"]):
            self._enter()
        return 1.0

    def _enter(self) -> None:
        """Begin to put things right, from where the arms are."""
        self._arms = Arms(sim_of(self._session.env).simulation)
        self._script = self._entry(self._arms, self._session.status()["stage"])

    def _begin(self) -> None:
        self._watch = self._sees(int(self._session.status()["count"]))
        self._arms: Arms | None = None
        self._script: Script = iter(())  # type: ignore[assignment]
        self._led = 0
        self._why = ""

    def _hands(self, *, squeeze: float) -> Hands:
        left, right = (self._hand(side, squeeze) for side in SIDES)
        sent = 1000.0 * self._number / CONTROL_HZ
        return Hands(sent=sent, seq=self._number, left=left, right=right)

    def _hand(self, side: Side, squeeze: float) -> Hand:
        pose, trigger = SE3.at(), 0.0
        if self._arms is not None:
            pose = self._arms.targets[side]
            opening = float(self._arms.openings[side.index])
            trigger = min(max(1.0 - opening, 0.0), 1.0)
        placed = ROOM_FROM_WORLD @ pose
        numbers = (*placed.translation.tolist(), *placed.wxyz.tolist())
        return Hand(pose=numbers, sure=True, squeeze=squeeze, trigger=trigger)


def play(session: Teleoperation, corrector: Corrector, episodes: int) -> None:
    """Play a session until so many episodes are kept."""
    while session.kept < episodes:
        session.receive(corrector.message(), 0.0)
        session.advance(0.0)
