"""Teleoperation on a page: one visitor drives the arms, and all others watch.

Thirty turns a second, or one for each message; a turn is a control step while the world runs.
"""

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, cast

import mujoco
import numpy as np

from duobench.core.types import CONTROL_HZ, SIDES
from duobench.envs.sim_env import SimEnv
from duobench.teleop.messages import ANYONE, Message
from duobench.teleop.plan import PlannedSessions
from duobench.teleop.plumb import PlumbLines
from duobench.teleop.teleoperation import Teleoperation, TeleopState
from duobench.web.geometry import Geometry
from duobench.web.messages import pack_frame
from duobench.web.server import PageServer
from duobench.world.robot.cameras import View

_QUIET = ("step", "led_s", "lost")
"""Fields of a status that change all the time, sent once in a while or with others."""
_TURNS = 6
"""Most turns of the loop between statuses: pages measure a drag from where they say the tool is."""
LEADING_VIEW = View(
    eye=(-0.12, 0.0, 1.45),
    target=(0.47, 0.0, 0.1),
    fovy_deg=47.0,
)
"""Where people look from at first: over the robot's head, so that left is left."""
WATCHING = "You watch: take over to lead the arms."
PERIOD_S = 1.0 / CONTROL_HZ
"""Seconds from one control step to the next."""
KEPT_TIMES = 18_000
"""Periods and latencies that are remembered: ten minutes."""
SHOWN_TIMES = 30
"""Number of last latencies whose median is shown to the operator."""
QUANTILES = (50, 95, 99)


class Timings:
    """Measured times of a session's steps in milliseconds."""

    def __init__(self) -> None:
        self.periods: deque[float] = deque(maxlen=KEPT_TIMES)
        """Times from one step of the loop to the next."""
        self.latencies: deque[float] = deque(maxlen=KEPT_TIMES)
        """Times from a sample's arrival to the end of the control step that executed it."""

    @property
    def latency_ms(self) -> float | None:
        """The middle one of the last latencies; None before the first."""
        latest = list(self.latencies)[-SHOWN_TIMES:]
        return round(float(np.median(latest)), 1) if latest else None

    def summary(self) -> dict[str, dict[str, float]]:
        """Quantiles (`p50`, `p95`, `p99`) and the largest (`max`) of `period_ms`, `latency_ms`."""
        return {
            name: {
                **{f"p{q}": float(np.percentile(times, q)) for q in QUANTILES},
                "max": max(times),
            }
            for name, times in (
                ("period_ms", self.periods),
                ("latency_ms", self.latencies),
            )
            if times
        }


def run(
    session: Teleoperation,
    on_step: Callable[[], None] = lambda: None,
    *,
    is_stopped: Callable[[], bool] = lambda: False,
    timings: Timings | None = None,
) -> Timings:
    """Run a session until it is over: in lockstep if it is, otherwise in real time.

    In real time a loop that is late goes on at once and forgets the delay: simulated time slows
    down, and no control step is left out.

    Args:
        session: The session.
        on_step: Called after each turn of the loop, to show what is; its time counts.
        is_stopped: Whether to stop before the session is over.
        timings: Where to note times; new ones if not given.
    """
    timings = Timings() if timings is None else timings
    due = last = time.monotonic()
    newest = session.device.sampled_s
    while session.state is not TeleopState.OVER and not is_stopped():
        if session.lockstep:
            session.wait(PERIOD_S)
        has_stepped = session.advance(time.monotonic())
        now, sampled = time.monotonic(), session.device.sampled_s
        if has_stepped and sampled is not None and sampled != newest:
            timings.latencies.append(1000.0 * (now - sampled))
        newest = sampled
        on_step()
        if not session.lockstep:
            due = max(due + PERIOD_S, time.monotonic())
            time.sleep(max(0.0, due - time.monotonic()))
        now, before = time.monotonic(), last
        last = now
        if has_stepped:
            timings.periods.append(1000.0 * (now - before))
    return timings


class TeleopPage:
    """Shows a session of a simulated environment on a page, and gives it what the driver sends.

    Args:
        session: The session.
        server: The page, which takes its messages here from now on.
        plan: Gives the sessions that follow.
    """

    kinds: Any = Message
    """Classes of the messages that the page takes."""

    def __init__(
        self,
        session: Teleoperation,
        server: PageServer,
        plan: PlannedSessions | None = None,
    ) -> None:
        self._server, self._plan = server, plan
        self._timings = Timings()
        self._over = threading.Event()
        self._episode: Any = None
        self._planned: Any = None
        self._told: dict[str, Any] = {}
        self._turn = 0
        self._use(session)
        server.listen(self.kinds, self._take, self._leave, WATCHING, ANYONE)
        self.show()

    def _use(self, session: Teleoperation) -> None:
        """Show another session."""
        self._session = session
        self._env = cast("SimEnv", session.env.base)
        session.before_reset = self.show

    def run(self) -> Timings:
        """Run until all sessions are over or `stop` is called; how long their steps took."""
        while True:
            run(
                self._session,
                self.show,
                is_stopped=self._over.is_set,
                timings=self._timings,
            )
            following = None
            if self._plan is not None and not self._over.is_set():
                following = self._plan.next()
            if following is None:
                return self._timings
            self._use(following)
            following.leave(time.monotonic())  # hands lead again once they were open
            self.show()

    def stop(self) -> None:
        """Let `run` return; for other threads and signal handlers."""
        self._over.set()

    def _take(self, message: Message) -> None:
        self._session.receive(message, time.monotonic())

    def _leave(self, gives_way: bool) -> None:  # noqa: ARG002 - a rig tells it
        self._session.leave(time.monotonic())

    def show(self) -> None:
        """Show where everything is, after a turn of the loop."""
        status = self._session.status()
        episode = (status["task"], status["count"])
        is_preparing = self._session.state is TeleopState.PREPARING
        if self._episode != episode and not is_preparing:
            self._episode = episode  # the scene depends on what its layout chose
            self._geometry = self._new_geometry()
            self._lines = self._new_lines()
            self._server.publish_scene(self._geometry.name, self._geometry.data)
        if self._server.has_viewers:
            poses = self._geometry.poses(self._data())
            shows_ms = self._session.device.executed_ms
            frame = pack_frame(
                poses,
                status["step"],
                time.monotonic(),
                shows_ms,
                self._lines.rows(),
            )
            self._server.publish_frame(frame)
            self._tell(status)
        for pulse in self._session.haptics.take():
            self._server.pulse(*pulse)

    def _new_geometry(self) -> Geometry:
        return Geometry(
            self._env.simulation.model,
            self._env.look,
            LEADING_VIEW,
            cameras=True,
        )

    def _new_lines(self) -> PlumbLines:
        """Lines from the tools to what lies below them."""
        return PlumbLines(self._env.simulation)

    def _data(self) -> mujoco.MjData:
        return self._env.simulation.data

    def _show_plan(self, status: Mapping[str, Any]) -> None:
        """List tasks, where there are several, and their progress where that may have changed."""
        moment = (*self._episode, status["state"])
        if self._plan is not None and moment != self._planned:
            self._planned = moment
            items = self._plan.items()
            self._server.publish_items(items if len(items) > 1 else [])

    def _tell(self, status: dict[str, Any]) -> None:
        self._turn += 1
        if self._plan is not None:
            self._show_plan(status)
            status["operators"] = self._plan.operators
            status["selected"] = self._session.chosen or status["task"]
        quiet = {name: value for name, value in status.items() if name not in _QUIET}
        if quiet == self._told and self._turn % _TURNS:
            return
        self._told = quiet
        poses = self._env.backend.read().tcp_poses
        self._server.publish_status(
            {
                **status,
                "steps": None,  # a live session cannot be wound back
                "latency_ms": self._timings.latency_ms,
                "tools": {str(side): poses[side.index][:3].tolist() for side in SIDES},
            }
        )
