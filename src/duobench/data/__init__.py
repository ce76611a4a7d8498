"""Data: recordings of episodes, data sets of them, their replay and their export."""

from typing import TYPE_CHECKING

from duobench.core.references import lazy

if TYPE_CHECKING:
    from duobench.data.arrange import merge as merge, split as split
    from duobench.data.check import Problem as Problem, find_problems as find_problems
    from duobench.data.dataset import DataSet as DataSet
    from duobench.data.images import ImageSource as ImageSource
    from duobench.data.lerobot.export import Exported as Exported, export_lerobot as export_lerobot
    from duobench.data.lerobot.options import (
        ActionSource as ActionSource,
        ExportOptions as ExportOptions,
        Pairing as Pairing,
    )
    from duobench.data.page import write_page as write_page
    from duobench.data.recorder import Recorder as Recorder
    from duobench.data.recording import Recording as Recording
    from duobench.data.schema import (
        Actor as Actor,
        ActorKind as ActorKind,
        EpisodeInfo as EpisodeInfo,
        Outcome as Outcome,
    )
    from duobench.data.summary import Summary as Summary, summarize as summarize

lazy(__name__)
