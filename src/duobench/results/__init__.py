"""Results: runs, the records of their episodes, scores, reports and comparisons.

Nothing here plays an episode; `duobench.evaluation` does.
"""

from typing import TYPE_CHECKING

from duobench.core.references import lazy

if TYPE_CHECKING:
    from duobench.results.bundle import (
        open_source as open_source,
        write_bundle as write_bundle,
    )
    from duobench.results.comparison import (
        compare as compare,
        write_comparison as write_comparison,
    )
    from duobench.results.folder import RunFolder as RunFolder
    from duobench.results.records import Record as Record
    from duobench.results.report import (
        read_results as read_results,
        write_report as write_report,
    )
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
else:
    __getattr__, __dir__, __all__ = lazy(
        __name__,
        {
            "duobench.results.bundle": ["open_source", "write_bundle"],
            "duobench.results.comparison": ["compare", "write_comparison"],
            "duobench.results.folder": ["RunFolder"],
            "duobench.results.records": ["Record"],
            "duobench.results.report": ["read_results", "write_report"],
            "duobench.results.run": ["Run", "TimeLimits"],
            "duobench.results.scores": [
                "Results",
                "Score",
                "TaskResult",
                "summarize",
                "wilson_interval",
            ],
            "duobench.results.suite": ["Episode", "Suite", "TaskInfo", "find_tasks"],
        },
    )
