"""Run by the environment of vla-eval: one of its model servers, with nothing of DuoBench.

Writes its port into a file once it listens. The arguments are that file, whether the server gives
whole chunks or keeps them ("whole" or "kept"), and how long a chunk is.
"""

import sys
from pathlib import Path
from typing import Any

import anyio
import numpy as np
from vla_eval.model_servers.predict import PredictModelServer
from vla_eval.model_servers.serve import serve_async
from vla_eval.specs import GRIPPER_01, IMAGE_RGB, LANGUAGE, STATE_JOINT, DimSpec

UP = {1: -1.7, 3: -0.2}
"""Targets of joints of the left arm that lift its tool, in radians."""
OURS_IN_THEIRS = [*range(7), *range(8, 15), 7, 15]
"""Places of their numbers in our state: both arms, then both grippers."""


class LiftsServer(PredictModelServer):
    """Lifts the left arm, and keeps everything else where it is."""

    def __init__(self, *, length: int, **options: Any) -> None:
        super().__init__(**options)
        self.length = length

    def predict(self, obs: dict[str, Any], ctx: Any) -> dict[str, Any]:
        del ctx
        if obs["images"]["head"].shape != (224, 224, 3) or not obs["task_description"]:
            raise ValueError("this is not what was asked for")
        target = obs["states"][OURS_IN_THEIRS]
        for joint, value in UP.items():
            target[joint] = value
        return {"actions": np.tile(target, (self.length, 1))}

    def get_observation_params(self) -> dict[str, Any]:
        return {"send_state": True, "send_wrist_image": True}

    def get_action_spec(self) -> dict[str, DimSpec]:
        joints = DimSpec("joints", 7, "joint_positions")
        grippers = {"left_gripper": GRIPPER_01, "right_gripper": GRIPPER_01}
        return {"left_joints": joints, "right_joints": joints, **grippers}

    def get_observation_spec(self) -> dict[str, DimSpec]:
        return {"head": IMAGE_RGB, "state": STATE_JOINT, "language": LANGUAGE}


async def main(path: Path, is_kept: bool, length: int) -> None:
    server = LiftsServer(length=length, chunk_size=length if is_kept else None)
    async with anyio.create_task_group() as group:
        port = await group.start(serve_async, server, "127.0.0.1", 0)
        part = path.with_suffix(".part")
        part.write_text(str(port))
        part.replace(path)


if __name__ == "__main__":
    anyio.run(main, Path(sys.argv[1]), sys.argv[2] == "kept", int(sys.argv[3]))
