"""Scripts that begin in the middle of an episode, from what they see of the simulator's state.

An expert begins where an episode does. A person who takes over from a policy finds hands anywhere,
closed around something or around nothing. An entry puts that right, and goes on with the parts of
the expert's script that are still to be done.
"""

import math
from collections.abc import Callable, Mapping
from typing import Any

from duobench.core.spatial import SE3, length
from duobench.core.types import SIDES, Side
from duobench.tasks.experts.expert import find_script
from duobench.tasks.experts.handling import pick, place
from duobench.tasks.experts.handover import (
    clasp,
    let_go,
    pick_bar,
    present,
    receive_pose,
    tool,
)
from duobench.tasks.experts.motion import (
    CAREFUL,
    NEAR,
    Arms,
    Script,
    down,
    grip,
    move,
    nearest_turn,
    release,
    together,
    wait,
)
from duobench.tasks.experts.scripts import (
    carry_pot as pot_script,
    join_blocks as join_script,
    transfer_cube as cube_script,
)
from duobench.tasks.join_blocks import DEPTH
from duobench.tasks.stages.insertion import MAX_OFFSET
from duobench.world.objects.joint_blocks import BAR, PEG_HEIGHT, PEG_LENGTH, WALL_PLATE
from duobench.world.objects.pot import HEIGHT
from duobench.world.robot.mounts import HOME_JOINTS

Entry = Callable[[Arms, int], Script]
"""Puts an episode right that is at a stage, which a page tells people too."""

_parts: Any = join_script  # its steps, which only its own script calls otherwise

BACK = 0.10
"""Way in metres that a hand goes back along its own axis before it goes anywhere else."""
BESIDE = 0.15
"""Distance in metres from an object within which a hand is in its way."""
IN_BOWL = 0.07
"""Distance in metres from the bowl's middle within which a block lies in it."""
ASLANT = (0.0, -0.6, -1.0)
"""Direction of the receiver's hand above the bowl and where it waits, as the expert has it."""
READY = tool((0.50, 0.22, 0.38), along=ASLANT, camera=(0.0, 1.0, 0.0))
DROP_HEIGHT = 0.075
"""Height in metres from which it lets the block fall."""
RAISED = 0.03
"""Height in metres above the table from which on a pot is in the air."""
LOW = 0.03
"""Height in metres below which a bar lies on the table, or on another one."""
JOINED = 2
"""Stage from which on it counts that the bars are joined."""
LIFT, PULL = 0.06, 0.05
"""Ways in metres by which bars are lifted off the table, and pulled apart."""
ASIDE, ASKEW = 0.025, math.radians(35.0)
"""How far from usual a bar may be in the hand, in metres and radians, to be led to its place."""
OFF, OFF_TURN = 0.002, math.radians(2.0)
"""How far in metres and radians bars may be off when they are pushed onto the wall."""
ROLLS = [SE3.about((1, 0, 0), n * math.pi / 2) for n in range(4)]
TURNS = {
    Side.LEFT: ROLLS,
    Side.RIGHT: [SE3.at(yaw=yaw) @ roll for yaw in (0.0, math.pi) for roll in ROLLS],
}
"""Turns after which a bar fits as well, in its own frame."""


def clear(arms: Arms, *sides: Side) -> Script:
    """Open hands, and bring them back to where an episode begins; both where none is given."""
    sides = sides or SIDES
    yield from release(arms, *sides)
    back = {side: arms.targets[side] @ SE3.at(z=-BACK) for side in sides}
    yield from move(arms, back, speed=CAREFUL, arrive=False)
    homes = arms.kinematics.forward(HOME_JOINTS)
    yield from move(arms, {side: homes[side] for side in sides}, tolerance=NEAR)


def anew(task: str) -> Entry:
    """An entry for any task whose objects still lie as its expert can take them."""
    script = find_script(task)

    def enter(arms: Arms, stage: int) -> Script:  # noqa: ARG001
        yield from clear(arms)
        yield from script(arms)

    return enter


def carry_pot(arms: Arms, stage: int) -> Script:  # noqa: ARG001
    """Carry the pot on if both hands hold it; put right what they do otherwise."""
    if _pot_is_on_plate(arms):
        yield from pot_script.let_go(arms)
        return
    is_held = all(arms.grasps(side, f"pot/{side}_handle") for side in SIDES)
    if not is_held:
        yield from clear(arms)
    if not is_held or arms.sim.position("pot")[2] < HEIGHT / 2 + RAISED:
        yield from pot_script.lift(arms)
    x, y, _ = arms.sim.position("stove")
    yield from pot_script.carry_over(arms, x, y)
    yield from pot_script.land(arms)
    yield from pot_script.let_go(arms)


def _pot_is_on_plate(arms: Arms) -> bool:
    x, y, _ = arms.sim.position("pot") - arms.sim.position("stove")
    is_near = max(abs(x), abs(y)) < IN_BOWL
    return is_near and arms.sim.contacts.between("pot", "stove")


def transfer_cube(arms: Arms, stage: int) -> Script:  # noqa: ARG001
    """Hand the block on from whichever hand holds it, and put it into the bowl."""
    bar = cube_script.BAR
    giver, receiver = bar.giver, bar.giver.other
    away = arms.sim.position(bar.body) - arms.sim.position("bowl")
    holds = {side: arms.grasps(side, bar.body) for side in SIDES}
    if length(away[:2]) < IN_BOWL and not any(holds.values()):
        yield from clear(arms, receiver)
        return
    if not holds[receiver]:
        yield from clear(arms, *(side for side in SIDES if not holds[side]))
        ready = {receiver: READY}
        yield from together(pick_bar(arms, bar), move(arms, ready, arrive=False))
        meeting = present(bar, cube_script.MEETING_POINT, cube_script.RISE)
        yield from move(arms, {giver: meeting}, tolerance=NEAR)
        end = receive_pose(arms, bar, cube_script.RECEIVER_GRIP, cube_script.SLANT)
        yield from clasp(arms, receiver, end)
    elif holds[giver]:
        yield from grip(arms, receiver)
        yield from wait(6)
    if length(arms.tcp_pose(giver).translation - arms.sim.position(bar.body)) < BESIDE:
        yield from let_go(arms, giver)
    x, y, _ = arms.sim.position("bowl")
    goal = tool((x, y, DROP_HEIGHT), along=ASLANT, camera=(0.0, 1.0, 0.0))
    yield from place(arms, receiver, goal, above=0.10, retreat=0.10)


def join_blocks(arms: Arms, stage: int) -> Script:
    """Take the bars that no hand holds well, plug them together, and push them onto the wall.

    It ends early where a bar was lost on the way.
    """
    missing = [side for side in SIDES if not _is_held_well(arms, side)]
    low = [side for side in missing if arms.sim.position(_parts._BARS[side])[2] < LOW]
    if missing:
        yield from clear(arms, *missing)
        yield from together(*(_take_bar(arms, side) for side in missing))
    if low:
        up = {side: arms.targets[side].moved(z=LIFT) for side in low}
        yield from move(arms, up, speed=CAREFUL, arrive=False)
    # What was plugged together in another way than by both hands does not count.
    if stage < JOINED or not _are_joined(arms):
        yield from _join_anew(arms)
    if not (_both_hold(arms) and _are_joined(arms)):
        return
    behind = -BAR[0] - _parts._TOUCHING
    to_wall = WALL_PLATE[0] / 2 + BAR[0] / 2 + _parts._TOUCHING
    front = arms.sim.pose("wall") @ SE3.at(-to_wall, 0.0, PEG_HEIGHT)
    before = front.moved(x=-PEG_LENGTH - _parts._BEFORE_WALL)
    for goal, speed in ((before, 0.10), (front, _parts._SLOW)):
        both = {Side.RIGHT: goal, Side.LEFT: goal.moved(x=behind)}
        yield from _lead(arms, both, speed=speed)
        if goal is before and _are_off(arms, both):
            yield from _parts._correct(arms, _as_they_lie(arms, both))
    yield from clear(arms)


def _join_anew(arms: Arms) -> Script:
    """Pull the held bars apart where they touch, and plug them together in front of the wall."""
    light, dark = (arms.sim.position(_parts._BARS[side]) for side in SIDES)
    between = length(dark - light)
    if between < BAR[0] + PEG_LENGTH:
        middle = SE3.at(*dark)
        straight = {Side.RIGHT: middle, Side.LEFT: middle.moved(x=-between)}
        yield from _lead(arms, straight, speed=_parts._SLOW)
        pulled = {Side.LEFT: middle.moved(x=-between - PULL)}
        yield from _lead(arms, pulled, speed=_parts._SLOW)
    meeting = SE3.at(_parts._MEETING_X, 0.0, PEG_HEIGHT)
    behind = meeting.moved(x=-BAR[0] - PEG_LENGTH - _parts._APART)
    apart = {Side.RIGHT: meeting, Side.LEFT: behind}
    yield from _lead(arms, apart, speed=CAREFUL)
    yield from _parts._correct(arms, _as_they_lie(arms, apart))
    if _both_hold(arms):
        joined = {Side.LEFT: meeting.moved(x=-BAR[0] - _parts._TOUCHING)}
        yield from _lead(arms, joined, speed=_parts._SLOW)


def _lead(arms: Arms, bars: Mapping[Side, SE3], *, speed: float) -> Script:
    """Move held bars as the expert does, in whatever way they lie."""
    yield from _parts._lead(arms, _as_they_lie(arms, bars), speed=speed)


def _take_bar(arms: Arms, side: Side) -> Script:
    """Close a hand on a bar wherever it lies, also on the wall."""
    bar = arms.sim.pose(_parts._BARS[side])
    yaw = nearest_turn(bar.yaw, math.pi)
    grasp = SE3(SE3.at(yaw=yaw).rotation, bar.translation) @ _grasp_of_bar(side)
    yield from pick(arms, side, grasp, above=0.10, lift=0.0)


def _grasp_of_bar(side: Side) -> SE3:
    """Tool that holds a bar well, in the frame of a bar that lies as it was laid out."""
    above = _parts._GRASP_HEIGHT - BAR[2] / 2
    return down(_parts._GRASP_X[side], 0.0, above, tilt=_parts._TILTS[side])


def _is_held_well(arms: Arms, side: Side) -> bool:
    """Whether a hand holds its bar about as it takes one."""
    bar = _parts._BARS[side]
    held = arms.sim.pose(bar).inverse() @ arms.tcp_pose(side)
    ways = (turn @ _grasp_of_bar(side) for turn in TURNS[side])
    aside, askew = min((held.distance(way) for way in ways), key=lambda off: off[1])
    return arms.grasps(side, bar) and aside < ASIDE and askew < ASKEW


def _both_hold(arms: Arms) -> bool:
    return all(arms.grasps(side, _parts._BARS[side]) for side in SIDES)


def _are_joined(arms: Arms) -> bool:
    """Whether the light bar's peg is in a socket of the dark one."""
    light, dark = (arms.sim.pose(_parts._BARS[side]) for side in SIDES)
    x, y, z = (dark.inverse() @ light).apply([BAR[0] / 2 + PEG_LENGTH, 0.0, 0.0])
    return BAR[0] / 2 - abs(x) > DEPTH and math.hypot(y, z) < MAX_OFFSET


def _are_off(arms: Arms, bars: Mapping[Side, SE3]) -> bool:
    """Whether a held bar is not quite where it is to be."""
    goals = _as_they_lie(arms, bars)
    away = [arms.sim.pose(_parts._BARS[side]).distance(goals[side]) for side in bars]
    return any(aside > OFF or askew > OFF_TURN for aside, askew in away)


def _as_they_lie(arms: Arms, bars: Mapping[Side, SE3]) -> dict[Side, SE3]:
    """Poses of held bars that do as well as given ones, turned as little as may be.

    Bars may have rolled onto their sides, and the dark one has two sockets.
    """
    return {
        side: min(
            (bar @ turn for turn in TURNS[side]),
            key=lambda way: arms.sim.pose(_parts._BARS[side]).distance(way)[1],
        )
        for side, bar in bars.items()
    }


ENTRIES: Mapping[str, Entry] = {
    "carry_pot": carry_pot,
    "join_blocks": join_blocks,
    "transfer_cube": transfer_cube,
}
"""Entries by the ids of their tasks; the others begin anew, see `entry`."""


def entry(task: str) -> Entry:
    """The entry of a task."""
    return ENTRIES.get(task) or anew(task)
