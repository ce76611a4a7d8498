"""Which episode is played next, and which has failed too often."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable

from duobench.errors import MachineryError
from duobench.results.suite import Episode, TaskInfo

MAX_PLAYS = 3
"""How often an episode is begun before a fault of the machinery ends the run."""


class Schedule:
    """The episodes that wait to be played, task by task."""

    def __init__(self) -> None:
        """Begin without any."""
        self._waiting: dict[str, deque[Episode]] = {}
        self._faults: Counter[Episode] = Counter()

    @property
    def left(self) -> int:
        """How many episodes wait."""
        return sum(map(len, self._waiting.values()))

    def add(self, episodes: Iterable[Episode]) -> None:
        """Let episodes wait."""
        for episode in episodes:
            self._waiting.setdefault(episode.task.id, deque()).append(episode)

    def next(self, task: TaskInfo | None) -> Episode:
        """Take the next episode.

        Args:
            task: The task to go on with, if one of its episodes waits; else it is the one with most
                left.
        """
        longest = max(self._waiting.values(), key=len)
        queue = self._waiting.get(task.id) if task else None
        return (queue or longest).popleft()

    def replay(self, episode: Episode, fault: str) -> None:
        """Let an episode wait again that is unplayed, through a fault of the machinery.

        Raises:
            MachineryError: It had too many of them.
        """
        self.note_fault(episode, fault)
        self._waiting[episode.task.id].appendleft(episode)

    def note_fault(self, episode: Episode, fault: str) -> None:
        """Note a fault of the machinery.

        Raises:
            MachineryError: The episode had too many of them.
        """
        self._faults[episode] += 1
        if self._faults[episode] == MAX_PLAYS:
            raise MachineryError(
                f"{episode.task.id}, episode {episode.index} cannot be played; in each of "
                f"{MAX_PLAYS} attempts something failed, the last time: {fault} What is "
                "finished is kept, and the rest is still to be played."
            )
