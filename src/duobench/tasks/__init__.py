"""Tasks: data and a few pure functions, one file each; and all words to write one of your own.

The objects for it are in `duobench.objects`.
"""

from typing import TYPE_CHECKING

from duobench.references import lazy

if TYPE_CHECKING:
    from duobench.randomness import ANY_YAW as ANY_YAW
    from duobench.randomness import Choice as Choice
    from duobench.randomness import Uniform as Uniform
    from duobench.randomness import around as around
    from duobench.robot.cameras import View as View
    from duobench.scene.naming import TABLE as TABLE
    from duobench.sim.layout import Layout as Layout
    from duobench.spatial import SE3 as SE3
    from duobench.stages.coordination import Carriage as Carriage
    from duobench.stages.coordination import carriage as carriage
    from duobench.stages.handover import Handover as Handover
    from duobench.stages.handover import handover as handover
    from duobench.stages.insertion import Port as Port
    from duobench.stages.insertion import inserted as inserted
    from duobench.stages.joining import Joining as Joining
    from duobench.stages.joining import joining as joining
    from duobench.stages.logic import Predicate as Predicate
    from duobench.stages.logic import StateView as StateView
    from duobench.stages.logic import all_of as all_of
    from duobench.stages.logic import any_of as any_of
    from duobench.stages.logic import held_for as held_for
    from duobench.stages.logic import since as since
    from duobench.stages.passage import Hole as Hole
    from duobench.stages.passage import Passage as Passage
    from duobench.stages.passage import passage as passage
    from duobench.stages.placing import low_over as low_over
    from duobench.stages.placing import placed as placed
    from duobench.stages.placing import put as put
    from duobench.stages.pouring import Pouring as Pouring
    from duobench.stages.pouring import pouring as pouring
    from duobench.stages.predicates import BoxRegion as BoxRegion
    from duobench.stages.predicates import CylinderRegion as CylinderRegion
    from duobench.stages.predicates import Region as Region
    from duobench.stages.predicates import arm_touches as arm_touches
    from duobench.stages.predicates import at_least as at_least
    from duobench.stages.predicates import grasped as grasped
    from duobench.stages.predicates import grasped_apart as grasped_apart
    from duobench.stages.predicates import hinge_open as hinge_open
    from duobench.stages.predicates import inside as inside
    from duobench.stages.predicates import lifted as lifted
    from duobench.stages.predicates import lifted_by_any as lifted_by_any
    from duobench.stages.predicates import off_table as off_table
    from duobench.stages.predicates import raised as raised
    from duobench.stages.predicates import released as released
    from duobench.stages.predicates import rests_on as rests_on
    from duobench.stages.predicates import still as still
    from duobench.stages.predicates import touches as touches
    from duobench.stages.predicates import touching as touching
    from duobench.stages.predicates import upright as upright
    from duobench.stages.predicates import variant as variant
    from duobench.stages.progress import Stage as Stage
    from duobench.stages.rolling import Rolling as Rolling
    from duobench.stages.rolling import rolling as rolling
    from duobench.stages.support import Support as Support
    from duobench.stages.support import support as support
    from duobench.tasks.catalog import get as get
    from duobench.tasks.catalog import names as names
    from duobench.tasks.task import Category as Category
    from duobench.tasks.task import Placement as Placement
    from duobench.tasks.task import Task as Task
    from duobench.types import SIDES as SIDES
    from duobench.types import Side as Side

lazy(__name__)
