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
    from duobench.results.compare import (
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

lazy(__name__)
