"""The page of a teleoperator: what it shows, and what its driver sends."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from duobench.cli.shared.page import serve_page
from duobench.looks.look import Look
from duobench.rig_sessions.teleop_page import WATCHING
from duobench.sim.simulation import Simulation
from duobench.teleop.hand_arms import HandArms
from duobench.types import SIDES, DuoCommand
from duobench.web.geometry import Geometry
from duobench.web.messages import pack_frame

TURNS = 6
"""Steps after which a status is sent at the latest: a drag is measured where the tool is."""


class Shadow:
    """Simulated arms without a table full of things, for a page of arms that are elsewhere."""

    def __init__(self) -> None:
        """Begin at home."""
        self.simulation = Simulation()
        """The arms."""

    def place(self, command: DuoCommand) -> None:
        """Put the arms somewhere at once; grippers begin open."""
        self.simulation.reset_data()
        openings = np.ones(len(SIDES))
        self.simulation.duo.set_configuration(DuoCommand(joints=command.joints, openings=openings))
        self.simulation.forward()


class LivePage:
    """Shows a simulation, and gives arms of numbers what the driver sends."""

    def __init__(self, arms: HandArms, port: int, lan: bool) -> None:
        """Begin to serve.

        Raises:
            ServingError: The port cannot be had, or there is no certificate for the network.
        """
        self._arms = arms
        self._server = serve_page(port, lan)
        self._server.on_message = self._take
        self._server.on_driver_lost = lambda: arms.leave(time.monotonic())
        self._simulation: Simulation | None = None
        self._told: dict[str, Any] = {}
        self._turn = 0
        self.url = self._server.url
        """Its address, with the token."""

    @property
    def has_viewers(self) -> bool:
        """Whether a browser has it open."""
        return self._server.has_viewers

    def show_scene(self, simulation: Simulation, look: Look | None = None) -> None:
        """Show a simulation from now on."""
        self._simulation, self._geometry = simulation, Geometry(simulation.model, look)
        self._server.publish_scene(self._geometry.name, self._geometry.data)

    def show(self, **status: Any) -> None:
        """Show where everything is now, and what is said beside it."""
        if self._simulation is None or not self.has_viewers:
            return
        poses = self._geometry.poses(self._simulation.data)
        self._server.publish_frame(pack_frame(poses, status.get("step", 0), time.monotonic()))
        device = self._arms.device
        told = {
            "title": "LeRobot",
            "state": "recording" if self._arms.is_led else "waiting",
            "clutch": dict(zip(map(str, SIDES), device.clutch, strict=True)),
            **status,
            "note": self._arms.note or status.get("note", ""),
        }
        self._turn += 1
        quiet = {name: value for name, value in told.items() if name != "step"}
        if quiet == self._told and self._turn % TURNS:
            return
        self._told = quiet
        tools = self._simulation.duo.read().tcp_poses
        places = {str(side): tools[side.index][:3].tolist() for side in SIDES}
        self._server.publish_status({**told, "lost": device.dropped, "tools": places})

    def pulse(self, side: str, strength: float, ms: int) -> None:
        """Let a controller of the driver rumble; strength from 0 to 1."""
        self._server.pulse(side, strength, ms)

    def close(self) -> None:
        """Let every browser go."""
        self._server.close()

    def _take(self, is_driver: bool, data: bytes) -> str | None:
        """Take a message, in the server's thread; only who drives leads."""
        if not is_driver:
            return WATCHING
        self._arms.receive(data, time.monotonic())
        return None
