"""The teleoperator: hands on the page become the 16 joint numbers of two arms."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from lerobot.teleoperators import Teleoperator
from lerobot.teleoperators.utils import TeleopEvents
from lerobot.utils.decorators import check_if_already_connected, check_if_not_connected

from duobench.cli.shared.page import PageOptions
from duobench.core.errors import LeaderError, OptionError, check_known
from duobench.core.types import SIDES, DuoCommand, DuoState
from duobench.teleop.hands import DISCARD, KEEP
from duobench.teleop.messages import Message
from duobench.teleop.teleop_page import WATCHING
from duobench.web.geometry import Geometry
from duobench.web.messages import pack_frame
from duobench.world.looks.look import Look
from duobench.world.robot.frames import Robot, robot_with
from duobench.world.robot.joints import JOINT_RANGES
from duobench.world.sim.simulation import Simulation
from lerobot_env_duobench.config import KEYS, DuoBenchTeleoperatorConfig, by_key
from lerobot_env_duobench.hand_arms import HandArms

PULSES = {f"{side}_pulse": str(side) for side in SIDES}
"""Names of the strengths, 0 to 1, with which controllers rumble, and on which side."""
PULSE_MS = 100
TURNS = 6
"""Steps after which a status is sent at the latest: a drag is measured where the tool is."""
LOCKSTEP_WAIT_S = 1.0
"""Seconds that an action waits for hands in lockstep, so that a program can still be stopped."""

_log = logging.getLogger(__name__)


class DuoBenchTeleoperator(Teleoperator):
    """Both hands on DuoBench's page, as leader arms.

    The page shows the arms where they are led, and where a `DuoBenchRobot` of the same program
    follows, that robot and its table. Nothing moves before whoever drives has opened both hands and
    squeezed a clutch.
    """

    config_class = DuoBenchTeleoperatorConfig
    name = "duobench"
    connected: ClassVar[list[DuoBenchTeleoperator]] = []
    """Those of this program whose page is open, the newest last."""

    def __init__(self, config: DuoBenchTeleoperatorConfig) -> None:
        super().__init__(config)
        self.config = config
        self._page: _LivePage | None = None
        self._shadow: _Shadow | None = None
        self._measured: DuoState | None = None

    @property
    def action_features(self) -> dict[str, type]:
        """The 16 numbers."""
        return dict.fromkeys(KEYS, float)

    @property
    def feedback_features(self) -> dict[str, type]:
        """The 16 numbers, which say where the arms are, and a pulse for each hand."""
        return dict.fromkeys((*KEYS, *PULSES), float)

    @property
    def is_connected(self) -> bool:
        """Whether the page is served."""
        return self._page is not None

    @property
    def is_calibrated(self) -> bool:
        """Always: nothing has to be calibrated."""
        return True

    @property
    @check_if_not_connected
    def url(self) -> str:
        """Address of the page, with its token."""
        assert self._page is not None
        return self._page.url

    @property
    def is_led(self) -> bool:
        """Whether the operator has begun."""
        return self._page is not None and self._arms.is_led

    @check_if_already_connected
    def connect(self, calibrate: bool = True) -> None:  # noqa: ARG002
        """Serve the page, and say where.

        Raises:
            UnknownNameError: There is no such gripper or mount.
            ServingError: The port cannot be had, or there is no certificate for the network.
        """
        robot = robot_with(self.config.gripper, self.config.mount)
        self._arms = HandArms(lockstep=self.config.lockstep, robot=robot)
        self._page = _LivePage(self._arms, self.config.port, self.config.lan)
        self._shadow = _Shadow(robot)
        self._page.show_scene(self._shadow.simulation)
        self.connected.append(self)
        _log.info("Open %s", self.url)

    def calibrate(self) -> None:
        """Do nothing."""

    def configure(self) -> None:
        """Do nothing."""

    @check_if_not_connected
    def get_action(self) -> dict[str, float]:
        """One control step towards where the hands lead the tools; call it thirty times a second.

        Returns:
            Joints in radians and openings, 0 closed to 1 open, by `KEYS`.
        """
        assert self._page is not None
        if self.config.lockstep:
            self._arms.wait(LOCKSTEP_WAIT_S)
        command = self._arms.advance(time.monotonic(), self._measured)
        if self._shadow is not None:
            self._shadow.simulation.advance(command)
            self._page.show()
        return by_key(command.flat)

    @check_if_not_connected
    def get_teleop_events(self) -> dict[TeleopEvents, bool]:
        """What the operator said since the last call: keep is success, discard is failure.

        Either one ends the episode, and the next one begins with the arms at home.
        """
        decision = self._arms.take_decision()
        if decision is not None:
            self.place(self._arms.robot.home_command)
        return {
            TeleopEvents.IS_INTERVENTION: any(self._arms.device.clutch),
            TeleopEvents.TERMINATE_EPISODE: decision is not None,
            TeleopEvents.SUCCESS: decision == KEEP,
            TeleopEvents.FAILURE: decision == DISCARD,
            TeleopEvents.RERECORD_EPISODE: decision == DISCARD,
        }

    @check_if_not_connected
    def send_feedback(self, feedback: Mapping[str, Any]) -> None:
        """Say where the arms are, or let controllers rumble.

        Arms that are said to be somewhere stay there, until the operator opens the hands and begins
        anew; LeRobot does so where a person takes over from a policy.

        Args:
            feedback: All 16 numbers or none of them, and any of the pulses, for 100 ms each.

        Raises:
            UnknownNameError: There is no such number.
            LeaderError: Some of the 16 are missing, or one is not finite.
        """
        assert self._page is not None
        for key in feedback:
            check_known("number of the feedback", key, self.feedback_features)
        numbers = {key: float(value) for key, value in feedback.items()}
        if not all(map(math.isfinite, numbers.values())):
            raise LeaderError(f"Feedback holds finite numbers, got {numbers}.")
        joints = [numbers[key] for key in KEYS if key in numbers]
        if joints and len(joints) < len(KEYS):
            raise LeaderError(
                f"Feedback says where all joints are, {KEYS[0]} to {KEYS[-1]}, or of none; got "
                f"{len(joints)} of {len(KEYS)}."
            )
        if joints:
            said = DuoCommand.from_flat(joints)
            within = np.clip(said.joints, *JOINT_RANGES.T)
            self.place(
                DuoCommand(joints=within, openings=np.clip(said.openings, 0.0, 1.0))
            )
        for key in PULSES.keys() & numbers.keys():
            self._page.pulse(PULSES[key], min(max(numbers[key], 0.0), 1.0), PULSE_MS)

    def enable_torque(self) -> None:
        """Do nothing; LeRobot takes teleoperators with this method for ones it may move."""

    def disable_torque(self) -> None:
        """Do nothing."""

    def place(self, command: DuoCommand) -> None:
        """Say where the arms are; see `send_feedback`."""
        self._measured = None
        self._arms.place(command)
        if self._shadow is not None:
            self._shadow.place(command)

    def show_robot(self, simulation: Simulation, look: Look) -> None:
        """Show a robot of the same program from now on, in place of the arms alone.

        Raises:
            OptionError: The teleoperator leads arms with another gripper or mount.
        """
        if self._page is not None:
            led, shown = self._arms.robot, simulation.robot
            if led != shown:
                raise OptionError(
                    f"The teleoperator leads arms with a {led.gripper.name} on mount "
                    f"{led.mount.name}, the robot has a {shown.gripper.name} on mount "
                    f"{shown.mount.name}: give both the same gripper and mount."
                )
            self._shadow = None
            self._page.show_scene(simulation, look)

    def see(self, measured: DuoState, **status: Any) -> None:
        """Where that robot is, and what the page says beside it."""
        if self._page is not None:
            self._measured = measured
            self._page.show(**status)

    @check_if_not_connected
    def disconnect(self) -> None:
        """Close the page."""
        assert self._page is not None
        self._page.close()
        self._page = None
        self.connected.remove(self)


class _Shadow:
    """Simulated arms without a table full of things, for a page of arms that are elsewhere."""

    def __init__(self, robot: Robot) -> None:
        self.simulation = Simulation(robot=robot)
        """The arms."""

    def place(self, command: DuoCommand) -> None:
        """Put the arms somewhere at once; grippers begin open."""
        self.simulation.reset_data()
        openings = np.ones(len(SIDES))
        self.simulation.duo.set_configuration(
            DuoCommand(joints=command.joints, openings=openings)
        )
        self.simulation.forward()


class _LivePage:
    """Shows a simulation, and gives arms of numbers what the driver sends."""

    def __init__(self, arms: HandArms, port: int, lan: bool) -> None:
        """Begin to serve.

        Raises:
            ServingError: The port cannot be had, or there is no certificate for the network.
        """
        self._arms = arms
        self._server = PageOptions(port=port, lan=lan).serve()
        self._server.listen(
            Message,
            lambda message: arms.receive(message, time.monotonic()),
            lambda _gives_way: arms.leave(time.monotonic()),
            WATCHING,
        )
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
        self._server.publish_frame(
            pack_frame(poses, status.get("step", 0), time.monotonic())
        )
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
