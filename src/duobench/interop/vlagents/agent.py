"""A policy as an agent of VLAgents."""

from __future__ import annotations

import atexit
from _thread import interrupt_main
from collections.abc import Mapping
from concurrent.futures import Future
from threading import Lock
from typing import Any

from vlagents.policies.interface import Act, Agent, Obs  # pyright: ignore[reportMissingImports]

from duobench.errors import PolicyError
from duobench.interop.vlagents.environment import MODE, SEED, STEP
from duobench.interop.vlagents.messages import LEFT, as_act, as_observation
from duobench.policy import Policy, PolicyMetadata, as_chunk
from duobench.policy.registry import make

_CHECKPOINT = "{checkpoint_step}"
_NO_SEED = 0
"""Seed of the policy in environments that tell none."""


class PolicyAgent(Agent):
    """An agent that answers with a policy, for one episode at a time.

    An episode begins where our environments say so. Those of others say nothing: there it begins
    with the first observation, with another instruction, and after a client has left.
    """

    def __init__(
        self,
        policy: str,
        checkpoint_path: str | None = None,
        checkpoint_step: int | None = None,
        device: str | None = None,  # noqa: ARG002 - VLAgents gives one to all agents
    ) -> None:
        """Take the name of a policy; it is made in `initialize`.

        Args:
            policy: A baseline's name, `lerobot:PATH_OR_ID` or `module:attribute`; in it,
                `{checkpoint_step}` is replaced.
            checkpoint_path: Not used.
            checkpoint_step: The step whose checkpoint is evaluated.
            device: Not used: a policy chooses, among the devices that VLAgents leaves visible.
        """
        super().__init__("", checkpoint_path=checkpoint_path, checkpoint_step=checkpoint_step)
        self._name = policy.replace(_CHECKPOINT, str(checkpoint_step))
        self._policy: Policy | None = None
        self._lock = Lock()
        self._at: tuple[Any, Any] = (None, None)
        self._answer: Future[Act] | None = None

    def initialize(self) -> None:
        """Make the policy, or end the server, for which an evaluation would wait without end.

        Raises:
            DuoBenchError: If there is none of that name, or it cannot be made.
        """
        try:
            self._policy = make(self._name)
            if self._policy.metadata.object_state:
                raise PolicyError(
                    f"The policy {self._name!r} reads the state of the objects, for which "
                    "observations of VLAgents have no place. Evaluate it with duobench eval."
                )
        except BaseException:
            interrupt_main()  # the server calls this in a thread beside the main one
            raise
        atexit.register(getattr(self._policy, "close", lambda: None))

    def act(self, obs: Obs) -> Act:
        """The policy's next chunk of actions.

        Raises:
            PolicyError: If the observation is of no episode that is being played, or is not what
                the policy expects.
        """
        with self._lock:  # the server has a thread for each client
            if self._policy is None:
                raise PolicyError("The policy is not made yet: `initialize` comes first.")
            before, instruction = self.instruction, obs.language_instruction or ""
            super().act(obs)
            extra = obs.obs[LEFT].info if LEFT in obs.obs else {}
            seed, step = extra.get(SEED), extra.get(STEP)
            if self._answer and step is not None and (seed, step) == self._at:
                return self._answer.result()  # VLAgents' client asks again after any error
            observation = as_observation(obs)
            _check(self._policy.metadata, observation, extra.get(MODE))
            if step == 0 or (step is None and (not self._answer or instruction != before)):
                self._policy.reset(instruction, _NO_SEED if seed is None else seed)
            elif not self._answer or seed != self._at[0]:
                raise PolicyError(
                    "This observation continues an episode that is not the one being played. A "
                    "policy plays one episode at a time: start a server for each client."
                )
            self._at, self._answer = (seed, step), Future()
            try:
                chunk = as_chunk(self._policy.act(observation), width=None)
                self._answer.set_result(as_act(chunk))
            except Exception as error:
                self._answer.set_exception(error)
                raise
            return self._answer.result()

    def close(self, *_arguments: Any, **_options: Any) -> None:
        """Forget a client that has left; the server calls this for each, the policy stays."""
        super().close()
        if self._at[1] is None:
            self._answer = None


def _check(metadata: PolicyMetadata, observation: Mapping[str, Any], mode: str | None) -> None:
    """Reject an environment that the policy was not made for, as far as it tells.

    Raises:
        PolicyError: If an image is missing, or is of another size, or the action mode is another.
    """
    if mode not in (None, metadata.action_mode):
        raise PolicyError(
            f"The policy's actions are {metadata.action_mode!r}, the environment's {mode!r}. Set "
            "`action_mode` in env_kwargs."
        )
    images = observation.get("pixels", {})
    for camera in metadata.cameras:
        if camera not in images:
            raise PolicyError(
                f"The policy sees camera {camera!r}, the observation has "
                f"{', '.join(images) or 'none'}. Name it in the env_kwargs `cameras`."
            )
        size = images[camera].shape[:2]
        if metadata.image_size not in (None, size):
            raise PolicyError(
                f"The policy sees images of {metadata.image_size}, got {size}. Set `image_size` in "
                "env_kwargs to the policy's, and that of the evaluation to null."
            )
