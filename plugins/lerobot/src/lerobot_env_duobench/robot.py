"""The robot: both simulated arms, with a task's objects on the table."""

from __future__ import annotations

import time
from typing import Any, cast

import gymnasium as gym
from lerobot.teleoperators.utils import TeleopEvents
from lerobot.utils.decorators import check_if_already_connected, check_if_not_connected

from duobench.core.randomness import episode_seed
from duobench.core.types import CONTROL_HZ
from duobench.envs.observation_wrappers import PIXELS
from duobench.envs.protocol import make_base, with_wrappers
from duobench.envs.sim_env import SimEnv, sim_of
from lerobot_env_duobench.config import KEYS, Arms, DuoBenchRobotConfig, by_key
from lerobot_env_duobench.teleoperator import DuoBenchTeleoperator

SOLVED = "Solved. End the episode in LeRobot's program, then keep it here for the next layout."


class DuoBenchRobot(Arms):
    """Both arms of a simulated task, which never ends by itself.

    With a `DuoBenchTeleoperator` in the same program, its page shows the task, and keep or discard
    there lays it out anew: LeRobot's programs tell a robot nothing about episodes.
    """

    config_class = DuoBenchRobotConfig

    def __init__(self, config: DuoBenchRobotConfig) -> None:
        super().__init__(config, config.gripper, config.mount)
        self._env: gym.Env | None = None
        self._teleoperator: DuoBenchTeleoperator | None = None
        self._due = 0.0

    @property
    def is_connected(self) -> bool:
        """Whether the task is simulated."""
        return self._env is not None

    @property
    @check_if_not_connected
    def env(self) -> SimEnv:
        """The environment without its wrappers."""
        return sim_of(cast("gym.Env", self._env))

    @check_if_already_connected
    def connect(self, calibrate: bool = True) -> None:  # noqa: ARG002
        """Lay out the first episode.

        Raises:
            UnknownNameError: There is no such task, split, camera, look, gripper or mount.
            OptionError: A number is none, or the teleoperator leads another robot.
        """
        config = self.config
        base = make_base(
            config.task,
            cameras=tuple(config.views),
            image_size=config.image_size,
            split=config.split,
            look=config.look,
            gripper=config.gripper,
            mount=config.mount,
        )
        self._env = with_wrappers(base)  # without a time limit
        self._number = config.episode
        self._teleoperator = next(reversed(DuoBenchTeleoperator.connected), None)
        self._reset()

    @check_if_not_connected
    def get_observation(self) -> dict[str, Any]:
        """Where the arms are, and what the cameras see; after keep or discard, of a new layout."""
        if self._teleoperator is not None and self._teleoperator.is_connected:
            events = self._teleoperator.get_teleop_events()
            if events[TeleopEvents.TERMINATE_EPISODE]:
                self._number += 1
                self._reset()
        numbers = by_key(self._seen["agent_pos"])
        return {**numbers, **self._seen.get(PIXELS, {})}

    @check_if_not_connected
    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        """One control step; in real time it begins at the earliest 1/30 s after the one before.

        Args:
            action: The 16 numbers; what is out of range or too fast is clipped.

        Returns:
            What was sent to the arms.

        Raises:
            ActionError: A number is missing or not finite.
        """
        if self.config.real_time:
            time.sleep(max(0.0, self._due - time.monotonic()))
            self._due = time.monotonic() + 1.0 / CONTROL_HZ
        env = cast("gym.Env", self._env)
        numbers = [action[key] for key in KEYS if key in action]
        self._seen, _, _, _, self._info = env.step(numbers)
        self._steps += 1
        self._tell()
        return by_key(self._info["sent"])

    @property
    def progress(self) -> dict[str, Any]:
        """How far the task is: step, stage, max_stage, success and more, as the page shows it."""
        task, info = self.env.definition, self._info
        return {
            "title": task.title,
            "task": task.id,
            "instruction": info["instruction"],
            "next": info["current_subinstruction"],
            "stage": int(info["stage"]),
            "max_stage": int(info["max_stage"]),
            "stages": [stage.name for stage in task.stages],
            "success": bool(info["success"]),
            "step": self._steps,
            "count": self._number,
            "note": SOLVED if info["success"] else "",
        }

    @check_if_not_connected
    def disconnect(self) -> None:
        """End the simulation."""
        cast("gym.Env", self._env).close()
        self._env = None

    def _reset(self) -> None:
        """Lay out the episode of the current number; whoever leads begins there."""
        seed = episode_seed(self.env.task, self._number, self.config.split)
        self._seen, self._info = cast("gym.Env", self._env).reset(seed=seed)
        self._steps = 0
        if self._teleoperator is not None and self._teleoperator.is_connected:
            self._teleoperator.show_robot(self.env.simulation, self.env.look)
            self._teleoperator.place(self.env.backend.last_command)
            self._tell()

    def _tell(self) -> None:
        if self._teleoperator is not None:
            self._teleoperator.see(self.env.backend.read(), **self.progress)
