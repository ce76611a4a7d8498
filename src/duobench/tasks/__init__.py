"""Tasks: data and a few pure functions, one file each; and all words to write one of your own.

The words are objects, placements, regions and what stages ask.
"""

from typing import TYPE_CHECKING

from duobench.core.references import lazy

if TYPE_CHECKING:
    from duobench.core.randomness import (
        ANY_YAW as ANY_YAW,
        Choice as Choice,
        Uniform as Uniform,
        around as around,
    )
    from duobench.core.spatial import SE3 as SE3
    from duobench.core.types import SIDES as SIDES, Side as Side
    from duobench.tasks.catalog import get as get, names as names
    from duobench.tasks.stages.coordination import (
        Carriage as Carriage,
        carriage as carriage,
    )
    from duobench.tasks.stages.handover import (
        Handover as Handover,
        handover as handover,
    )
    from duobench.tasks.stages.insertion import Port as Port, inserted as inserted
    from duobench.tasks.stages.joining import Joining as Joining, joining as joining
    from duobench.tasks.stages.logic import (
        Predicate as Predicate,
        StateView as StateView,
        all_of as all_of,
        any_of as any_of,
        held_for as held_for,
        since as since,
    )
    from duobench.tasks.stages.passage import (
        Hole as Hole,
        Passage as Passage,
        passage as passage,
    )
    from duobench.tasks.stages.placing import (
        low_over as low_over,
        placed as placed,
        put as put,
    )
    from duobench.tasks.stages.pouring import Pouring as Pouring, pouring as pouring
    from duobench.tasks.stages.predicates import (
        BoxRegion as BoxRegion,
        CylinderRegion as CylinderRegion,
        Region as Region,
        arm_touches as arm_touches,
        at_least as at_least,
        grasped as grasped,
        grasped_apart as grasped_apart,
        hinge_open as hinge_open,
        inside as inside,
        lifted as lifted,
        lifted_by_any as lifted_by_any,
        off_table as off_table,
        raised as raised,
        released as released,
        rests_on as rests_on,
        still as still,
        touches as touches,
        touching as touching,
        upright as upright,
        variant as variant,
    )
    from duobench.tasks.stages.progress import Stage as Stage
    from duobench.tasks.stages.rolling import Rolling as Rolling, rolling as rolling
    from duobench.tasks.stages.support import Support as Support, support as support
    from duobench.tasks.task import (
        Category as Category,
        Placement as Placement,
        Task as Task,
    )
    from duobench.world.objects import (
        BLACK as BLACK,
        CHARCOAL as CHARCOAL,
        CUBE_EDGE as CUBE_EDGE,
        LONG_BLOCK as LONG_BLOCK,
        PALE as PALE,
        RED as RED,
        WHITE as WHITE,
        WOOD as WOOD,
        YELLOW as YELLOW,
        Colour as Colour,
        Hinge as Hinge,
        Image as Image,
        Mesh as Mesh,
        Part as Part,
        Piece as Piece,
        Prop as Prop,
        Shape as Shape,
        Solid as Solid,
        Variant as Variant,
        block as block,
        box as box,
        circle as circle,
        corner_points as corner_points,
        cube as cube,
        cylinder as cylinder,
        hull as hull,
        long_block as long_block,
        mesh_object as mesh_object,
        mjcf_object as mjcf_object,
        prism as prism,
        ring_wall as ring_wall,
        sphere as sphere,
    )
    from duobench.world.robot.cameras import View as View
    from duobench.world.scene.naming import TABLE as TABLE
    from duobench.world.sim.layout import Layout as Layout
else:
    __getattr__, __dir__, __all__ = lazy(
        __name__,
        {
            "duobench.core.randomness": ["ANY_YAW", "Choice", "Uniform", "around"],
            "duobench.core.spatial": ["SE3"],
            "duobench.core.types": ["SIDES", "Side"],
            "duobench.tasks.catalog": ["get", "names"],
            "duobench.tasks.stages.coordination": ["Carriage", "carriage"],
            "duobench.tasks.stages.handover": ["Handover", "handover"],
            "duobench.tasks.stages.insertion": ["Port", "inserted"],
            "duobench.tasks.stages.joining": ["Joining", "joining"],
            "duobench.tasks.stages.logic": [
                "Predicate",
                "StateView",
                "all_of",
                "any_of",
                "held_for",
                "since",
            ],
            "duobench.tasks.stages.passage": ["Hole", "Passage", "passage"],
            "duobench.tasks.stages.placing": ["low_over", "placed", "put"],
            "duobench.tasks.stages.pouring": ["Pouring", "pouring"],
            "duobench.tasks.stages.predicates": [
                "BoxRegion",
                "CylinderRegion",
                "Region",
                "arm_touches",
                "at_least",
                "grasped",
                "grasped_apart",
                "hinge_open",
                "inside",
                "lifted",
                "lifted_by_any",
                "off_table",
                "raised",
                "released",
                "rests_on",
                "still",
                "touches",
                "touching",
                "upright",
                "variant",
            ],
            "duobench.tasks.stages.progress": ["Stage"],
            "duobench.tasks.stages.rolling": ["Rolling", "rolling"],
            "duobench.tasks.stages.support": ["Support", "support"],
            "duobench.tasks.task": ["Category", "Placement", "Task"],
            "duobench.world.objects": [
                "BLACK",
                "CHARCOAL",
                "CUBE_EDGE",
                "Colour",
                "Hinge",
                "Image",
                "LONG_BLOCK",
                "Mesh",
                "PALE",
                "Part",
                "Piece",
                "Prop",
                "RED",
                "Shape",
                "Solid",
                "Variant",
                "WHITE",
                "WOOD",
                "YELLOW",
                "block",
                "box",
                "circle",
                "corner_points",
                "cube",
                "cylinder",
                "hull",
                "long_block",
                "mesh_object",
                "mjcf_object",
                "prism",
                "ring_wall",
                "sphere",
            ],
            "duobench.world.robot.cameras": ["View"],
            "duobench.world.scene.naming": ["TABLE"],
            "duobench.world.sim.layout": ["Layout"],
        },
    )
