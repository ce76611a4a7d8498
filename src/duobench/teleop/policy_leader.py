"""A policy that leads both arms while no hand does, and a person who may take over."""

from collections.abc import Mapping
from concurrent.futures import Future, wait
from dataclasses import replace
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np

from duobench.core.errors import (
    ActionError,
    DuoBenchError,
    PolicyError,
    PolicyFailedError,
    escaped,
)
from duobench.core.randomness import policy_seed
from duobench.core.types import Array, DuoState
from duobench.data import Actor, Recorder
from duobench.envs.action_conversion import ActionConverter
from duobench.envs.duo_env import Info, base_of
from duobench.envs.execution import optional_method
from duobench.policy.interruptible import InterruptiblePolicy
from duobench.policy.policy import Policy, as_chunk, check_fits
from duobench.results.suite import PAPER_EXECUTE
from duobench.teleop.intent import Intent, TeleopDevice
from duobench.teleop.messages import Alone, Message, Why

QUICK_S = 0.02
"""Seconds for which a turn waits for an answer; then the page goes on, and the world waits."""
REASONS = ("dropped", "stuck", "wrong object", "other")
"""Reasons of a take-over, in the order in which a key goes through them."""
LEADS = "The policy leads: squeeze a clutch to take over."
PAUSED = "The policy is paused."
LOST = "A hand that led was lost: the policy is paused."
NO_ARMS = (False, False)
"""Arms that a hand leads while the policy does."""


class PolicyLeader:
    """A policy that is asked as in an evaluation, in a thread of its own.

    Its cameras are rendered when it is asked, and at no other step. Of a chunk at most as many
    actions are executed as in the paper.

    Args:
        env: The environment, which the policy fits.
        policy: The policy, bound to the environment.
        actor: Actor that is recorded of its rows.
        waits: Whether a step waits for its answer, however long that takes.

    Raises:
        PolicyError: The policy does not fit the environment.
    """

    def __init__(
        self,
        env: gym.Env,
        policy: Policy,
        actor: Actor,
        *,
        waits: bool = False,
    ) -> None:
        check_fits(policy.metadata, env)
        self.actor = actor
        """Actor that is recorded of its rows."""
        self._env = env
        self._asked = InterruptiblePolicy(policy)
        self._waits = waits
        self._render = optional_method(env, "set_rendering")
        self._intend = optional_method(env, "intend")
        self._observe = env.get_wrapper_attr("observe")
        self._begun: Future[Any] | None = None
        self._has_failed = False
        self._answer: Future[Any] | None = None
        self._chunk: list[Array] = []
        self._render(False)

    def begin(self, info: Mapping[str, Any]) -> None:
        """Begin the episode that a reset has given its info."""
        self.forget()
        self._has_failed = False
        seed = policy_seed(
            base_of(self._env).task, info.get("seed") or 0, info["split"]
        )
        self._reset = partial(self._asked.begin_reset, info["instruction"], seed)
        self._begun = self._reset()

    def forget(self) -> None:
        """Throw away what it has answered, or is about to: it is asked anew."""
        self._chunk = []
        if self._answer is not None:
            self._answer.cancel()
            self._answer = None

    def next_action(self) -> Array | None:
        """The next action; None while the policy thinks.

        Raises:
            PolicyError: The policy failed. The next call resets it first, since its server may
                have been started again.
        """
        if not self._chunk:
            answer = self._answer or self._ask()
            if not wait([answer], None if self._waits else QUICK_S).done:
                return None
            self._answer = None
            try:
                self._take(answer)
            except PolicyError:
                self._has_failed = True
                raise
        return self._chunk.pop(0)

    def close(self) -> None:
        """Ask nothing more."""
        self._asked.close()

    def _ask(self) -> Future[Any]:
        """Render what the policy sees, and ask it."""
        if self._has_failed:
            self._begun, self._has_failed = self._reset(), False
        self._render(True)
        observation = self._observe()
        self._render(False)
        self._answer = self._asked.begin_act(observation)
        return self._answer

    def _check(self, action: Array) -> None:
        """Reject what is no action of the mode, such as a quaternion of zeros."""
        try:
            self._env.get_wrapper_attr("check_action")(action)
        except ActionError as error:
            raise PolicyError(str(error)) from error

    def _take(self, answer: Future[Any]) -> None:
        """Take over an answer; the reset before it has ended as well."""
        if self._begun is not None:
            _result(self._begun)
            self._begun = None
        (size,) = self._env.action_space.shape or (0,)
        chunk = as_chunk(_result(answer), size)[:PAPER_EXECUTE]
        for action in chunk:
            self._check(action)
        self._chunk = list(chunk)
        wanted = getattr(self._asked, "intended_action", None)
        if wanted is not None:
            self._intend(wanted)


def _result(answer: Future[Any]) -> Any:
    """What a policy has answered; a `PolicyError` whatever it, or its server, has raised."""
    error = answer.exception()
    if error is None:
        return answer.result()
    if isinstance(error, PolicyError):
        raise error
    is_ours = isinstance(error, DuoBenchError)
    words = str(error) if is_ours else f"{type(error).__name__}: {error}"
    raise PolicyFailedError(escaped(words)) from error


class SharedControl:
    """Decides each step who leads both arms: the hands, or a policy until they take over.

    Without a policy the hands always do. With one, a squeeze takes over, and its release gives back
    to the policy, which is asked anew. Neither moves a target by more than a step's limit: hands
    lead from where the arms are commanded to be, and what a policy asks for from there on is
    approached within the limits of the joints.

    Args:
        env: The recorder around the environment.
        device: Device of the operator.
        policy: The policy, if one plays.

    Raises:
        LeaderError: The device cannot be let go of, so that no policy can lead.
    """

    def __init__(
        self,
        env: Recorder,
        device: TeleopDevice,
        policy: PolicyLeader | None = None,
    ) -> None:
        self._env = env
        self._device = device
        self._policy = policy
        self._has_taken_over = False
        self._why = -1
        self.is_policy = policy is not None
        """Whether the policy leads now, or will when it goes on."""
        self.is_paused = False
        """Whether the policy does not go on before it is told to, and hands that let go stay in
        charge."""
        self.note = ""
        """A sentence about it for the operator, once it has changed."""
        if policy is not None:
            self._convert = ActionConverter(env, device.action_mode)
            device.follow(env.base.backend.last_command)

    def begin(self, info: Info) -> None:
        """Begin an episode; the policy leads first."""
        self._has_taken_over = False
        self.is_policy = self._policy is not None
        self.is_paused = False
        if self._policy is not None:
            self._policy.begin(info)

    def start(self) -> None:
        """Begin to lead: the squeeze that began the episode is no take-over."""
        if self._policy is not None:
            self._device.let_go()
            self.note = PAUSED if self.is_paused else LEADS

    def next(
        self,
        now_s: float,
        seen: DuoState,
    ) -> Intent | None:
        """The next action in the environment's mode; None while nothing leads.

        Raises:
            PolicyError: The policy failed; it is paused.
        """
        command = self._env.base.backend.last_command
        if self._policy is None:
            return self._device.intend(now_s, seen, command)
        if self.is_policy:
            self._device.follow(command)
        intent = self._device.intend(now_s, seen, command)
        is_led = any(intent.clutch)
        if is_led and self.is_policy:
            self._take_over(self._policy)
        elif not (is_led or self.is_policy or self.is_paused):
            self._give_back()
        if not self.is_policy:
            return replace(intent, action=self._convert(intent.action))
        return None if self.is_paused else self._of_policy(self._policy)

    def take(self, message: Message) -> bool:
        """Pause the policy or let it go on; note why the last take-over began.

        Returns:
            Whether that is what the message was about.
        """
        if self._policy is None or not isinstance(message, Alone | Why):
            return False
        if isinstance(message, Alone):
            self.is_paused = not self.is_paused
            self.is_policy |= not (self.is_paused or any(self._device.clutch))
            self._policy.forget()
            self.note = PAUSED if self.is_paused else "The policy goes on."
        else:
            self._explain(message.text.strip())
        return True

    def rest(self) -> Intent:
        """The action that leaves the command of both arms as it is."""
        hold = self._env.get_wrapper_attr("hold_action")()
        return Intent(
            action=hold,
            clutch=NO_ARMS,
            leads=False,
        )

    def _explain(self, why: str) -> None:
        """Note a reason; without words, the next one of `REASONS`."""
        if not self._has_taken_over:
            return
        if not why:
            self._why = (self._why + 1) % len(REASONS)
            why = REASONS[self._why]
        self._env.explain(why)
        self.note = f"Taken over: {why}."

    @property
    def status(self) -> dict[str, Any] | None:
        """Fields of a page about the policy; None without one."""
        if self._policy is None:
            return None
        return {
            "name": self._policy.actor.name,
            "leads": self.is_policy,
            "is_paused": self.is_paused,
            "is_explainable": self._has_taken_over,
        }

    def close(self) -> None:
        """Ask the policy nothing more."""
        if self._policy is not None:
            self._policy.close()

    def _take_over(self, policy: PolicyLeader) -> None:
        """Let the hands lead in the place of the policy."""
        policy.forget()
        self.is_policy = False
        self._has_taken_over = True
        self._why = -1
        self._env.take_over(self._env.actor)
        self.note = "You lead: N says why."

    def _give_back(self) -> None:
        """The hands have let go: the policy leads, unless they were lost."""
        self.is_paused = self._device.was_lost
        self.is_policy = not self.is_paused
        self.note = LOST if self.is_paused else "The policy leads."

    def _of_policy(self, policy: PolicyLeader) -> Intent | None:
        """The next action of the policy; None while it thinks."""
        try:
            action = policy.next_action()
        except PolicyError:
            self.is_paused = True
            raise
        if action is None:
            return None
        self._env.leader = policy.actor
        return Intent(
            action=np.asarray(action),
            clutch=NO_ARMS,
        )
