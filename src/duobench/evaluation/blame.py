"""Blame for errors: it depends on where an error was raised, not on its class."""

from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from enum import Enum, auto
from fnmatch import fnmatchcase
from types import TracebackType
from typing import Any

from duobench.core.errors import (
    DuoBenchError,
    MachineryError,
    TaskFailedError,
    escaped,
    foreign_traceback,
    is_machinery,
    traceback_text,
)


class ErrorPlace(Enum):
    """Places at which errors are raised while an episode is played."""

    RENDERING = auto()
    """Images of the policy, and videos."""
    TASK = auto()
    """A task's layouts, objects and stages."""
    ACTION = auto()
    """Physics of an action, which follows from nothing but the action."""


_PLACES: Mapping[str, ErrorPlace] = {
    "duobench.world.sim.rendering:*": ErrorPlace.RENDERING,
    "duobench.evaluation.video:*": ErrorPlace.RENDERING,
    "duobench.core.video:*": ErrorPlace.RENDERING,
    "duobench.world.objects.*:*": ErrorPlace.TASK,
    "duobench.world.scene.*:*": ErrorPlace.TASK,
    "duobench.world.sim.simulation:Simulation.__init__": ErrorPlace.TASK,
    "duobench.envs.sim_env:SimEnv._begin": ErrorPlace.TASK,
    "duobench.envs.sim_env:SimJudge.*": ErrorPlace.TASK,
    "duobench.tasks.*:*": ErrorPlace.TASK,
    "duobench.tasks.stages.*:*": ErrorPlace.TASK,
    "duobench.envs.*:*.check_action": ErrorPlace.ACTION,
    "duobench.world.kinematics.*:*": ErrorPlace.ACTION,
    "duobench.world.sim.backend:SimBackend.command": ErrorPlace.ACTION,
}
"""Places by the module and the function that lead to them: the outermost one counts."""


def _causes(error: BaseException) -> list[BaseException]:
    """An error, and what it was raised from: a generator makes another of `StopIteration`."""
    causes = [error]
    while (cause := causes[-1].__cause__) is not None and cause not in causes:
        causes.append(cause)
    return causes


def place_of(
    error: BaseException,
) -> tuple[ErrorPlace | None, BaseException, TracebackType | None]:
    """Place at which an error was raised, by which error, and its traceback from there on."""
    for cause in _causes(error):
        trace = cause.__traceback__
        while trace is not None:
            frame = trace.tb_frame
            name = f"{frame.f_globals.get('__name__')}:{frame.f_code.co_qualname}"
            for pattern, place in _PLACES.items():
                if fnmatchcase(name, pattern):
                    return place, cause, trace
            trace = trace.tb_next
    return None, error, None


def fault_of(error: BaseException, task: str) -> MachineryError:
    """Fault that an error stands for which is not the policy's."""
    if isinstance(error, MachineryError) and is_machinery(error):
        return error
    place, cause, trace = place_of(error)
    if place is ErrorPlace.TASK:
        text = foreign_traceback(cause.with_traceback(trace))
        return TaskFailedError(
            f"The task {task!r} itself failed, not the policy.\n{text}"
        )
    if isinstance(error, DuoBenchError):
        return MachineryError(str(error))
    if place is ErrorPlace.RENDERING:
        words = f"{type(error).__name__}: {error}"
        return MachineryError(escaped(f"Nothing can be rendered: {words}."))
    return MachineryError(f"The evaluation itself failed.\n{traceback_text(error)}")


@contextmanager
def before_policy(task: str) -> Iterator[None]:
    """Nothing that a block raises is the policy's, which was not asked yet."""
    try:
        yield
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        fault = fault_of(error, task)
        if isinstance(error, DuoBenchError) and not isinstance(fault, TaskFailedError):
            raise  # it says what is wrong, such as that nothing can be rendered
        raise fault from error


class Asking:
    """Errors that a policy has raised while it was asked."""

    def __init__(self) -> None:
        self._raised: BaseException | None = None

    @contextmanager
    def within(self, busy: AbstractContextManager[Any]) -> Iterator[None]:
        """The policy is asked in the block, inside another context."""
        try:
            with busy:
                yield
        except BaseException as error:
            self._raised = error
            raise

    def fault_of(self, error: BaseException, task: str) -> MachineryError | None:
        """Fault behind an error that ended an episode; None if it is the policy's."""
        is_own = (
            self._raised in _causes(error) or place_of(error)[0] is ErrorPlace.ACTION
        )
        return None if is_own and not is_machinery(error) else fault_of(error, task)
