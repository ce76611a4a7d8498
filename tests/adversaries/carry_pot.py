"""How one might cheat in carry_pot."""

from __future__ import annotations

import math

from duobench.experts.handling import carry
from duobench.experts.motion import CAREFUL, NEAR, Arms, Script, down, follow, grip, release, wait
from duobench.experts.scripts.carry_pot import carry_over, grasp, land, let_go, lift
from duobench.objects.pot import HANDLE_OFFSET, HANDLE_Z, HEIGHT, PLATE
from duobench.scene.naming import TABLE
from duobench.sim.simulation import Simulation
from duobench.spatial import SE3
from duobench.tasks.carry_pot import OFF_CENTRE, TILT_DEGREES
from duobench.types import Side
from tests.adversaries.adversary import ONE, TURNS, Adversary, cheats
from tests.steps import by, pause, to

LEFT, RIGHT = Side.LEFT, Side.RIGHT
LOW = 0.025
"""Height in metres that clears the plate and is less than the stage asks for."""


def on_stove(sim: Simulation) -> bool:
    """The pot stands where it belongs, and no arm is at it."""
    x, y, _ = sim.relative_position("pot", "stove")
    return (
        sim.contacts.partners("pot") == {"stove"}
        and abs(x) <= OFF_CENTRE[0]
        and abs(y) <= OFF_CENTRE[1]
        and not any(sim.contacts.arm(side, f"pot/{side}_handle") for side in Side)
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
    """The left arm lifts its side of the pot, pulls the other one up onto the plate, lets go."""
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
    """The right arm carries the pot level: it holds an end of its handle at a slant, which a search
    found, and turns against the pot's weight as it lifts.
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
    """Both lift it once, and put it back."""
    start = arms.sim.pose("pot")
    yield from lift(arms)
    yield from carry(arms, "pot", start.moved(z=-0.005), speed=0.1)
    yield from let_go(arms)


def skim(arms: Arms) -> Script:
    """Both carry it, so low that it is hardly lifted."""
    yield from carry(arms, "pot", arms.sim.pose("pot").moved(z=LOW), speed=0.1)
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
    """The right arm lets go in the air, and takes its handle again."""
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


DOWN = (land, let_go)
cheat = cheats(on_stove)
ADVERSARIES: tuple[Adversary, ...] = (
    cheat("one arm carries the pot level", 1, carry_alone, **ONE, deed=level_and_alone, seed=3),
    cheat("one arm drags the pot onto the plate", 1, drag, **ONE),
    cheat(
        "one arm pushes it, then the other one drags it",
        1,
        *((grasp, RIGHT), (by, RIGHT, {"y": 0.04, "speed": 0.1}), (let_go, RIGHT), drag),
        **TURNS,
    ),
    cheat("both lift it once, then one arm drags it", 2, put_back, drag),
    cheat("both carry it without lifting it", 1, grasp, skim, *DOWN),
    cheat(
        "both put it on the plate's edge, one arm pushes it to the middle",
        2,
        *(lift, put_on_the_edge),
        seed=3,
    ),
    cheat("both let go 17 cm above the plate", 2, (hover, 0.17), let_go, deed=high),
    cheat(
        "both let go 2 cm above the plate",
        2,
        *((hover, 0.02), let_go),
        lacks="when both hands last had pot: pot is ",
    ),
    cheat(
        "both let go 2 cm above the plate, and grasp the handles again",
        2,
        *((hover, 0.02), (release, LEFT, RIGHT, {"opening": 0.3}), grasp, let_go),
    ),
    cheat(
        "one arm lets go above the plate",
        2,
        *(lift, over_plate, (pause, 10), (let_go, RIGHT)),
        *((by, LEFT, {"z": -0.045, "speed": 0.05}), (let_go, LEFT)),
    ),
    cheat(
        "one arm lets go 2 cm above the plate, the other one a moment later",
        2,
        *((hover, 0.02), (let_go, LEFT), (pause, 10), (let_go, RIGHT)),
    ),
    cheat(
        "one arm lets go in the air, and grasps its handle again",
        2,
        *(lift, (pause, 10), loosen, over_plate, *DOWN),
    ),
)
