"""An agent at a server of VLAgents 0.3 as a policy, for `duobench serve`.

It asks with VLAgents' own client, which unpickles what its server sends: connect to servers that
you trust.
"""

import hashlib
import os
import re
import time
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import json_numpy  # pyright: ignore[reportMissingImports]
import numpy as np
from vlagents.client import (  # pyright: ignore[reportMissingImports]
    RemoteAgent,
    dataclass_from_dict,
)
from vlagents.policies.interface import (  # pyright: ignore[reportMissingImports]
    Act,
    Obs,
    SingleAct,
    SingleObs,
)

from duobench.core.errors import MachineryError, PolicyError, ServingError
from duobench.core.types import SIDES, Array, real_array
from duobench.policy.batch import Chunk, Observation
from duobench.policy.serving.address import WAIT_S
from duobench.policy.serving.limits import HEALTH_S
from duobench.policy.serving.message_format import (
    ActionFormat,
    MessageFormat,
    read_format,
)

AGENT_VARIABLE = "DUOBENCH_VLAGENTS_AGENT"
"""Environment variable with the agent's name and server, AGENT@HOST:PORT."""
FORMAT_VARIABLE = "DUOBENCH_VLAGENTS_FORMAT"
"""Environment variable with the name or the file of a format, if it is not `vlagents`."""
_FORMAT, _PROMPT = "vlagents", "language_instruction"
_ADDRESS = re.compile(r"(\w[\w./-]*)@([^\s@]+):(\d{1,5})")
_FIELD = re.compile(r"obs\.(left|right)\.(cameras\.\w+|joints|gripper|tquat)")
_LOADING_S = 600.0
"""Seconds that an agent may take to be loaded, before the first episode."""
_RETRY_S = 0.5
"""Pause between looks whether a server is there and its agent loaded, in seconds."""


class VLAgentsPolicy:
    """An agent at a server of VLAgents, as a policy whose noise follows from no seed.

    The server has no word for the start of an episode, so an agent that remembers something goes
    on with it. An observation is sent once: VLAgents' client would send it again after any error.
    """

    def __init__(self) -> None:
        self._address = _address(os.environ.get(AGENT_VARIABLE, ""))
        self._format = read_format(os.environ.get(FORMAT_VARIABLE, _FORMAT))
        _check(self._format)
        self._instruction = ""
        self._client = self._connected(_LOADING_S)
        if hasattr(self._client.c.root, "reset"):
            raise ServingError(
                "The server takes a `reset`, which VLAgents 0.3 does not know: its messages mean "
                "something else. Serve the agent with vlagents 0.3."
            )
        name = self._address[0]
        digest = hashlib.sha256(repr(self._format).encode()).hexdigest()[:16]
        self.metadata = self._format.metadata(
            f"vlagents {name}", f"{name}, format {digest}"
        )
        """Expectations of the agent, as its format says."""

    def reset(self, instruction: str, seed: int) -> None:  # noqa: ARG002 - it takes none
        """Take the instruction, and see whether the server is there: no episode fails by that."""
        self._instruction = instruction
        try:
            self._client.c.ping(timeout=HEALTH_S)
        except TimeoutError as error:
            raise MachineryError(
                "The server of VLAgents answers nothing any more."
            ) from error
        except Exception:  # noqa: BLE001 - any error ends the connection
            self._client = self._connected(WAIT_S)

    def act(self, observation: Observation) -> Chunk:
        """The agent's next actions (H, 16)."""
        message = self._format.request(observation, self._instruction)
        arms = {side: SingleObs(**_fields(arm)) for side, arm in message["obs"].items()}
        obs = Obs(obs=arms, language_instruction=message[_PROMPT])
        try:
            reply = self._client.c.root.act(json_numpy.dumps(asdict(obs)))
        except BaseException as error:
            if self._client.c.closed:  # all other errors are the agent's
                raise MachineryError("The server of VLAgents is gone.") from error
            raise
        act = dataclass_from_dict(Act, json_numpy.loads(reply))
        if not act.acts:
            raise PolicyError("The agent answers without any `acts`.")
        return self._format.chunk([_action(one) for one in act.acts])

    def close(self) -> None:
        """Close the connection."""
        self._client.close()

    def _connected(self, loading_s: float) -> RemoteAgent:
        """Connect, and wait for a server that is not there and for an agent that is loaded."""
        name, host, port = self._address
        client, start = None, time.monotonic()
        while True:
            try:
                client = client or RemoteAgent(
                    host,
                    port,
                    name,
                    image_size=None,
                )
                if client.is_initialized():
                    return client
                fault = "its agent is still being loaded, or could not be"
            except AssertionError as error:
                raise MachineryError(
                    "The server of VLAgents has another agent."
                ) from error
            except (OSError, EOFError) as error:
                client, fault = None, f"it does not answer: {error}"
            if time.monotonic() - start > (WAIT_S if client is None else loading_s):
                raise MachineryError(f"The server of VLAgents cannot be used; {fault}.")
            time.sleep(_RETRY_S)


def _address(text: str) -> tuple[str, str, int]:
    parts = _ADDRESS.fullmatch(text)
    if parts is None:
        raise ServingError(
            f"An agent of VLAgents is AGENT@HOST:PORT, such as test@127.0.0.1:8080, in "
            f"{AGENT_VARIABLE}; got {text!a}."
        )
    return parts[1], parts[2], int(parts[3])


def _fields(arm: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of an arm; its opening is a number."""
    return (
        {**arm, "gripper": float(arm["gripper"][0])} if "gripper" in arm else dict(arm)
    )


def _check(message_format: MessageFormat) -> None:
    keys = (*message_format.images, *message_format.state)
    actions = ActionFormat(mode=message_format.actions.mode)
    if (
        not all(map(_FIELD.fullmatch, keys))
        or not message_format.state
        or (message_format.prompt, message_format.actions) != (_PROMPT, actions)
    ):
        raise ServingError(
            f"The keys of a format for VLAgents are obs.ARM.joints, obs.ARM.gripper, "
            "obs.ARM.tquat and obs.ARM.cameras.NAME, with left or right for ARM; its prompt is "
            f"{_PROMPT!r}, and it says nothing of actions but their mode. The format {_FORMAT!r} "
            "is one of them."
        )


def _action(act: Mapping[str, SingleAct]) -> Array:
    """The numbers of both arms, each with the opening of its gripper at its end."""
    parts = [_arm(act, str(side)) for side in SIDES]
    left, right = map(len, parts)
    if left != right:
        raise PolicyError(
            f"The agent gives the left arm {left} numbers and the right one {right}, the opening "
            "included."
        )
    return np.concatenate(parts)


def _arm(act: Mapping[str, SingleAct], side: str) -> Array:
    arm = act.get(side)
    if arm is None or arm.action is None or arm.gripper is None:
        raise PolicyError(
            "An act has the arms `left` and `right`, each with an `action` and the opening of its "
            f"`gripper`; {side} has not. There is: {', '.join(act)[:200] or 'nothing'}."
        )
    try:
        action, gripper = (
            real_array(part, np.float64) for part in (arm.action, arm.gripper)
        )
    except (TypeError, ValueError, OverflowError) as error:
        raise PolicyError(f"The agent gives no numbers: {arm!r:.80}.") from error
    if action.ndim != 1 or gripper.size != 1:
        raise PolicyError(
            "An `action` is a list of numbers and a `gripper` is one number, got arrays of shape "
            f"{action.shape} and {gripper.shape}."
        )
    return np.append(action, gripper)
