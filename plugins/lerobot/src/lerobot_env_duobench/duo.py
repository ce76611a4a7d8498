"""The robot: both arms of a rig, with grippers and cameras."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from lerobot.utils.decorators import check_if_already_connected, check_if_not_connected

from duobench.core.errors import ActionError, BackendError, OptionError, check_known
from duobench.core.types import DuoCommand
from duobench.envs.duo_env import MAX_IMAGE_AGE_SECONDS
from duobench.real.duo import FrankaDuo
from duobench.real.opening import open_rig
from lerobot_env_duobench.config import KEYS, Arms, DuoBenchDuoConfig, by_key

REHEARSAL = "rehearsal"
QUESTION = (
    "Both arms go home now, slowly, and then follow what LeRobot sends. Is the emergency stop at "
    "hand, and nobody near? Type yes: "
)
ACTIVATION = (
    "A gripper was off and has to be activated: its fingers close and open. Is nothing between "
    "them? Type yes: "
)


class DuoBenchDuo(Arms):
    """Both arms of a rig, within all limits of DuoBench's own programs.

    `connect` asks the operator at the terminal, then brings the arms home. Where arms, grippers or
    cameras fail, or somebody holds the arms, both hold, and the next call raises a `BackendError`:
    a program that went on would record arms that do not move.
    """

    config_class = DuoBenchDuoConfig

    def __init__(self, config: DuoBenchDuoConfig, duo: FrankaDuo | None = None) -> None:
        """Know the options; nothing is connected before `connect`.

        Args:
            config: The options.
            duo: The rig, where it is open already; otherwise that of `config.rig`.

        Raises:
            OptionError: There is no rig, or nobody is to be asked about a real one.
            FileError: The rig's file cannot be read.
            UnknownNameError: The rig has no such camera.
        """
        if duo is None and not config.rig:
            raise OptionError(
                "rig is the file of a rig, such as rig.json, or 'rehearsal'."
            )
        if not config.ask and config.rig != REHEARSAL:
            raise OptionError(
                "Somebody has to confirm before real arms move: leave `ask` true."
            )
        self._duo = duo or open_rig(config.rig, guard=config.guard)
        super().__init__(config, self._duo.rig.gripper, self._duo.rig.mount)
        for name in config.views:
            check_known("camera of this rig", name, self._duo.cameras)
        self._is_connected = False

    @property
    def is_connected(self) -> bool:
        """Whether the arms follow what is sent."""
        return self._is_connected

    @check_if_already_connected
    def connect(self, calibrate: bool = True) -> None:  # noqa: ARG002
        """Reach every device, ask the operator, and go home.

        Raises:
            BackendError: A device cannot be reached, nobody confirmed, or the arms do not get home.
        """
        duo = self._duo
        duo.start()
        try:
            if duo.hands.inactive:
                if self.config.ask:
                    _ask(ACTIVATION)
                duo.hands.activate()
            if self.config.ask:
                _ask(QUESTION)
            duo.supervisor.confirm()
            duo.see(self.config.views)
            duo.home()
        except BaseException:
            duo.close()
            raise
        self._is_connected = True

    @check_if_not_connected
    def get_observation(self) -> dict[str, Any]:
        """Where the arms are, and the latest image of each camera, as the simulation shows it.

        Raises:
            BackendError: The arms are held, or an image is older than 0.1 s.
        """
        self._check()
        numbers = by_key(self._duo.read().flat)
        size = (self.config.image_size, self.config.image_size)
        return {**numbers, **self._duo.images(self.config.views, size)}

    @check_if_not_connected
    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        """Move towards a command until the next tick of the control rate, 30 Hz.

        Args:
            action: The 16 numbers; what is out of range or too fast is approached.

        Returns:
            What was sent to the arms.

        Raises:
            ActionError: A number is missing or not finite; nothing moved.
            BackendError: The arms are held.
        """
        missing = [key for key in KEYS if key not in action]
        if missing:
            raise ActionError(
                f"An action has the {len(KEYS)} numbers {KEYS[0]} to {KEYS[-1]}; "
                f"{missing[0]} is not there."
            )
        self._check()
        numbers = np.array([float(action[key]) for key in KEYS])
        sent = self._duo.command(DuoCommand.from_flat(numbers)).flat
        self._check()
        return by_key(sent)

    @check_if_not_connected
    def disconnect(self) -> None:
        """Come to rest, and let go of everything."""
        self._is_connected = False
        self._duo.close()

    def _check(self) -> None:
        """Reject what would go on with arms that hold, or with old images.

        Raises:
            BackendError: The arms are held.
        """
        duo = self._duo
        fault = duo.health()
        old = [
            name
            for name, age in duo.image_ages().items()
            if not age <= MAX_IMAGE_AGE_SECONDS
        ]
        if duo.held is None and old:
            fault = fault or f"Images are too old: {', '.join(old)}."
        if duo.held is None and fault:
            duo.hold(fault)
        if duo.held is not None:
            raise BackendError(f"Both arms hold: {duo.held}")


def _ask(question: str) -> None:
    """Ask whoever sits at the terminal whether something may move.

    Raises:
        BackendError: Nobody said yes.
    """
    if not sys.stdin.isatty():
        raise BackendError(
            "Somebody has to confirm in a terminal that the arms may move, and there is none."
        )
    if input(question).strip().lower() not in {"y", "yes"}:
        raise BackendError("The operator did not confirm; nothing moved.")
