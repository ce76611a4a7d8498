"""A session on a page: whoever drives leads the arms, and all others watch."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING, Any, cast

from duobench.envs.sim_env import SimEnv
from duobench.rig_sessions.pacing import Timings, run
from duobench.rig_sessions.teleoperation import Session
from duobench.types import SIDES
from duobench.web.geometry import Geometry
from duobench.web.messages import pack_frame
from duobench.web.server import PageServer

if TYPE_CHECKING:
    import mujoco

_QUIET = ("step", "lost")
"""What of a status changes all the time, and is sent once in a while or with something else."""
_TURNS = 6
"""Turns of the loop after which it is sent at the latest: a drag is measured where the tool is."""
WATCHING = "You watch: take over to lead the arms."


class LiveSession:
    """Shows a session of a simulated environment on a page, and gives it what the driver sends."""

    def __init__(self, session: Session, server: PageServer) -> None:
        """Join the two.

        Args:
            session: The session.
            server: The page, which takes its messages here from now on.
        """
        self._session, self._server = session, server
        self._env = cast("SimEnv", session.env.base)
        self._timings = Timings()
        self._over = threading.Event()
        self._episode: Any = None
        self._told: dict[str, Any] = {}
        self._turn = 0
        server.on_message = self._take
        server.on_driver_lost = lambda: session.leave(time.monotonic())
        self.show()

    def run(self) -> Timings:
        """Run the session until it is over or `stop` is called; how long its steps took.

        Raises:
            OutputError: An episode cannot be written.
        """
        return run(self._session, self.show, is_stopped=self._over.is_set, timings=self._timings)

    def stop(self) -> None:
        """Let `run` return; for other threads and signal handlers."""
        self._over.set()

    def _take(self, is_driver: bool, data: bytes) -> str | None:
        """Take a message, in the server's thread; only who drives leads."""
        if not is_driver:
            return WATCHING
        self._session.receive(data, time.monotonic())
        return None

    def show(self) -> None:
        """Show where everything is, after a turn of the loop."""
        status = self._session.status()
        if self._episode != status["count"]:
            self._begin(status["count"])
        if self._server.has_viewers:
            poses = self._geometry.poses(self._data())
            self._server.publish_frame(pack_frame(poses, status["step"], time.monotonic()))
            self._tell(status)
        for pulse in self._session.feeling.take():
            self._server.pulse(pulse["side"], pulse["strength"], pulse["ms"])

    def _begin(self, count: int) -> None:
        """Show the scene of an episode, which depends on what its layout chose."""
        self._episode = count
        self._geometry = self._new_geometry()
        self._server.publish_scene(self._geometry.name, self._geometry.data)

    def _new_geometry(self) -> Geometry:
        """The shapes of this episode's scene."""
        return Geometry(self._env.simulation.model, self._env.look)

    def _data(self) -> mujoco.MjData:
        """Where everything is."""
        return self._env.simulation.data

    def _tell(self, status: dict[str, Any]) -> None:
        """Show a status, if more has changed than what changes all the time."""
        self._turn += 1
        quiet = {name: value for name, value in status.items() if name not in _QUIET}
        if quiet == self._told and self._turn % _TURNS:
            return
        self._told = quiet
        poses = self._env.backend.read().tcp_poses
        self._server.publish_status(
            {
                **status,
                "steps": None,  # nobody can go back in what is just happening
                "latency_ms": self._timings.latency_ms,
                "tools": {str(side): poses[side.index][:3].tolist() for side in SIDES},
            }
        )
