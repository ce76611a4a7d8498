"""Evaluation: rollouts of a policy on a suite of tasks, their records, and what they add up to.

From the inside out: `rollout` plays an episode, `episode` makes a record of it, `executor` plays
many (here, or in each `worker`), `evaluate` writes them into a `folder`, and `report` adds them up.
"""

from typing import TYPE_CHECKING

from duobench.references import lazy

if TYPE_CHECKING:
    from duobench.envs.execution import Step as Step
    from duobench.evaluation.choice import PolicyChoice as PolicyChoice
    from duobench.evaluation.demonstrations import Attempt as Attempt
    from duobench.evaluation.demonstrations import record as record
    from duobench.evaluation.episode import Job as Job
    from duobench.evaluation.evaluate import Observer as Observer
    from duobench.evaluation.evaluate import evaluate as evaluate
    from duobench.evaluation.executor import Executor as Executor
    from duobench.evaluation.executor import LocalExecutor as LocalExecutor
    from duobench.evaluation.executor import ProcessExecutor as ProcessExecutor
    from duobench.evaluation.folder import RunFolder as RunFolder
    from duobench.evaluation.limits import TimeLimits as TimeLimits
    from duobench.evaluation.metrics import Results as Results
    from duobench.evaluation.metrics import Score as Score
    from duobench.evaluation.metrics import TaskResult as TaskResult
    from duobench.evaluation.metrics import summarize as summarize
    from duobench.evaluation.metrics import wilson_interval as wilson_interval
    from duobench.evaluation.policies import ExpertPolicy as ExpertPolicy
    from duobench.evaluation.policies import PolicySource as PolicySource
    from duobench.evaluation.policies import source as source
    from duobench.evaluation.records import EpisodeRecord as EpisodeRecord
    from duobench.evaluation.report import read_results as read_results
    from duobench.evaluation.report import write_report as write_report
    from duobench.evaluation.rollout import Watcher as Watcher
    from duobench.evaluation.rollout import rollout as rollout
    from duobench.evaluation.suite import Episode as Episode
    from duobench.evaluation.suite import Run as Run
    from duobench.evaluation.suite import Suite as Suite
    from duobench.evaluation.suite import TaskInfo as TaskInfo
    from duobench.evaluation.suite import find_tasks as find_tasks
    from duobench.evaluation.video import VideoRecorder as VideoRecorder

lazy(__name__)
