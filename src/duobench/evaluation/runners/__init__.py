"""Playing many episodes: evaluations and demonstrations, here, in processes, or on a cluster."""

from typing import TYPE_CHECKING

from duobench.core.references import lazy

if TYPE_CHECKING:
    from duobench.evaluation.runners.evaluate import (
        Attempt as Attempt,
        evaluate as evaluate,
        record as record,
    )
    from duobench.evaluation.runners.executor import (
        Executor as Executor,
        LocalExecutor as LocalExecutor,
        ProcessExecutor as ProcessExecutor,
    )

lazy(__name__)
