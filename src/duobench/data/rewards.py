"""Rewards of recorded episodes, as the environment pays them."""

from typing import Any

import numpy as np

from duobench.core.errors import DataError
from duobench.core.types import Array
from duobench.data.images import ImageSource
from duobench.data.recording import Recording
from duobench.envs.rewards import (
    DENSE,
    PROGRESS,
    STAGE,
    reward_of,
)
from duobench.tasks.stages.progress import Progress


def rewards_of(
    recording: Recording, form: str, source: ImageSource | None = None
) -> Array:
    """The rewards (T,) of a form, as the environment pays them; zero after success.

    Args:
        recording: The episode.
        form: One of `REWARDS`.
        source: Shows the recorded states, for the form "dense".

    Raises:
        DataError: The dense reward is asked for of an episode on real arms, or of one whose states
            do not have the stages that were recorded.
    """
    values = recording.stage.astype(np.float64)
    if form == DENSE:
        if recording.info.is_real or source is None:
            raise DataError(
                f"An episode of {recording.info.task} was played on real arms, where nothing "
                f"measures the reward {DENSE!r}; {PROGRESS!r} and {STAGE!r} are known."
            )
        values += _nearness(recording, source)
    last = len(recording.info.subinstructions)
    rewards: Any = reward_of(form, values[:-1], values[1:], last)
    rewards[recording.steps :] = 0.0
    return rewards


def _nearness(recording: Recording, source: ImageSource) -> Array:
    """How near the next stage is in each row (T + 1,): recorded states are judged again."""
    simulation, progress = source.simulation, Progress(source.definition.stages)
    near = np.zeros(len(recording) + 1)
    for row, recorded in enumerate(recording.stage.tolist()):
        source.show(recording, row)
        if row:
            progress.update(simulation)
        else:
            progress.reset(simulation, simulation.variants)
        if progress.stage != recorded:
            raise DataError(
                f"An episode of {recording.info.task} is at stage {recorded} in row {row}, and by "
                f"its states at stage {progress.stage}: a person judged it, or the task is another "
                f"one now. So the reward {DENSE!r} is not known; {PROGRESS!r} and {STAGE!r} are."
            )
        near[row] = progress.nearness(simulation)
    return near
