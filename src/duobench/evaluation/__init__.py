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
    from duobench.evaluation.rollouts import (
        Observer as Observer,
        Watcher as Watcher,
        rollout as rollout,
    )
    from duobench.evaluation.video import VideoRecorder as VideoRecorder
else:
    __getattr__, __dir__, __all__ = lazy(
        __name__,
        {
            "duobench.envs.execution": ["Step"],
            "duobench.evaluation.episode": ["Job"],
            "duobench.evaluation.policies": [
                "ExpertPolicy",
                "PolicyChoice",
                "PolicySource",
                "source",
            ],
            "duobench.evaluation.rollouts": ["Observer", "Watcher", "rollout"],
            "duobench.evaluation.video": ["VideoRecorder"],
        },
    )
