"""Execution of chunks of actions, one control step each."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from duobench.core.errors import OptionError
from duobench.core.types import CONTROL_HZ, as_count, as_whole

MAX_LATENCY = 300
"""Longest latency in control steps: ten seconds, after which most episodes would be over."""


@dataclass(frozen=True, kw_only=True, slots=True)
class ChunkExecution:
    """Part of a policy's chunks that is executed, and its timing."""

    execute: int | None = None
    """Actions of a chunk that are executed before the policy is asked again, at most; None takes
    all."""
    latency: int = 0
    """Control steps from an observation to the first action of the chunk that answers it."""

    def __post_init__(self) -> None:
        if self.execute is not None and not as_count(self.execute):
            raise OptionError(
                f"The number of actions executed of a chunk is 1 or more, got {self.execute!r}."
            )
        latency = as_whole(self.latency)
        if latency is None or not 0 <= latency <= MAX_LATENCY:
            raise OptionError(
                f"A latency is a whole number of control steps, 0 to {MAX_LATENCY}, got "
                f"{self.latency!r}."
            )

    @property
    def latency_s(self) -> float:
        """The latency in seconds."""
        return self.latency / CONTROL_HZ


WHOLE_CHUNKS = ChunkExecution()
"""All actions of a chunk, at once."""


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    eq=False,
)
class Step:
    """One control step, as watchers see it."""

    number: int
    """Number of this control step in the episode, from 1."""
    action: NDArray[np.floating]
    """The action (n,) that was executed."""
    observation: dict[str, Any]
    """The observation afterwards; it has images only where they are needed."""
    reward: float
    """The reward of the step."""
    terminated: bool
    """Whether the environment ended the episode with this step."""
    truncated: bool
    """Whether the horizon ended the episode with this step, or arms that could not go on, for the
    `truncation_reason` in info."""
    info: dict[str, Any]
    """The environment's info."""

    @property
    def is_last(self) -> bool:
        """Whether the episode is over."""
        return self.terminated or self.truncated


def execute(
    env: gym.Env,
    chunk: NDArray[np.floating],
    *,
    before: int = 0,
    render_last: bool = False,
) -> Iterator[Step]:
    """Execute the actions (H, n) of a chunk in order, until its end or the episode's.

    Args:
        env: An environment that takes single actions.
        chunk: The actions.
        before: Control steps of the episode before this chunk.
        render_last: Whether to render the images of the last action's observation alone: an
            episode that ends before its chunk ends without. If not, nothing is switched.

    Yields:
        Each control step, which is executed when it is asked for.
    """
    render = optional_method(env, "set_rendering")
    last = before + len(chunk)
    for number, action in enumerate(chunk, before + 1):
        if render_last:
            render(number == last)
        observation, reward, terminated, truncated, info = env.step(action)
        step = Step(
            number=number,
            action=action,
            observation=observation,
            reward=float(reward),
            terminated=terminated,
            truncated=truncated,
            info=info,
        )
        yield step
        if step.is_last:
            return


def optional_method(env: gym.Env, name: str) -> Callable[..., None]:
    """A method of the wrapper that has it, wherever it is; nothing happens where none has."""
    try:
        return env.get_wrapper_attr(name)
    except AttributeError:
        return lambda *_arguments: None
