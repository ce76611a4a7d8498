"""Steps of recorded episodes, as a learner of one's own takes them."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from duobench.core.errors import check_known
from duobench.core.types import OPENING_SLOTS, Array, DuoCommand
from duobench.data.dataset import DataSet
from duobench.data.images import ImageSource
from duobench.data.lerobot.actions import labels_of
from duobench.data.lerobot.options import ActionSource
from duobench.data.recording import Recording
from duobench.data.rewards import rewards_of
from duobench.data.used_rows import RowChoice, Steps, used_rows
from duobench.envs.action_labels import LABELS
from duobench.envs.action_modes import ACTION_MODES, JOINT, JOINT_RELATIVE
from duobench.envs.rewards import DENSE, PROGRESS, REWARDS


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Transitions:
    """The T steps of an episode until its success, or until its end, without idle ones."""

    recording: Recording
    """The episode as far, whose rows `ImageSource` shows."""
    rows: NDArray[np.int64]
    """Its row (T,) that was seen before each step."""
    next_rows: NDArray[np.int64]
    """Its row (T,) that was seen after each step."""
    observation: dict[str, NDArray[np.float32]]
    """What was seen before each step (T, n), by the names of the environment."""
    action: NDArray[np.float32]
    """What was done (T, m)."""
    reward: Array
    """What the steps paid (T,)."""
    next_observation: dict[str, NDArray[np.float32]]
    """What was seen after each step (T, n)."""
    terminated: NDArray[np.bool_]
    """Whether the task was solved by the step (T,)."""
    truncated: NDArray[np.bool_]
    """Whether the episode ended with it, unsolved (T,)."""


def transitions(
    data: DataSet,
    task: str,
    *,
    reward: str = PROGRESS,
    action_mode: str = JOINT.name,
    object_state: bool = False,
    choice: RowChoice | None = None,
) -> Iterator[Transitions]:
    """Demonstrations of a task as an environment with the same options would have given them.

    Actions are what the arms were sent, which is what led to the next observation: with all that
    an actor added to what it wanted. Discarded episodes are left out, and rows that were trimmed
    at a second look.

    Args:
        data: The data set.
        task: The task, by its id.
        reward: What a step pays: "progress", "stage" or "dense".
        action_mode: Mode of the actions.
        object_state: Whether observations hold `environment_state`.
        choice: Which rows are used; by default all but those in which an operator led nothing and
            nothing moved.

    Yields:
        The steps of an episode.

    Raises:
        UnknownNameError: There is no such task, reward or mode.
        DataError: An episode cannot be read, or was played on real arms where what the simulation
            knows is asked for, or states do not have the stages that were recorded.
    """
    check_known("reward", reward, REWARDS)
    check_known("action mode", action_mode, ACTION_MODES)
    source: ImageSource | None = None
    reviews = data.reviews
    for path in data.episodes_of([task]):
        whole = Recording.read(path)
        judgement = reviews.of(path)
        outcome = judgement.judged(whole.info).outcome
        if outcome is None or not outcome.kept:
            continue
        reference = data.reference(whole.info)
        if source is None and (object_state or reward == DENSE):
            source = ImageSource(reference, cameras=())
        played = whole.until(whole.steps)
        used = used_rows(
            played,
            choice or RowChoice(),
            reference,
            within=judgement.rows,
        )
        for stretch in used.stretches():
            yield _transitions(
                played, stretch.steps(), reward, action_mode, source, object_state
            )


def _transitions(
    recording: Recording,
    steps: Steps,
    reward: str,
    mode: str,
    source: ImageSource | None,
    has_objects: bool,
) -> Transitions:
    seen = {"agent_pos": recording.agent_pos, "tcp_pose": recording.tcp_pose}
    if has_objects and source is not None:
        rows = range(len(recording) + 1)
        seen["environment_state"] = np.array(
            [source.objects(recording, row) for row in rows]
        )
    is_last = np.arange(len(steps)) == len(steps) - 1
    is_solved = is_last & (steps.ends == recording.success_step)
    return Transitions(
        recording=recording,
        rows=steps.rows,
        next_rows=steps.ends,
        observation={name: rows[steps.rows] for name, rows in seen.items()},
        next_observation={name: rows[steps.ends] for name, rows in seen.items()},
        action=_sent(recording, steps, mode),
        reward=steps.added(rewards_of(recording, reward, source)),
        terminated=is_solved,
        truncated=is_last & ~is_solved,
    )


def _sent(
    recording: Recording,
    steps: Steps,
    mode: str,
) -> NDArray[np.float32]:
    """The actions (T, m) of a mode that send what was sent."""
    if mode == JOINT_RELATIVE.name:
        home = DuoCommand(
            joints=recording.info.robot.home,
            openings=np.ones(2),
        ).flat
        wanted = recording.sent[steps.rows]
        changes = wanted - np.vstack([home, recording.sent])[steps.before + 1]
        changes[:, OPENING_SLOTS] = wanted[:, OPENING_SLOTS]
        return changes.astype(np.float32)
    labels, _ = labels_of(recording, mode, ActionSource.SENT, steps)
    return LABELS[mode].to_actions(labels)
