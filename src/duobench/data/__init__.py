"""Data: recordings of episodes, data sets of them, their replay and their export."""

from typing import TYPE_CHECKING

from duobench.core.references import lazy

if TYPE_CHECKING:
    from duobench.data.arrange import merge as merge, split as split
    from duobench.data.check import Problem as Problem, find_problems as find_problems
    from duobench.data.dataset import DataSet as DataSet
    from duobench.data.images import ImageSource as ImageSource
    from duobench.data.lerobot.export import (
        Exported as Exported,
        export_lerobot as export_lerobot,
    )
    from duobench.data.lerobot.options import (
        ActionSource as ActionSource,
        ExportOptions as ExportOptions,
        Pairing as Pairing,
        VideoCodec as VideoCodec,
    )
    from duobench.data.lerobot.transitions import (
        Transitions as Transitions,
        transitions as transitions,
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
    from duobench.data.used_rows import RowChoice as RowChoice
else:
    __getattr__, __dir__, __all__ = lazy(
        __name__,
        {
            "duobench.data.arrange": ["merge", "split"],
            "duobench.data.check": ["Problem", "find_problems"],
            "duobench.data.dataset": ["DataSet"],
            "duobench.data.images": ["ImageSource"],
            "duobench.data.lerobot.export": ["Exported", "export_lerobot"],
            "duobench.data.lerobot.options": [
                "ActionSource",
                "ExportOptions",
                "Pairing",
                "VideoCodec",
            ],
            "duobench.data.lerobot.transitions": ["Transitions", "transitions"],
            "duobench.data.page": ["write_page"],
            "duobench.data.recorder": ["Recorder"],
            "duobench.data.recording": ["Recording"],
            "duobench.data.schema": ["Actor", "ActorKind", "EpisodeInfo", "Outcome"],
            "duobench.data.summary": ["Summary", "summarize"],
            "duobench.data.used_rows": ["RowChoice"],
        },
    )
