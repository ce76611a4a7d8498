"""Rewards of a control step: the forms of the reward, and the one place that computes them."""

from typing import Any, TypeVar

from numpy.typing import NDArray

STAGE, PROGRESS, DENSE = "stage", "progress", "dense"
REWARDS = (STAGE, PROGRESS, DENSE)
"""Forms of the reward, by the names that `EnvConfig.reward` takes."""


N = TypeVar("N", float, NDArray[Any])


def reward_of(
    form: str,
    before: N,
    stage: N,
    last: int,
) -> Any:
    """The reward of one control step, of one episode or of many.

    "stage" is that of the paper, stage / last stage in every step: who waits at a stage is paid
    again and again, and who finishes is not, since the episode is over. "progress" is what the step
    adds to stage / last stage, so that rewards sum up to the final one: at most 1, and finishing
    returns more than waiting for every discount above 0. It is negative only where a stage falls:
    never in simulation, on real arms where a person takes a stage back. "dense" is the same of the
    stage and how near the next one is, see `stages.nearness`: rewards sum up to at most 1 as well,
    and what is undone is taken back.

    Args:
        form: One of `REWARDS`.
        before: The stage before the step, 0 to `last`, with "dense" and how near the next one was:
            a number, or an array of them.
        stage: The same after it.
        last: Number of the task's last stage.
    """
    return (stage if form == STAGE else stage - before) / last
