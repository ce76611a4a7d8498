"""Evaluation: rollouts of a policy on a suite of tasks, their records, and what they add up to.

From the inside out: `rollout` plays an episode, `episode` makes a record of it, `executor` plays
many (here, or in each `worker`), `evaluate` writes them into a `folder`, and `report` adds them up.
"""

from typing import TYPE_CHECKING

from duobench.references import lazy

if TYPE_CHECKING:
    from duobench.evaluation.choice import PolicyChoice
    from duobench.evaluation.demonstrations import Attempt, record
    from duobench.evaluation.evaluate import Observer, evaluate
    from duobench.evaluation.executor import Executor, LocalExecutor, ProcessExecutor
    from duobench.evaluation.folder import RunFolder
    from duobench.evaluation.limits import TimeLimits
    from duobench.evaluation.metrics import Results, Score, TaskResult, summarize, wilson_interval
    from duobench.evaluation.policies import ExpertPolicy, PolicySource, source
    from duobench.evaluation.records import EpisodeRecord
    from duobench.evaluation.report import read_results, write_report
    from duobench.evaluation.rollout import Step, Watcher, rollout
    from duobench.evaluation.suite import Episode, Run, Suite, TaskInfo, find_tasks
    from duobench.evaluation.video import VideoRecorder

__all__ = [
    "Attempt",
    "Episode",
    "EpisodeRecord",
    "Executor",
    "ExpertPolicy",
    "LocalExecutor",
    "Observer",
    "PolicyChoice",
    "PolicySource",
    "ProcessExecutor",
    "Results",
    "Run",
    "RunFolder",
    "Score",
    "Step",
    "Suite",
    "TaskInfo",
    "TaskResult",
    "TimeLimits",
    "VideoRecorder",
    "Watcher",
    "evaluate",
    "find_tasks",
    "read_results",
    "record",
    "rollout",
    "source",
    "summarize",
    "wilson_interval",
    "write_report",
]

lazy(__name__)
