"""Tasks: data and a few pure functions, one file each; and all words to write one of your own.

The objects for it are in `duobench.objects`.
"""

from typing import TYPE_CHECKING

from duobench.references import lazy

if TYPE_CHECKING:
    from duobench.randomness import ANY_YAW, Choice, Uniform, around
    from duobench.scene.cameras import View
    from duobench.scene.naming import TABLE
    from duobench.sim.layout import Layout
    from duobench.spatial import SE3
    from duobench.stages.coordination import Carriage, carriage
    from duobench.stages.handover import Handover, handover
    from duobench.stages.insertion import Port, inserted
    from duobench.stages.joining import Joining, joining
    from duobench.stages.passage import Hole, Passage, passage
    from duobench.stages.pouring import Pouring, pouring
    from duobench.stages.predicates import (
        BoxRegion,
        CylinderRegion,
        Predicate,
        Region,
        StateView,
        all_of,
        any_of,
        arm_touches,
        at_least,
        grasped,
        grasped_apart,
        held_for,
        hinge_open,
        inside,
        lifted,
        lifted_by_any,
        off_table,
        raised,
        released,
        rests_on,
        since,
        still,
        touches,
        touching,
        upright,
        variant,
    )
    from duobench.stages.progress import Stage
    from duobench.stages.rolling import Rolling, rolling
    from duobench.stages.support import Support, support
    from duobench.tasks.catalog import get, names
    from duobench.tasks.task import Category, Placement, Task
    from duobench.types import SIDES, Side

__all__ = [
    "ANY_YAW",
    "SE3",
    "SIDES",
    "TABLE",
    "BoxRegion",
    "Carriage",
    "Category",
    "Choice",
    "CylinderRegion",
    "Handover",
    "Hole",
    "Joining",
    "Layout",
    "Passage",
    "Placement",
    "Port",
    "Pouring",
    "Predicate",
    "Region",
    "Rolling",
    "Side",
    "Stage",
    "StateView",
    "Support",
    "Task",
    "Uniform",
    "View",
    "all_of",
    "any_of",
    "arm_touches",
    "around",
    "at_least",
    "carriage",
    "get",
    "grasped",
    "grasped_apart",
    "handover",
    "held_for",
    "hinge_open",
    "inserted",
    "inside",
    "joining",
    "lifted",
    "lifted_by_any",
    "names",
    "off_table",
    "passage",
    "pouring",
    "raised",
    "released",
    "rests_on",
    "rolling",
    "since",
    "still",
    "support",
    "touches",
    "touching",
    "upright",
    "variant",
]

lazy(__name__)
