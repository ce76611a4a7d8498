"""Ways to carry a pot to the stove with both arms, and to seem to."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from duobench.core.spatial import SE3
from duobench.core.types import SIDES, Side
from duobench.tasks.carry_pot import OFF_CENTRE, TILT_DEGREES
from duobench.tasks.experts.handling import carry
from duobench.tasks.experts.motion import (
    CAREFUL,
    NEAR,
    Arms,
    Script,
    down,
    follow,
    grip,
    release,
    wait,
)
from duobench.tasks.experts.scripts.carry_pot import (
    HandleGrasp,
    carry_over,
    grasp,
    land,
    let_go,
    lift,
)
from duobench.world.objects.pot import HANDLE_OFFSET, HANDLE_Z, HEIGHT, PLATE
from duobench.world.scene.naming import TABLE
from duobench.world.sim.simulation import Simulation
from tests.steps import by, do, pause, to
from tests.ways.way import ONE, SLOW, TURNS, Way, cheats, random_tempo, ways_to

LEFT, RIGHT = Side.LEFT, Side.RIGHT
NEAR_X, NEAR_Y = 0.10, 0.08
"""How far from the plate's centre the pot's may be, in metres [task definitions]."""
MAX_TILT = math.radians(10.0)
"""Largest tilt of a pot that stands upright [task definitions]."""


def done(sim: Simulation) -> bool:
    """The pot stands upright and still near the middle of the plate, and no arm is at it."""
    x, y, _ = sim.relative_position("pot", "stove")
    parts = ("pot", "pot/left_handle", "pot/right_handle")
    hands = any(sim.contacts.arm(side, part) for side in SIDES for part in parts)
    return (
        not hands
        and sim.contacts.partners("pot") == {"stove"}
        and abs(x) <= NEAR_X
        and abs(y) <= NEAR_Y
        and sim.rotation("pot")[2, 2] >= math.cos(MAX_TILT)
        and sim.speed("pot")[0] < SLOW
    )


def level_and_alone(sim: Simulation) -> bool:
    """The pot is level in the air above the plate, in one hand."""
    x, y, z = sim.relative_position("pot", "stove")
    return (
        abs(x) <= OFF_CENTRE[0]
        and abs(y) <= OFF_CENTRE[1]
        and z > PLATE[2] + HEIGHT / 2 + 0.01
        and sim.rotation("pot")[2, 2] > math.cos(math.radians(TILT_DEGREES))
        and sim.contacts.gripper(RIGHT, "pot/right_handle")
        and not sim.contacts.partners("pot") & {"stove", TABLE}
    )


def middle(arms: Arms) -> tuple[float, float]:
    x, y, _ = arms.sim.position("stove")
    return x, y


def drag(arms: Arms) -> Script:
    yield from grasp(arms, LEFT)
    start = arms.targets[LEFT]
    yield from to(arms, LEFT, start.moved(z=0.07), speed=0.1)
    x, y = middle(arms)
    from_x, from_y, _ = arms.sim.position("pot")
    over = start.moved(x=x - from_x, y=y - from_y)
    yield from to(arms, LEFT, over.moved(z=0.09), speed=0.15)
    yield from wait(10)
    x_now, y_now, _ = arms.sim.position("pot")
    yield from to(arms, LEFT, over.moved(x=x - x_now, y=y - y_now, z=0.09), speed=0.1)
    yield from to(arms, LEFT, over.moved(x=x - x_now, y=y - y_now, z=PLATE[2]), speed=0.1)
    yield from let_go(arms, LEFT)


def carry_alone(arms: Arms) -> Script:
    """The right arm holds an end of its handle at a slant, which a search found, and turns against
    the pot's weight as it lifts.
    """
    pot = arms.sim.pose("pot") @ SE3.at(yaw=math.pi)
    end = pot @ SE3.at(0.035, HANDLE_OFFSET - 0.017, HANDLE_Z - 0.013)
    slant = SE3.about((1, 0, 0), 0.159) @ down(0, 0, 0, yaw=-1.362, tilt=0.391)
    tool = end @ slant @ SE3.at(yaw=math.pi)
    arms.openings[RIGHT.index] = 0.593
    yield from to(arms, RIGHT, tool @ SE3.at(z=-0.1), tolerance=NEAR)
    yield from to(arms, RIGHT, tool, speed=CAREFUL)
    yield from grip(arms, RIGHT)

    def up(fraction: float) -> dict[Side, SE3]:
        turn = end @ SE3.about((1, 0, 0), -0.34 * fraction) @ end.inverse()
        return {RIGHT: (turn @ tool).moved(z=0.1 * fraction)}

    yield from follow(arms, up, 2.5)
    yield from carry_over(arms, *middle(arms), RIGHT)
    yield from land(arms, RIGHT)
    yield from let_go(arms, RIGHT)


def put_back(arms: Arms) -> Script:
    start = arms.sim.pose("pot")
    yield from lift(arms)
    yield from carry(arms, "pot", start.moved(z=-0.005), speed=0.1)
    yield from let_go(arms)


def skim(arms: Arms) -> Script:
    """Both carry it so low that it clears the plate and is hardly lifted."""
    yield from carry(arms, "pot", arms.sim.pose("pot").moved(z=0.025), speed=0.1)
    yield from wait(10)
    x, y = middle(arms)
    low = arms.sim.pose("pot")
    goal = low.moved(x=x - low.translation[0], y=y - low.translation[1])
    yield from carry(arms, "pot", goal, speed=0.1)


def over_plate(arms: Arms) -> Script:
    yield from carry_over(arms, *middle(arms))


def hover(arms: Arms, height: float) -> Script:
    """Both carry it over the plate, so that it really is at a height above it in metres."""
    yield from lift(arms)
    yield from carry_over(arms, *middle(arms), height=max(height, 0.04))
    for _ in range(2):
        yield from wait(10)
        here = arms.sim.min_height("pot") - PLATE[2]
        yield from carry(arms, "pot", arms.sim.pose("pot").moved(z=height - here), speed=0.1)
    yield from wait(10)


def loosen(arms: Arms) -> Script:
    held = arms.targets[RIGHT]
    yield from release(arms, RIGHT, opening=0.3)
    yield from wait(5)
    yield from release(arms, RIGHT, opening=0.0)
    arms.targets[RIGHT] = held


def put_on_the_edge(arms: Arms) -> Script:
    """Both put it down on the plate's edge; one arm pushes it to the middle."""
    x, y = middle(arms)
    yield from carry_over(arms, x, y - 0.145)
    yield from land(arms)
    yield from let_go(arms)
    behind = arms.sim.position("pot")[1] - 0.22
    yield from grip(arms, RIGHT)
    yield from to(arms, RIGHT, down(x, behind, 0.16))
    yield from to(arms, RIGHT, down(x, behind, 0.045), speed=CAREFUL)
    pushing = arms.targets[RIGHT]
    for _ in follow(arms, lambda f: {RIGHT: pushing.moved(y=0.22 * f)}, 4.0):
        if arms.sim.position("pot")[1] > y - 0.05:
            break
        yield
    yield from to(arms, RIGHT, arms.tcp_pose(RIGHT).moved(y=-0.08), speed=0.2)


def high(sim: Simulation) -> bool:
    """The pot is in the air above the plate, and no gripper is at it."""
    x, y, z = sim.relative_position("pot", "stove")
    hands = any(sim.contacts.gripper(side, f"pot/{side}_handle") for side in Side)
    return not hands and abs(x) < OFF_CENTRE[0] and abs(y) < OFF_CENTRE[1] and z > HEIGHT / 2 + 0.1


def up_and_down(arms: Arms, height: float = 0.06) -> Script:
    """Both take the pot where it stands, lift it by so many metres, and put it down there."""
    yield from by(arms, LEFT, z=0.10)
    yield from by(arms, RIGHT, z=0.10)
    yield from grasp(arms)
    yield from carry(arms, "pot", arms.sim.pose("pot").moved(z=height), speed=0.1)
    yield from wait(10)
    yield from land(arms)
    yield from let_go(arms)


def walk(arms: Arms, step: float) -> Script:
    """The arms drag the pot to the plate in turns, so many metres at a time."""
    x, y = middle(arms)
    side = RIGHT
    while math.dist(arms.sim.position("pot")[:2], (x, y)) > 0.05:
        side = side.other
        yield from grasp(arms, side)
        start = arms.targets[side]
        here = arms.sim.position("pot")
        way = np.array([x, y]) - here[:2]
        way *= min(1.0, step / math.hypot(*way))
        yield from to(arms, side, start.moved(z=0.07), speed=0.1)
        yield from to(arms, side, start.moved(x=way[0], y=way[1], z=0.09), speed=0.15)
        yield from to(arms, side, start.moved(x=way[0], y=way[1], z=0.02), speed=0.1)
        yield from let_go(arms, side)


DOWN = (land, let_go)
cheat = cheats(done)
ADVERSARIES: dict[str, Way] = {
    "one arm carries the pot level": cheat(1, carry_alone, **ONE, deed=level_and_alone, seed=3),
    "one arm drags the pot onto the plate": cheat(1, drag, **ONE),
    "one arm pushes it, then the other one drags it": cheat(
        1,
        (grasp, RIGHT),
        (by, RIGHT, {"y": 0.04, "speed": 0.1}),
        (let_go, RIGHT),
        drag,
        **TURNS,
    ),
    "both lift it once, then one arm drags it": cheat(2, put_back, drag),
    **{
        f"one arm drags the pot onto the plate, then both lift it there by {mm} mm": cheat(
            2, drag, (up_and_down, mm / 1000)
        )
        for mm in (20, 60)
    },
    **{
        f"the arms walk the pot onto the plate by {cm} cm in turns, then both lift it": cheat(
            2, (walk, cm / 100), up_and_down
        )
        for cm in (12, 20)
    },
    "both carry it without lifting it": cheat(1, grasp, skim, *DOWN),
    "both put it on the plate's edge, one arm pushes it to the middle": cheat(
        2, lift, put_on_the_edge, seed=3
    ),
    "both let go 17 cm above the plate": cheat(2, (hover, 0.17), let_go, deed=high),
    "both let go 2 cm above the plate": cheat(
        2, (hover, 0.02), let_go, lacks="when both hands last had pot: pot is "
    ),
    "both let go 2 cm above the plate, and grasp the handles again": cheat(
        2, (hover, 0.02), (release, LEFT, RIGHT, {"opening": 0.3}), grasp, let_go
    ),
    "one arm lets go above the plate": cheat(
        2,
        lift,
        over_plate,
        (pause, 10),
        (let_go, RIGHT),
        (by, LEFT, {"z": -0.045, "speed": 0.05}),
        (let_go, LEFT),
    ),
    "one arm lets go 2 cm above the plate, the other one a moment later": cheat(
        2, (hover, 0.02), (let_go, LEFT), (pause, 10), (let_go, RIGHT)
    ),
    "one arm lets go in the air, and grasps its handle again": cheat(
        2, lift, (pause, 10), loosen, over_plate, *DOWN
    ),
}

# --- sincere ways ---------------------------------------------------------------------------------

LAG = 0.015
"""How much lower than told a pot that is lifted may be, in metres: the servos lag."""
LET_GO = 0.45
"""Opening of fingers that leave a handle."""
NEARLY, SETTLING = 0.015, 10
"""Height in metres above the plate at which the pot stops on its way down, and for how many control
steps: what is led from there to a height is let go at it."""


def lifted(sim: Simulation, height: float) -> bool:
    """Both hands are at the pot, and it is in the air and level: nobody goes on without that."""
    hands = all(sim.contacts.gripper(side, f"pot/{side}_handle") for side in SIDES)
    return (
        hands and sim.min_height("pot") > height and sim.rotation("pot")[2, 2] > math.cos(MAX_TILT)
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class Carrying:
    """How the pot is carried; the defaults are the expert's way."""

    hold: Mapping[Side, HandleGrasp] = field(default_factory=dict)
    """How each arm takes its handle."""
    lift: float = 0.06
    """How far the pot is lifted, in metres."""
    clearance: float = 0.04
    """Height above the plate at which it is carried, in metres."""
    place: tuple[float, float] = (0.0, 0.0)
    """Where it is put down, from the plate's centre, in the table frame and metres."""
    release: float = 0.0
    """Height above the plate to which it is led before it is let go; it is pressed down below 0."""
    speed: float = 0.06
    """How fast it is lowered, in m/s."""
    pause: int = 8
    """Control steps before it is let go."""
    order: tuple[tuple[Side, ...], ...] = (SIDES,)
    """The arms that let go together, one group after the other."""


def lower_to(arms: Arms, height: float, speed: float) -> Script:
    """Lower the pot from where it really is to a height above the plate in metres."""
    yield from wait(SETTLING)
    here = arms.sim.min_height("pot") - PLATE[2]
    yield from carry(arms, "pot", arms.sim.pose("pot").moved(z=height - here), speed=speed)


def put(arms: Arms, way: Carrying) -> Script:
    yield from grasp(arms, hold=way.hold)
    yield from carry(arms, "pot", arms.sim.pose("pot").moved(z=way.lift), speed=0.15)
    yield from wait(6)
    if not lifted(arms.sim, way.lift - LAG):
        return
    x, y, _ = arms.sim.position("stove")
    x, y = x + way.place[0], y + way.place[1]
    yield from carry_over(arms, x, y, height=way.clearance)
    yield from lower_to(arms, NEARLY, way.speed)
    yield from lower_to(arms, way.release, way.speed)
    yield from wait(way.pause)
    for sides in way.order:
        yield from let_go(arms, *sides)


def slip(arms: Arms, height: float, *sides: Side, lift: float = 0.06) -> Script:
    """The pot slips from both hands little above the plate, from some earlier than from the others;
    both take it again.
    """
    yield from hover(arms, height)
    if sides:
        yield from release(arms, *sides, opening=LET_GO)
        yield from wait(15)
    yield from release(arms, *SIDES, opening=LET_GO)
    yield from wait(15)
    yield from up_and_down(arms, lift)


way = ways_to(put, done, Carrying())


def _both(**changes: float) -> dict[Side, HandleGrasp]:
    return dict.fromkeys(SIDES, HandleGrasp(**changes))


LEFT_FIRST, RIGHT_FIRST = ((LEFT,), (RIGHT,)), ((RIGHT,), (LEFT,))
SINCERE: dict[str, Way] = {
    **{f"let go {mm} mm above the plate": way(release=mm / 1000) for mm in (0, 1, 3, 5, 8)},
    **{f"pressed {mm} mm into the plate": way(release=-mm / 1000) for mm in (1, 3, 5)},
    "handles at the fingertips": way(hold=_both(height=0.012)),
    "handles deep in the fingers": way(hold=_both(height=-0.008)),
    "handles taken near their ends, at opposite corners": way(
        hold={LEFT: HandleGrasp(along=0.02), RIGHT: HandleGrasp(along=-0.02)}
    ),
    "hands turned by 0.3 rad": way(hold=_both(yaw=0.3)),
    "hands turned about": way(hold=_both(yaw=math.pi)),
    "hands that lean": way(hold=_both(tilt=0.3)),
    "at the edge of the place": way(place=(-0.06, 0.08)),
    "carried high": way(lift=0.12, clearance=0.12),
    "lowered fast": way(speed=0.2, release=-0.002),
    "the left arm lets go first": way(order=LEFT_FIRST),
    "the right arm lets go first, pressed in": way(order=RIGHT_FIRST, release=-0.004),
    **{
        f"slipped from {mm} mm above the plate, lifted and put down": way(
            script=do((slip, mm / 1000))
        )
        for mm in (20, 40)
    },
    "slipped onto the plate, lifted by little more than 10 mm": way(
        script=do((slip, 0.04, {"lift": 0.02}))
    ),
    "slipped from one hand, then from the other": way(script=do((slip, 0.03, LEFT))),
    "slipped twice": way(script=do((slip, 0.04), (slip, 0.03))),
    "at half the speed": way(slowness=2),
    "trembling by 10 mrad": way(tremble=0.01),
    "trembling by 20 mrad": way(tremble=0.02),
    "trembling, let go 5 mm above the plate": way(release=0.005, tremble=0.01),
}


def sample(rng: np.random.Generator) -> Way:
    hold = {
        side: HandleGrasp(
            height=rng.uniform(-0.008, 0.014),
            along=rng.uniform(-0.02, 0.02),
            yaw=rng.uniform(-0.3, 0.3),
            tilt=rng.uniform(-0.2, 0.3),
        )
        for side in SIDES
    }
    orders = ((SIDES,), LEFT_FIRST, RIGHT_FIRST)
    order = orders[rng.choice(len(orders), p=(0.7, 0.15, 0.15))]
    tremble = float(rng.choice((0.0, 0.0, 0.01, 0.02)))
    # Who lets go one hand after the other puts the pot down first.
    highest = (0.008 if tremble == 0.0 else 0.004) if len(order) == 1 else 0.0
    return way(
        hold=hold,
        lift=rng.uniform(0.045, 0.12),
        clearance=rng.uniform(0.02, 0.10),
        place=(rng.uniform(-0.06, 0.06), rng.uniform(-0.08, 0.08)),
        release=rng.uniform(-0.005, highest),
        speed=rng.uniform(0.05, 0.15),
        pause=int(rng.integers(6, 15)),
        order=order,
        **random_tempo(rng) | {"tremble": tremble},
    )
