"""Schedule of episodes: the next one to play, and those that are given up."""

from collections import Counter, deque
from collections.abc import Iterable, Mapping

from duobench.core.errors import (
    ConnectionLostError,
    MachineryError,
    PolicyEndedError,
    TaskFailedError,
    UnplayedError,
)
from duobench.results.attempts import (
    MACHINERY,
    MOST_POLICY_ENDS,
    POLICY,
    TASK,
)
from duobench.results.suite import Episode, TaskInfo

MAX_PLAYS = 3
"""Attempts at an episode before it is given up."""
LOST = "the connection to the policy was lost"


class AttemptLog:
    """Log of attempts at episodes, kept while they are played."""

    def __init__(self) -> None:
        self._policy_ends: Counter[Episode] = Counter()

    def begin(self, episode: Episode) -> None:
        """An attempt is going to begin."""

    def lose(self, episode: Episode, how: str) -> None:
        """It has ended without a record, in one of `duobench.results.attempts.ENDS`."""
        self._policy_ends[episode] += how == POLICY

    def policy_ends(self, episode: Episode) -> int:
        """Number of attempts in which the policy ended by itself, or was lost."""
        return self._policy_ends[episode]


def end_of(fault: MachineryError) -> str:
    """End of an attempt that a fault has ended, one of `duobench.results.attempts.ENDS`."""
    match fault:
        case TaskFailedError():
            return TASK
        case ConnectionLostError():
            return POLICY
        case _:
            return MACHINERY


def ended_twice(what: str, fault: str) -> PolicyEndedError:
    """The error of an episode in which a policy ended, or was lost, as often as it may."""
    return PolicyEndedError(
        f"In {MOST_POLICY_ENDS} attempts {what}, the last time: {fault}"
    )


class Schedule:
    """The episodes that wait to be played, task by task."""

    def __init__(self) -> None:
        self._waiting: dict[str, deque[Episode]] = {}
        self._quarantined: deque[Episode] = deque()
        self._faults: Counter[Episode] = Counter()
        self.abandoned: dict[Episode, UnplayedError] = {}
        """Episodes that are not played any more, and why."""

    @property
    def left(self) -> int:
        """Number of waiting episodes."""
        return sum(map(len, self._waiting.values())) + len(self._quarantined)

    @property
    def has_quarantined(self) -> bool:
        """Whether the next episode is played beside no other."""
        return bool(self._quarantined)

    def add(self, episodes: Iterable[Episode]) -> None:
        """Let episodes wait."""
        for episode in episodes:
            self._waiting.setdefault(episode.task.id, deque()).append(episode)

    def next(self, task: TaskInfo | None) -> Episode:
        """Take the next episode; those in quarantine come first.

        Args:
            task: The task to go on with, if one of its episodes waits; else it is the one with most
                left.
        """
        if self._quarantined:
            return self._quarantined.popleft()
        longest = max(self._waiting.values(), key=len)
        queue = self._waiting.get(task.id) if task else None
        return (queue or longest).popleft()

    def quarantine(self, episodes: Iterable[Episode]) -> None:
        """Let episodes wait of which one has hung or ended the policy of all of them.

        They are played one at a time, until it is known which one it was.
        """
        self._quarantined.extend(episodes)

    def replay(self, episodes: Iterable[Episode], death: str) -> None:
        """Let episodes wait again whose process has ended; after too many one is abandoned.

        How the process ended is said in words.
        """
        for episode in episodes:
            self._faults[episode] += 1
            if self._faults[episode] == MAX_PLAYS:
                self.abandoned[episode] = UnplayedError(
                    f"in each of {MAX_PLAYS} attempts something failed, the last time: {death}"
                )
            else:
                self._waiting[episode.task.id].appendleft(episode)

    def retry(self, episode: Episode, fault: str) -> None:
        """Let an episode wait again that could not be played where it was."""
        self.note_fault(episode, fault)
        self._waiting[episode.task.id].appendleft(episode)

    def note_fault(self, episode: Episode, fault: str) -> None:
        """Note a fault of what an episode needs, such as a server or a renderer."""
        self._faults[episode] += 1
        if self._faults[episode] == MAX_PLAYS:
            raise MachineryError(
                f"{episode.task.id}, episode {episode.index} cannot be played; in each of "
                f"{MAX_PLAYS} attempts something failed, the last time: {fault} What is "
                "finished is kept, and the rest is still to be played."
            )


def check_played(
    unplayed: Mapping[Episode, UnplayedError], *, has_shifts: bool = False
) -> None:
    """Raise an error that names episodes which could not be played, if there are any.

    It is a `TaskFailedError` if that is true of all of them, else an `UnplayedError`.
    """
    if unplayed:
        is_of_tasks = all(isinstance(why, TaskFailedError) for why in unplayed.values())
        raise (TaskFailedError if is_of_tasks else UnplayedError).of(
            {
                f"{each.task.id}, episode {each.index}"
                + f", {each.shift}" * has_shifts: str(why)
                for each, why in unplayed.items()
            }
        )
