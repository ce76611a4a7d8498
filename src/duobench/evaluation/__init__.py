"""Evaluation: rollouts of a policy on a suite of tasks, their records, and what they add up to.

`rollout` plays an episode, `episode` makes a record of it, `runners` plays many.
"""

from typing import TYPE_CHECKING

from duobench.core.references import lazy

if TYPE_CHECKING:
    from duobench.envs.execution import Step as Step
    from duobench.evaluation.episode import Job as Job
    from duobench.evaluation.policies import (
        ExpertPolicy as ExpertPolicy,
        PolicyChoice as PolicyChoice,
        PolicySource as PolicySource,
        source as source,
    )
    from duobench.evaluation.rollout import (
        Observer as Observer,
        Watcher as Watcher,
        rollout as rollout,
    )
    from duobench.evaluation.video import VideoRecorder as VideoRecorder
    from duobench.results.bundle import open_source as open_source, write_bundle as write_bundle
    from duobench.results.folder import RunFolder as RunFolder
    from duobench.results.records import EpisodeRecord as EpisodeRecord
    from duobench.results.report import read_results as read_results, write_report as write_report
    from duobench.results.run import Run as Run, TimeLimits as TimeLimits
    from duobench.results.scores import (
        Results as Results,
        Score as Score,
        TaskResult as TaskResult,
        summarize as summarize,
        wilson_interval as wilson_interval,
    )
    from duobench.results.suite import (
        Episode as Episode,
        Suite as Suite,
        TaskInfo as TaskInfo,
        find_tasks as find_tasks,
    )

lazy(__name__)
