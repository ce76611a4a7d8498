"""Rollout loop: one policy plays one episode in one environment, with watchers."""

from collections.abc import (
    Callable,
    Iterable,
    Iterator,
    Mapping,
    Sequence,
)
from contextlib import (
    AbstractContextManager,
    ExitStack,
    contextmanager,
    nullcontext,
)
from functools import partial
from typing import Any, Protocol, TypeVar

import gymnasium as gym
import numpy as np

from duobench.core.randomness import EVAL, policy_seed
from duobench.envs.config import SPLIT
from duobench.envs.duo_env import base_of
from duobench.envs.execution import (
    WHOLE_CHUNKS,
    ChunkExecution,
    Step,
    execute,
    optional_method,
)
from duobench.policy.policy import Policy, as_chunk, check_fits
from duobench.results.run import Run

Observation = Mapping[str, Any]
Info = Mapping[str, Any]
Played_contra = TypeVar("Played_contra", contravariant=True)
"""Finished episode: a `Record`, or an `Attempt` at a demonstration."""


class Watcher(Protocol):
    """Watcher of episodes: a recorder, a video, a progress bar.

    With an attribute `needs_frames` that is true, images are rendered at every control step, not
    only at those that the policy sees. What inherits from it need not have all of its methods.
    """

    def on_episode_start(
        self, env: gym.Env, observation: Observation, info: Info
    ) -> None:
        """The environment was reset, and the policy too."""

    def on_step(self, step: Step) -> None:
        """A control step was executed."""

    def on_episode_end(self, error: BaseException | None) -> None:
        """The episode is over; called exactly once, also if it never got to its start.

        Args:
            error: What made it crash, or None if it ended by itself.
        """


class Observer(Protocol[Played_contra]):
    """Display of a run's progress."""

    def on_run_start(self, run: Run, finished: Sequence[Played_contra]) -> None:
        """The run begins, or goes on with some episodes already finished."""
        ...

    def on_episode(self, played: Played_contra) -> None:
        """One more episode is finished, and written."""
        ...


def rollout(
    env: gym.Env,
    policy: Policy,
    *,
    seed: int,
    hashed: int | None = None,
    watchers: Iterable[Watcher] = (),
    busy: Callable[[], AbstractContextManager[Any]] = nullcontext,
    execution: ChunkExecution = WHOLE_CHUNKS,
) -> None:
    """Run one episode.

    The actions of a chunk are executed in order, until the episode is over, or only its first
    ones if the execution says so. With a latency of K steps, the chunk for the
    observation of step t is executed from step t + K on; until then the chunk before it
    goes on, and at the start of an episode the arms hold their command. So the policy is asked
    as often as without, and K actions always wait. A policy with a method
    `expect_latency(steps)` is told first.

    Images are rendered only when they are needed: by the policy, which sees one observation a
    chunk, or by a watcher that needs frames. At other steps the observation has no `pixels`,
    unless a wrapper around the environment is an `ObservationWrapper` or has an observation
    space of its own. A wrapper of any other kind that reads `pixels` must do without them where
    they are missing.

    A policy that disturbs its own actions may say in an attribute `intended_action` what it wanted
    its last action, a chunk of one, to be; that is what a recorder around the environment records.

    Args:
        env: An environment of the benchmark that takes single actions, in any wrappers.
        policy: The policy.
        seed: Seed of the reset. The policy gets a hash, `duobench.core.randomness.policy_seed`:
            an environment that is reset with that shows another layout.
        hashed: Seed for the policy in place of that hash.
        watchers: Called in this order.
        busy: Surrounds everything that the policy does, and the check of what it returned, which
            may wait for a lazy array.
        execution: Actions of a chunk that are executed, and when.

    Raises:
        PolicyError: If the policy does not fit the environment, or returns something that is no
            chunk of actions.
    """
    check_fits(policy.metadata, env)
    watching = tuple(watchers)
    asked = any(getattr(watcher, "needs_frames", False) for watcher in watching)
    needs_frames = asked or _changes_observations(env)
    render = optional_method(env, "set_rendering")
    with ExitStack() as ending:
        ending.callback(render, True)
        ending.enter_context(watched_by(watching))
        observation, info = env.reset(seed=seed)
        if hashed is None:
            hashed = policy_seed(base_of(env).task, seed, info.get(SPLIT) or EVAL)
        with busy():
            expect = getattr(policy, "expect_latency", None)
            if expect:
                expect(execution.latency)
            policy.reset(info["instruction"], hashed)
        for watcher in watching:
            watcher.on_episode_start(env, observation, info)
        if needs_frames:
            render(True)
        steps = _steps(
            env, policy, observation, busy, execution, render_last=not needs_frames
        )
        for step in steps:
            for watcher in watching:
                watcher.on_step(step)
            if step.is_last:
                break


def _steps(
    env: gym.Env,
    policy: Policy,
    observation: Observation,
    busy: Callable[[], AbstractContextManager[Any]],
    execution: ChunkExecution,
    *,
    render_last: bool,
) -> Iterator[Step]:
    """The steps of a policy without an end: when the episode is over, no more are to be taken."""
    (action_size,) = env.action_space.shape or (0,)
    held = np.asarray(env.get_wrapper_attr("hold_action")(), dtype=np.float32)
    waiting, number = np.tile(held, (execution.latency, 1)), 0
    while True:
        with busy():
            chunk = as_chunk(policy.act(observation), action_size)
            chunk = chunk[: execution.execute]
            wanted = getattr(policy, "intended_action", None)
            if wanted is not None:
                optional_method(env, "intend")(wanted)
        queue = np.concatenate([waiting, chunk])
        chunk, waiting = queue[: len(chunk)], queue[len(chunk) :]
        for step in execute(
            env,
            chunk,
            before=number,
            render_last=render_last,
        ):
            observation = step.observation
            number = step.number
            yield step


def _changes_observations(env: gym.Env) -> bool:
    """Whether a wrapper around the one that renders makes something of every observation."""
    while isinstance(env, gym.Wrapper) and not hasattr(env, "set_rendering"):
        space = env.env.observation_space
        if (
            isinstance(env, gym.ObservationWrapper)
            or env.observation_space is not space
        ):
            return True
        env = env.env
    return False


@contextmanager
def watched_by(watchers: Sequence[Watcher]) -> Iterator[None]:
    """Tell watchers in order how an episode ended, after errors in the block too."""
    with ExitStack() as ending:
        for watcher in reversed(watchers):
            ending.push(partial(_end, watcher))
        yield


def _end(
    watcher: Watcher, _kind: object, error: BaseException | None, _trace: object
) -> None:
    watcher.on_episode_end(error)
