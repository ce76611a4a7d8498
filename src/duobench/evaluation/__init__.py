"""Evaluation: rollouts of a policy on a suite of tasks.

`rollout` plays an episode, `episode` makes a record of it, `runners` plays many. What records
add up to is in `duobench.results`.
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

lazy(__name__)
