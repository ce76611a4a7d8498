"""Plan of sessions: tasks, how many layouts of each, and how often each is led.

No file says how far a plan is: that follows from the episodes of the data set and the attempts that
are noted beside them, so that a plan may be ended, killed, enlarged, or followed by several
operators, also in several processes at once, each in a task of its own.
"""

from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from duobench.core.errors import DataError, LockedError, OptionError
from duobench.core.files import is_locked
from duobench.core.randomness import TRAIN, episode_seed
from duobench.data import Actor, DataSet, Recording
from duobench.data.attempts import of_task
from duobench.data.schema import EpisodeInfo
from duobench.tasks import catalog
from duobench.teleop.session_episodes import SessionEpisodes

if TYPE_CHECKING:
    from duobench.teleop.teleoperation import Teleoperation

FORM = "TASKS x LAYOUTS or TASKS x LAYOUTS x TIMES, such as 11x50 or bin_sort,carry_pot x 20 x 2"
"""Form of a plan."""
MOST_EPISODES = 10_000
"""Largest number of layouts, and of times that one is led: years of a person's work."""
_LONGEST = 1000
"""Characters of a plan."""
ELSEWHERE = "led in another session"
"""Word about a task that another process has locked."""
UNNAMED = "unnamed"
"""Word for an operator without a pseudonym."""
_SIGN = "x"


@dataclass(frozen=True, kw_only=True, slots=True)
class Plan:
    """Tasks in their order, and the episodes that are wanted of each."""

    tasks: tuple[str, ...]
    """Ids or import paths."""
    layouts: int
    """Number of layouts of each task, those of the split train from 0 on."""
    times: int = 1
    """Number of kept episodes of each layout."""

    def __post_init__(self) -> None:
        if not self.tasks:
            raise OptionError(f"A plan names at least one task; it is {FORM}.")
        if self.layouts < 1 or self.times < 1:
            raise OptionError(
                f"A session records at least one episode, got {self.layouts} x {self.times}."
            )
        if max(self.layouts, self.times) > MOST_EPISODES:
            raise OptionError(
                f"A plan has at most {MOST_EPISODES:,} layouts, each as often at most; got "
                f"{self.layouts} x {self.times}."
            )
        for task in self.ids:
            if self.ids.count(task) > 1:
                raise OptionError(f"A plan names a task once, got {task} twice.")

    @property
    def ids(self) -> tuple[str, ...]:
        """Ids of the tasks."""
        return tuple(map(catalog.id_of, self.tasks))

    @staticmethod
    def parse(text: str) -> "Plan":
        """Read a plan: a number of the benchmark's tasks, or their names with commas between.

        Raises:
            OptionError: The text is no plan.
            UnknownNameError, ImportPathError: A task does not exist.
        """
        if len(text) > _LONGEST:
            raise OptionError(f"A plan is {FORM}; got {len(text)} characters.")
        first, *parts = "".join(text.split()).split(_SIGN)
        numbers: list[int] = []
        while parts and len(numbers) < 2 and parts[-1].isdecimal():  # noqa: PLR2004
            numbers.insert(0, int(parts.pop()))
        named = _SIGN.join([first, *parts])
        if not numbers or not named:
            raise OptionError(f"A plan is {FORM}; got {text!r}.")
        layouts, *times = numbers
        return Plan(
            tasks=_tasks(named),
            layouts=layouts,
            times=times[0] if times else 1,
        )


def _tasks(named: str) -> tuple[str, ...]:
    """Tasks that a plan names, or the first ones of the benchmark by their number."""
    if named.isdecimal():
        known = catalog.names()
        if not 1 <= int(named) <= len(known):
            raise OptionError(f"The benchmark has {len(known)} tasks, got {named}.")
        return known[: int(named)]
    tasks = tuple(filter(None, named.split(",")))
    for task in tasks:
        catalog.get(task)
    return tasks


class TaskProgress:
    """Progress of a plan in one task, from the episodes and the attempts of a data set.

    Args:
        data: The data set; None counts what is noted here alone.
        task: Id of the task.
        layouts: Number of its layouts, or which ones.
        times: Number of wanted episodes of each.
    """

    def __init__(
        self,
        data: DataSet | None,
        task: str,
        layouts: int | range,
        times: int = 1,
    ) -> None:
        self._layouts = range(layouts) if isinstance(layouts, int) else layouts
        self._times = times
        self.wanted = len(self._layouts) * times
        """Number of wanted episodes."""
        self.operators = Counter[str]()
        """Kept episodes by the pseudonym of who led them."""
        self._data, self._task = data, task
        self._seeds = dict[int | None, int](
            (episode_seed(task, each, TRAIN), each) for each in self._layouts
        )
        self._attempts, self._kept = Counter[int](), Counter[int]()
        self._known: dict[Path, EpisodeInfo] = {}
        self.refresh()

    @property
    def kept(self) -> int:
        """Number of kept episodes that are wanted."""
        return sum(min(self._kept[each], self._times) for each in self._layouts)

    def next_layout(self) -> int | None:
        """Return the layout to lead next; None once each is kept as often as it is wanted.

        Layouts with fewer attempts come first, so that one that was given up comes back at the end.
        """
        left = filter(self.wants, self._layouts)
        return min(
            left,
            key=lambda each: (self._begun(each), each),
            default=None,
        )

    def wants(self, layout: int) -> bool:
        """Whether a layout is to be led again."""
        return layout in self._layouts and self._kept[layout] < self._times

    def note(
        self,
        layout: int,
        *,
        kept: bool,
    ) -> None:
        """Count an attempt; with a data set, which was told already, read that again."""
        if self._data is None:
            self._attempts[layout] += 1
            self._kept[layout] += kept
        self.refresh()

    def refresh(self) -> None:
        """Read what was added to the data set, perhaps by another process.

        Raises:
            FileError: The attempts cannot be read.
        """
        if self._data is None:
            return
        attempts = of_task(self._data, self._task)
        self._attempts = Counter(each.of_layout for each in attempts)
        self._kept, self.operators = Counter(), Counter()
        reviews = self._data.reviews
        for path in self._data.episodes(self._task):
            info = self._read(path)
            if info is None:
                continue
            outcome = reviews.of(path).judged(info).outcome
            layout = self._seeds.get(info.seed) if info.split == TRAIN else None
            if layout is not None and outcome is not None and outcome.kept:
                self._kept[layout] += 1
                self.operators[info.operator] += 1

    def _begun(self, layout: int) -> int:
        """Number of attempts at a layout, at least that of its kept episodes."""
        return max(self._attempts[layout], self._kept[layout])

    def _read(self, path: Path) -> EpisodeInfo | None:
        """Facts about an episode as it was recorded; None if its file cannot be read.

        A session goes on with such a file beside it, which `find_problems` names.
        """
        if path not in self._known:
            with suppress(DataError):
                self._known[path] = Recording.read_info(path)
        return self._known.get(path)


class PlannedSessions:
    """Sessions of a plan in a data set, one task after the other.

    A task that another process leads is left to it.

    Args:
        plan: The plan.
        data: The data set.
        make: Makes the session of a task that an actor leads.
        actor: Who leads first.

    Raises:
        FileError: The attempts at a task cannot be read.
    """

    def __init__(
        self,
        plan: Plan,
        data: DataSet,
        make: "Callable[[str, Actor], Teleoperation]",
        actor: Actor,
    ) -> None:
        self._tasks = dict(zip(plan.ids, plan.tasks, strict=True))
        self._data, self._make, self._actor = data, make, actor
        self.progress = {
            task: TaskProgress(data, task, plan.layouts, plan.times)
            for task in self._tasks
        }
        """Progress by the id of the task."""
        self._session: Teleoperation | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._close(forget=kind is None)

    def next(self) -> "Teleoperation | None":
        """Close the session that is open, and open the next one; None if there is none to open.

        It is that of the task that the operator chose, or of the first one that is not complete.

        Raises:
            LockedError: It would be the first session, and all tasks that are not complete are led
                in other ones.
        """
        before = self._session
        if before is not None:
            is_complete = self.progress[before.env.task].next_layout() is None
            # What was discarded waits for the task.
            self._close(forget=is_complete)
        chosen = "" if before is None else before.chosen
        elsewhere: list[str] = []
        for task in sorted(self._tasks, key=lambda each: each != chosen):
            progress = self.progress[task]
            progress.refresh()
            if progress.next_layout() is None:
                continue
            with suppress(LockedError):  # raised where another process is quicker
                if not self._is_led_elsewhere(task):
                    self._session = self._make(self._tasks[task], self._actor)
                    return self._session
            elsewhere.append(task)
        if before is None and elsewhere:
            raise LockedError(
                f"All that is left is {ELSEWHERE}: {', '.join(elsewhere)}."
            )
        return None

    @property
    def operators(self) -> list[str]:
        """Pseudonyms of who has led kept episodes."""
        names = {name for each in self.progress.values() for name in each.operators}
        return sorted(filter(None, names))

    def items(self) -> list[dict[str, Any]]:
        """Tasks as the page lists them, with their progress by operator as it is now."""
        for progress in self.progress.values():
            progress.refresh()
        return [self._item(task) for task in self._tasks]

    def _item(self, task: str) -> dict[str, Any]:
        """A task as the page lists it."""
        progress = self.progress[task]
        who = [
            f"{name or UNNAMED} {count}"
            for name, count in sorted(progress.operators.items())
        ]
        parts = [f"{progress.kept} of {progress.wanted}", ", ".join(who)]
        if self._is_led_elsewhere(task):
            parts.append(ELSEWHERE)
        return {
            "id": task,
            "title": catalog.get(self._tasks[task]).title,
            "detail": " · ".join(filter(None, parts)),
            "state": "success" if progress.next_layout() is None else "",
        }

    def _is_led_elsewhere(self, task: str) -> bool:
        """Whether another process has locked a task."""
        if self._session is not None and self._session.env.task == task:
            return False
        folder = SessionEpisodes.folder(self._data, task)
        return folder.exists() and is_locked(folder)

    def _close(self, *, forget: bool) -> None:
        """Close the session that is open; the next one has the operator of this one."""
        if self._session is not None:
            session, self._session = self._session, None
            self._actor = session.env.actor
            session.close(forget=forget)
