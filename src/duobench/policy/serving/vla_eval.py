"""A policy at a model server of vla-eval 0.8, which is used without vla-eval.

Every message is a map of `type`, `payload`, `seq` and `timestamp`; only `hello` and `observation`
are answered. A specification, by which both sides say what they show and take, is a map of
component names to `name`, `dims`, `format` and more; formats without a name in vla-eval 0.8 are not
compared.
"""

import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import Any

import msgspec
from websockets.sync.client import ClientConnection

from duobench.core.errors import (
    MachineryError,
    MessageError,
    ServingError,
    escaped,
)
from duobench.core.versions import __version__
from duobench.envs import action_modes
from duobench.policy.batch import Batching, Chunk, Observation
from duobench.policy.policy import PolicyMetadata, dimensions
from duobench.policy.serving.codec import unpack
from duobench.policy.serving.connection import (
    LOST,
    ConnectedPolicy,
    actions_of,
    reported,
)
from duobench.policy.serving.limits import VLA_EVAL_PROTOCOL
from duobench.policy.serving.message_format import MessageFormat
from duobench.world.robot.cameras import CAMERAS

Spec = dict[str, Any]

_LONGEST_NAME = 80
"""Characters of a server's name and version that are kept."""

MODES: Mapping[tuple[str, str], str] = {
    ("joints", "none"): "joint",
    ("joints", "last_step"): "joint_relative",
    ("cartesian_tquat", "none"): "cartesian",
    ("cartesian_rotvec", "last_step"): "cartesian_relative",
}
"""The environment's action mode for their `control_mode` and `relative_to`; the last
`control_mode` is ours."""

_RGB, _RAW = "rgb_hwc_uint8", "raw"
_ARM: Mapping[str, tuple[Spec, ...]] = {
    "joint": ({"name": "joints", "dims": 7, "format": "joint_positions"},),
    "joint_relative": ({"name": "joints", "dims": 7, "format": "joint_delta_pos"},),
    "cartesian": (
        {"name": "position", "dims": 3, "format": "absolute_xyz"},
        {"name": "rotation", "dims": 4, "format": "quaternion_xyzw"},
    ),
    "cartesian_relative": (
        {"name": "position", "dims": 3, "format": "delta_xyz"},
        {"name": "rotation", "dims": 3, "format": "axis_angle"},
    ),
}
"""Components of an arm's action, by the environment's action mode; of another one, raw numbers."""
_GRIPPER = {"open_is_one": "continuous_01", "closed_is_one": "binary_close_01"}
_FORMATS = frozenset(
    {spec["format"] for specs in _ARM.values() for spec in specs}
    | set(_GRIPPER.values())
    | {
        "euler_xyz",
        "rot6d_interleaved",
        "binary_close_positive",
        "binary_close_negative",
    }
    | {"base_velocity3_torso1", "base_mode_01"}
)
"""Formats of an action whose meaning is known."""


class DeclaredSpec(msgspec.Struct, frozen=True):
    """Declaration of a server about one component: the meaning and count of its numbers."""

    format: str = ""
    dims: int = 0
    """0 if that is not said."""


class Declared(msgspec.Struct, frozen=True):
    """Declaration of a server: its needs of a benchmark, its actions and observations."""

    model_server: str = ""
    harness_version: str = ""
    observation_params: dict[str, Any] = {}
    action_spec: dict[str, DeclaredSpec] = {}
    observation_spec: dict[str, DeclaredSpec] = {}


class VlaEvalPolicy(ConnectedPolicy):
    """A policy at a model server, as a plain one; its noise follows from no seed."""

    health_path = "/health"
    _default_format = "vla_eval"
    _seq = 0
    _start_seq = 0
    _is_playing = False

    def close(self) -> None:
        """End the episode, and close the connection."""
        if self._connection is not None:
            with suppress(MachineryError, *LOST):
                self._end_episode(self._connection)
        self._drop()

    def _begin(self, connection: ClientConnection, seed: int) -> None:
        """Begin an episode, and end the one before; the server answers to neither."""
        self._end_episode(connection)
        task = {"name": self._instruction, "seed": seed}
        self._start_seq = self._send(connection, "episode_start", {"task": task})
        self._is_playing = True

    def _end_episode(self, connection: ClientConnection) -> None:
        if self._is_playing:
            self._send(connection, "episode_end", {})
        self._is_playing = False

    def _ask(self, connection: ClientConnection, observation: Observation) -> Chunk:
        """Return the chunk for an observation; a reply with a single action is a chunk of one."""
        request = self._format.request(observation, self._instruction)
        number = self._send(connection, "observation", request)
        kind, reply, seq = self._receive(connection)
        if kind == "error" and seq in (number, self._start_seq):
            self._drop()  # of one about the start, the observation is still to be answered
            raise reported(str(reply.get("error")))
        if kind not in ("action", "error"):
            raise MessageError(
                f"An observation is answered by an action, got {kind!r:.40}."
            )
        if seq != number:
            raise MessageError(
                f"Message {number} was answered, but the answer is to {seq!r:.40}."
            )
        actions = actions_of(reply, self._format.actions.key)
        return self._format.chunk([actions] if dimensions(actions) == 1 else actions)

    def _send(
        self, connection: ClientConnection, kind: str, payload: dict[str, Any]
    ) -> int:
        self._seq += 1
        message = {
            "type": kind,
            "payload": payload,
            "seq": self._seq,
            "timestamp": time.time(),
        }
        self._tell(connection, message, is_text_keyed=True)
        return self._seq

    def _receive(self, connection: ClientConnection) -> tuple[str, dict[str, Any], int]:
        frame = self._heard(connection)
        if isinstance(frame, str):
            raise MessageError("A message is binary, got text.")
        message = unpack(frame)
        kind, payload, seq = (message.get(name) for name in ("type", "payload", "seq"))
        if not (
            isinstance(kind, str) and isinstance(payload, dict) and type(seq) is int
        ):
            raise MessageError("A message has a type, a payload and a seq.")
        return kind, payload, seq

    def _handshake(
        self, connection: ClientConnection
    ) -> tuple[PolicyMetadata, Batching | None]:
        self._is_playing = (
            False  # the server has ended the episode on the last connection
        )
        ours = {"harness_version": __version__, "protocol_version": VLA_EVAL_PROTOCOL}
        self._send(connection, "hello", ours)
        try:
            kind, hello, _ = self._receive(connection)
        except MessageError as error:
            raise MachineryError(
                f"What answers is no model server of vla-eval: {error}"
            ) from error
        if kind != "hello":
            raise MachineryError(
                f"A model server of vla-eval says hello first, got {kind!r:.40}."
            )
        version = hello.get("protocol_version")
        if version != VLA_EVAL_PROTOCOL or isinstance(version, bool):
            raise ServingError(
                f"The server speaks version {version!r:.40} of vla-eval's protocol, this client "
                f"{VLA_EVAL_PROTOCOL}. Servers of vla-eval 0.8 do too."
            )
        try:
            declared = msgspec.convert(hello, Declared)
        except msgspec.ValidationError as error:
            raise ServingError(
                f"The server describes its policy wrongly: {error}."
            ) from error
        problems = [*contradictions(declared, self._format)]
        if problems:
            raise ServingError(
                f"The server and the format contradict each other: {'; '.join(problems)}. Use a "
                "format that says what this server does, or a server that was made for this one."
            )
        name = escaped(declared.model_server)[:_LONGEST_NAME] or "vla_eval"
        harness = escaped(declared.harness_version)[:_LONGEST_NAME] or "unknown"
        facts = {key: hello.get(key) for key in ("observation_params", "action_spec")}
        version = f"vla-eval {harness}, {name}"
        return self._metadata_from_format(name, version, (self._format, facts)), None


def action_spec(message_format: MessageFormat) -> dict[str, Spec]:
    """The components of an action, in their order."""
    specs: dict[str, Spec] = {}
    for part in message_format.actions.order:
        side, _, what = part.partition("_")
        if what == "gripper":
            form = _GRIPPER[message_format.gripper]
            specs[part] = {"name": what, "dims": 1, "format": form, "range": [0.0, 1.0]}
        else:
            size = action_modes.get(message_format.actions.mode).arm_size
            unnamed = {"name": what, "dims": size, "format": _RAW}
            for spec in _ARM.get(message_format.actions.mode, (unnamed,)):
                specs[f"{side}_{spec['name']}"] = dict(spec)
    return specs


def observation_spec(message_format: MessageFormat) -> dict[str, Spec]:
    """The components of an observation."""
    specs: dict[str, Spec] = {
        "language": {"name": "language", "dims": 0, "format": "language"}
    }
    form = _RGB if message_format.image_order == "hwc" else "rgb_chw_uint8"
    for key in message_format.images:
        specs[key.rpartition(".")[2]] = {"name": "image", "dims": 0, "format": form}
    for key, size in message_format.state_sizes.items():
        parts = message_format.state[key]
        has_poses = any(part.endswith("pose") for part in parts)
        specs["state" if len(message_format.state) == 1 else key] = {
            "name": "state",
            "dims": size,
            "format": "joint_positions_and_poses" if has_poses else "joint_positions",
            "description": f"{', '.join(parts)}: an arm is 7 joints in radians, a gripper 0 to 1, "
            "a pose x y z qx qy qz qw in metres in the table frame.",
        }
    return specs


def contradictions(declared: Declared, message_format: MessageFormat) -> Iterator[str]:
    """Contradictions between a server's declaration and a format, one phrase each."""
    yield from _of_actions(declared.action_spec, message_format)
    yield from _of_observations(declared.observation_spec, message_format)
    yield from _of_parameters(declared.observation_params, message_format)


def _of_actions(
    declared: Mapping[str, DeclaredSpec], message_format: MessageFormat
) -> Iterator[str]:
    ours = action_spec(message_format)
    formats = {spec["format"] for spec in ours.values()}
    for name, spec in declared.items():
        if spec.format in _FORMATS - formats:
            known = ", ".join(sorted(formats))
            yield f"it gives {name!r:.40} as {spec.format}, and the format's actions are {known}"
        elif name in ours and spec.dims not in (0, ours[name]["dims"]):
            yield f"it gives {spec.dims} numbers as {name!r}, and the format {ours[name]['dims']}"
    width = sum(message_format.action_sizes.values())
    given = sum(spec.dims for spec in declared.values())
    if given > width:
        yield f"its actions have {given} numbers, and the format's {width}"


def _of_observations(
    declared: Mapping[str, DeclaredSpec], message_format: MessageFormat
) -> Iterator[str]:
    ours = observation_spec(message_format)
    sizes = sum(message_format.state_sizes.values())
    for name, spec in declared.items():
        if spec.format == _RGB and not message_format.images:
            yield "it expects images, and the format shows none"
        elif spec.format == _RGB and message_format.image_order != "hwc":
            yield "it expects images with channels last, and the format's have them first"
        elif spec.format == _RGB and name in CAMERAS and name not in ours:
            yield f"it expects the image {name!r}, which the format does not show"
        elif name.startswith("state") and not message_format.state:
            yield "it expects a state, and the format has none"
        elif name.startswith("state") and spec.dims not in (0, sizes):
            yield f"it expects a state of {spec.dims} numbers, and the format's has {sizes}"


def _of_parameters(
    wanted: Mapping[str, Any], message_format: MessageFormat
) -> Iterator[str]:
    if wanted.get("send_state") and not message_format.state:
        yield "it asks for a state (send_state), and the format has none"
    cameras = set(message_format.images.values())
    if wanted.get("send_wrist_image") and not any(
        CAMERAS[name].arm for name in cameras
    ):
        yield "it asks for wrist images (send_wrist_image), and the format shows none"
    if wanted.get("binary_gripper"):
        yield "it asks for grippers that are rounded (binary_gripper), which an evaluation does not"
    asked = wanted.get("control_mode"), wanted.get("relative_to")
    mode = message_format.actions.mode
    ours = next((names for names, own in MODES.items() if own == mode), ("", ""))
    given = [
        (value, own)
        for value, own in zip(asked, ours, strict=True)
        if value is not None
    ]
    if any(str(value).lower() != own for value, own in given):
        control, relative = asked
        yield (
            f"its actions have control_mode {control!r:.40} and relative_to {relative!r:.40}, and "
            f"the format's are {mode}"
        )
