"""Drive the arms violently in every task, and say what breaks.

    python -m dev.tools.fuzz [--first SEED] [--seeds N] [--tasks NAME ...] [--workers N]
    python -m dev.tools.fuzz --replay FILE

The scripted expert of every task plays an episode of each seed. From states along it the arms
branch into control steps that no sane policy would send, through the action space of the
environment. After each step the engine must not have warned, nothing may be faster than it can
become, no joint faster than its limit allows, no object inside the table, and the stage no lower
than before. Kept episodes, in `dev/tools/fuzzed`, are played first: they broke an earlier version.

The same seeds play the same branches. What breaks is written with all actions from the reset on,
for `--replay`, and the exit code is 1.
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field, replace
from itertools import chain, product
from pathlib import Path
from types import MappingProxyType
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import duobench
from duobench.core.types import FLAT_SIZE, OPENING_SLOTS, SIDES, Array, DuoCommand
from duobench.envs.episode_state import EpisodeState
from duobench.envs.sim_env import sim_of
from duobench.tasks import catalog
from duobench.tasks.experts.expert import find_script
from duobench.tasks.experts.motion import Arms, Script, down, grip, move, wait
from duobench.world.objects.cup import HEIGHT
from duobench.world.objects.solid import corner_points
from duobench.world.robot.joints import VELOCITY_LIMITS
from duobench.world.robot.workcell import TABLE_X, TABLE_Y
from duobench.world.scene.workcell import TABLE_THICKNESS
from duobench.world.sim.simulation import Simulation

KEPT = Path(__file__).with_name("fuzzed")
"""Episodes that once broke."""
BRANCHES = 50
"""Branches of each episode."""
STEPS = 25
"""Control steps of a branch."""
MAX_SPEED, MAX_LINK_SPEED = 20.0, 15.0
"""No object and no link of the robot is faster, in m/s. Fingertips were seen at 11.7, where a
whipping arm drags joint 6 along, whose torque is limited, and it catches up at 19 rad/s; what such
an arm throws at 12.7. Marbles that a diverging engine fires exceed 1,000."""
MAX_DEPTH = 1.5 * TABLE_THICKNESS
"""No object is deeper in the table, in metres: what came out below went through. Contacts are soft:
a cube that a rushing arm pressed on the table was 28 mm deep for three control steps."""
FREE_JOINT_SPEED, FREE_STEPS = 1.1, 20
"""No joint is faster than this part of its speed limit, where the robot has touched nothing for so
many control steps, unless its motor brakes with all its torque: the other joints drive it then.
Seen: 1.09 in the branches of two seeds, 1.14 where all joints reverse at once."""
PUSHED_JOINT_SPEED, PUSHED_STEPS = 1.5, 2
"""No joint is faster than this part of its speed limit for more control steps than that, unless its
motor brakes so: what drives a joint of 12 N m then is the arm that hit something. Seen: 3.8 times
the limit, and 7 control steps."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Limits:
    """What an episode must keep to."""

    speed: float = MAX_SPEED
    """Greatest speed of an object, in m/s."""
    link_speed: float = MAX_LINK_SPEED
    """Greatest speed of a link of the robot, in m/s."""
    joint_speed: float = FREE_JOINT_SPEED
    """Greatest speed of a joint in free air, as a part of its limit."""
    depth: float = MAX_DEPTH
    """Greatest depth of an object in the table, in metres."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Extent:
    """How far episodes went within what they must keep to."""

    speed: float = 0.0
    """Greatest speed of an object so far, in m/s."""
    link_speed: float = 0.0
    """Greatest speed of a link of the robot so far, in m/s."""
    free_joint: float = 0.0
    """Greatest speed of a joint in free air so far, as a part of its limit."""
    pushed_joint: float = 0.0
    """The same of a joint of a robot that touched something."""
    fast_steps: int = 0
    """Most control steps that such a joint was too fast for, one after the other."""
    depth: float = 0.0
    """Greatest depth of an object in the table so far, in metres."""

    def widened(self, **seen: Any) -> Extent:
        """The same, or as far as was seen."""
        return replace(self, **{name: max(getattr(self, name), seen[name]) for name in seen})

    def __str__(self) -> str:
        """One line."""
        return (
            f"objects up to {self.speed:.1f} m/s, links {self.link_speed:.1f} m/s, joints "
            f"{self.free_joint:.2f} times their limits in free air, {self.pushed_joint:.2f} pushed "
            f"(over {PUSHED_JOINT_SPEED} for {self.fast_steps} steps), "
            f"{1000 * self.depth:.0f} mm in the table"
        )


@dataclass(frozen=True, kw_only=True, slots=True)
class Violation:
    """What broke, and how to get there again."""

    task: str
    """Id of the task."""
    seed: int
    """Seed of the layout."""
    branch: str
    """What was played: the expert, or which branch from where."""
    step: int
    """Control step of the episode after which it was found, from 1 on."""
    what: str
    """What it is."""
    layout: Mapping[str, Any]
    """The layout, in its JSON form."""
    actions: Array = field(repr=False)
    """All actions since the reset (n, 16)."""

    def __str__(self) -> str:
        """One line."""
        return f"{self.task}, seed {self.seed}, {self.branch}, step {self.step}: {self.what}"

    def save(self, folder: Path) -> Path:
        """Write a file for `replay`, and give its path."""
        folder.mkdir(parents=True, exist_ok=True)
        name = f"{self.task}-{self.seed}-{re.sub(r'[^a-z0-9]+', '-', self.branch)}.npz"
        np.savez_compressed(
            folder / name,
            task=self.task,
            seed=self.seed,
            layout=json.dumps(self.layout),
            actions=self.actions,
        )
        return folder / name


class Watch:
    """Finds what is wrong with the state of an environment after a control step."""

    def __init__(self, env: gym.Env, limits: Limits) -> None:
        """Watch an environment, which must have been reset."""
        self._sim = sim_of(env).simulation
        self._limits = limits
        self._names = [self._sim.model.body(n).name for n in range(self._sim.model.nbody)]
        roots = [self._names[root] for root in self._sim.model.body_rootid]
        self._is_object = np.isin(roots, list(self._sim.props))
        self._max_speeds = np.where(self._is_object, limits.speed, limits.link_speed)
        self._max_stage = sim_of(env).definition.max_stage
        self._joints = _Joints(self._sim, np.isin(roots, [f"{side}/link0" for side in SIDES]))
        self.free_steps = 0
        """Control steps since the robot last touched something."""
        self._fast_steps = np.zeros(len(JOINT_SPEEDS), dtype=int)
        self.stage = 0
        """The stage so far."""
        self.fallen: frozenset[str] = frozenset()
        """Objects that fell beside the table; they may roll under it."""
        self.extent = Extent()
        """How far the state went so far."""

    def problem(self, observation: Mapping[str, Any], info: Mapping[str, Any]) -> str | None:
        """What is wrong after a step that gave this observation and info, if anything is."""
        return (
            self._not_finite(observation)
            or self._too_fast()
            or self._joint_too_fast()
            or self._in_table()
            or self._wrong_stage(info["stage"])
        )

    def _not_finite(self, observation: Mapping[str, Any]) -> str | None:
        numbers = np.hstack([self._sim.get_state(), *map(np.ravel, observation.values())])
        return None if np.isfinite(numbers).all() else "the state is not finite"

    def _too_fast(self) -> str | None:
        speeds = body_speeds(self._sim)
        self.extent = self.extent.widened(
            speed=speeds[self._is_object].max(), link_speed=speeds[~self._is_object].max()
        )
        worst = int((speeds - self._max_speeds).argmax())
        if speeds[worst] <= self._max_speeds[worst]:
            return None
        return f"{self._names[worst]} moves at {speeds[worst]:.1f} m/s"

    def go_on(self, start: Start) -> None:
        """Go on from a state that was saved."""
        self.stage, self.fallen, self.free_steps = start.stage, start.fallen, start.free_steps
        self._fast_steps[:] = 0

    def _joint_too_fast(self) -> str | None:
        peak = float((self._joints.peaks / JOINT_SPEEDS).max())
        self.free_steps = 0 if self._joints.touched else self.free_steps + 1
        if self.free_steps >= FREE_STEPS:
            self.extent = self.extent.widened(free_joint=peak)
            driven = self._joints.driven_peaks / JOINT_SPEEDS
            if driven.max() > self._limits.joint_speed:
                worst = int(driven.argmax())
                return f"joint {worst} turns at {driven[worst]:.2f} times its limit in free air"
        now = np.abs(self._joints.velocities()) / JOINT_SPEEDS
        self._fast_steps = (self._fast_steps + 1) * (now > PUSHED_JOINT_SPEED)
        fast = self._fast_steps > PUSHED_STEPS
        self.extent = self.extent.widened(pushed_joint=peak, fast_steps=self._fast_steps.max())
        if not (fast & ~self._joints.brake()).any():
            return None
        return f"joint {fast.argmax()} stays faster than its limit and does not brake"

    def _in_table(self) -> str | None:
        for name, prop in self._sim.props.items():
            if prop.fixed or self._sim.min_height(name) >= 0.0:
                continue
            x, y, z = self._sim.position(name).tolist()
            if z < 0.0 and _inset(np.array([[x, y]]))[0] < 0.0:
                self.fallen |= {name}
            elif name not in self.fallen:
                depth = depth_in_table(self._sim, name)
                self.extent = self.extent.widened(depth=depth)
                if depth > self._limits.depth:
                    return f"{name} is {1000 * depth:.0f} mm deep in the table"
        return None

    def _wrong_stage(self, stage: int) -> str | None:
        before, self.stage = self.stage, stage
        if before <= stage <= self._max_stage:
            return None
        return f"stage {stage} of {self._max_stage} after stage {before}"


JOINT_SPEEDS = np.tile(VELOCITY_LIMITS, len(SIDES))
"""Speed limits of the joints of both arms, in rad/s."""


class _Joints:
    """Sees how fast the joints are after every physics step of a control step."""

    def __init__(self, simulation: Simulation, is_robot: NDArray[np.bool_]) -> None:
        self._sim, duo, model = simulation, simulation.duo, simulation.model
        self._is_robot = is_robot[model.geom_bodyid]
        slots = np.arange(duo.actuators.start, duo.actuators.stop)
        self._motors = np.delete(slots, OPENING_SLOTS)
        self._torques = model.actuator_forcerange[self._motors, 1]
        self.peaks = np.zeros(len(JOINT_SPEEDS))
        """Greatest speeds in the last control step, in rad/s."""
        self.driven_peaks = self.peaks
        """The same of joints whose motors did not brake with all their torque."""
        self.touched = False
        """Whether the robot touched something in the last control step."""
        self._interpolate = duo.interpolate
        duo.interpolate = self._watched

    def _watched(self, command: DuoCommand) -> Iterator[None]:
        self.peaks, self.touched = np.zeros(len(JOINT_SPEEDS)), False
        self.driven_peaks = self.peaks
        for _ in self._interpolate(command):
            yield
            speeds = np.abs(self.velocities())
            self.peaks = np.maximum(self.peaks, speeds)
            self.driven_peaks = np.maximum(self.driven_peaks, speeds * ~self.brake())
            contact = self._sim.data.contact
            self.touched |= bool(self._is_robot[contact.geom[contact.dist <= 0.0]].any())

    def velocities(self) -> Array:
        """Velocities of all joints, in rad/s."""
        return self._sim.duo.joint_velocities().ravel()

    def brake(self) -> NDArray[np.bool_]:
        """Which motors brake with all their torque."""
        forces = self._sim.data.actuator_force[self._motors]
        return -forces * np.sign(self.velocities()) > 0.99 * self._torques


def body_speeds(simulation: Simulation) -> Array:
    """Speed of the centre of mass of every body, in m/s."""
    model, data = simulation.model, simulation.data
    arms = data.xipos - data.subtree_com[model.body_rootid]
    return np.linalg.norm(data.cvel[:, 3:] + np.cross(data.cvel[:, :3], arms), axis=1)


def depth_in_table(simulation: Simulation, name: str) -> float:
    """How deep in metres a prop's points are below the table top where the table is, 0 if none is.

    A point at the edge counts by its distance from there: one that touches the side from outside,
    or hangs over the edge, is not deep.
    """
    points = simulation.pose(name).apply(corner_points(simulation.props[name].solid))
    return max(0.0, float(np.minimum(-points[:, 2], _inset(points[:, :2])).max()))


def _inset(points: Array) -> Array:
    """How far points (n, 2) are inside the edges of the table top (n,), in metres."""
    (x0, x1), (y0, y1) = TABLE_X, TABLE_Y
    x, y = points.T
    return np.minimum.reduce([x - x0, x1 - x, y - y0, y1 - y])


# --- what the arms are told -----------------------------------------------------------------------

Violence = Callable[[np.random.Generator, Array, Array, Array], Array]
"""Array (STEPS, 16) from where the command is (16,), within bounds (16,) each."""


def extremes(rng: np.random.Generator, start: Array, low: Array, high: Array) -> Array:
    """All joints to ends of their ranges, other ends after some steps."""
    corners = np.where(rng.integers(2, size=(STEPS, FLAT_SIZE)), low, high)
    return _held(rng, np.repeat(corners, rng.integers(1, STEPS), axis=0)[:STEPS], start)


def leaps(rng: np.random.Generator, start: Array, low: Array, high: Array) -> Array:
    """A random step of half a radian of every joint, and half the stroke of the grippers."""
    steps = rng.choice((-0.5, 0.5), (STEPS, FLAT_SIZE))
    return _held(rng, np.clip(start + steps.cumsum(axis=0), low, high), start)


def slams(rng: np.random.Generator, start: Array, low: Array, high: Array) -> Array:
    """The arms stay, and each gripper opens and closes in a period of its own."""
    actions = np.tile(start, (STEPS, 1))
    for slot in OPENING_SLOTS:
        period, first = rng.integers(1, 9), rng.integers(2)
        actions[:, slot] = np.where((np.arange(STEPS) // period + first) % 2, high[slot], low[slot])
    return actions


def shakes(rng: np.random.Generator, start: Array, low: Array, high: Array) -> Array:
    """All joints to and fro with changing sign, the grippers as they are."""
    amplitude = rng.uniform(0.15, 1.0) * rng.choice((-1.0, 1.0), FLAT_SIZE)
    signs = 1 - 2 * (np.arange(STEPS) // rng.integers(1, 6) % 2)
    actions = np.clip(start + signs[:, None] * amplitude, low, high)
    actions[:, OPENING_SLOTS] = start[list(OPENING_SLOTS)]
    return actions


def _held(rng: np.random.Generator, actions: Array, start: Array) -> Array:
    """The same, with the grippers left as they are in every other branch."""
    if rng.integers(2):
        actions[:, OPENING_SLOTS] = start[list(OPENING_SLOTS)]
    return actions


KINDS: tuple[Violence, ...] = (extremes, shakes, leaps, slams)


# --- where branches begin -------------------------------------------------------------------------


def into_full_cup(arms: Arms) -> Script:
    """Drive half-open fingers among the marbles of pour_marbles, close them there, and open them.

    Closed, or at another yaw, a hand is too wide for the mouth of the cup.
    """
    side = next(side for side in SIDES if side == arms.sim.variants["full"])
    x, y, _ = arms.sim.position(f"{side}_cup").tolist()
    yield from grip(arms, side, opening=0.5)
    for height in (2 * HEIGHT, 0.0):
        yield from move(arms, {side: down(x, y, height, yaw=side.sign * math.pi / 4)})
    yield from grip(arms, side)
    yield from grip(arms, side, opening=1.0)


ROUTES: Mapping[str, Mapping[str, Callable[[Arms], Script]]] = MappingProxyType(
    {"pour_marbles": {"fingers in the full cup": into_full_cup}}
)
"""What leads to states of a task that its expert does not show, by name."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Start:
    """A state that a branch begins in."""

    state: EpisodeState
    """The whole state."""
    stage: int
    """Its stage."""
    fallen: frozenset[str]
    """Objects beside the table."""
    free_steps: int
    """Control steps since the robot last touched something."""
    actions: tuple[Array, ...]
    """The actions (16,) since the reset that led there."""


class Episode:
    """An episode that is watched, and goes back to earlier states."""

    def __init__(
        self, task: str, seed: int, limits: Limits, layout: Mapping[str, Any] | None = None
    ) -> None:
        """Reset an environment of a task to a layout, or to that of a seed."""
        self.env = duobench.make(task, cameras=False)
        self.seed = seed
        _, info = self.env.reset(options={"layout": layout} if layout else {"layout_seed": seed})
        self._layout: Mapping[str, Any] = info["layout"]
        self._watch = Watch(self.env, limits)
        self._actions: list[Array] = []
        self.is_over = False
        """Whether the last action ended the episode."""

    def step(self, action: Array, branch: str) -> Violation | None:
        """Play one action; what broke, if anything did."""
        self._actions.append(np.asarray(action, dtype=np.float64))
        try:
            observation, _, terminated, truncated, info = self.env.step(self._actions[-1])
            self.is_over = terminated or truncated
            what = self._watch.problem(observation, info)
        except Exception as error:  # noqa: BLE001 - whatever it is, it is what is looked for
            what = f"{type(error).__name__}: {error}"
        if what is None:
            return None
        return Violation(
            task=sim_of(self.env).task,
            seed=self.seed,
            branch=branch,
            step=len(self._actions),
            what=what,
            layout=self._layout,
            actions=np.array(self._actions),
        )

    def save(self) -> Start:
        """Where the episode is."""
        return Start(
            state=self.env.get_wrapper_attr("save_state")(),
            stage=self._watch.stage,
            fallen=self._watch.fallen,
            free_steps=self._watch.free_steps,
            actions=tuple(self._actions),
        )

    def restore(self, start: Start) -> None:
        """Go on from a state."""
        self.env.get_wrapper_attr("restore_state")(start.state)
        self._watch.go_on(start)
        self._actions = list(start.actions)
        self.is_over = False

    def play(self, actions: Iterable[Array], branch: str) -> Violation | None:
        """Play actions until something breaks, which is given, or the episode is over."""
        for action in actions:
            if found := self.step(action, branch):
                return found
            if self.is_over:
                break
        return None

    def end(self, found: Iterable[Violation | None]) -> Outcome:
        """Close the environment, and tell what was found."""
        self.env.close()
        return Outcome(
            violations=tuple(violation for violation in found if violation is not None),
            extent=self._watch.extent,
        )


# --- jobs -----------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True, slots=True)
class Job:
    """An episode and its branches, or a file to play again."""

    task: str
    """Id of the task."""
    seed: int = 0
    """Seed of the layout, and of all that is random."""
    branches: int = BRANCHES
    """How many branches."""
    limits: Limits = Limits()
    """What they must keep to."""
    file: Path | None = None
    """Played again, if it is given."""

    def __str__(self) -> str:
        """What it plays."""
        return f"{self.task}, seed {self.seed}" if self.file is None else self.file.name


@dataclass(frozen=True, kw_only=True, slots=True)
class Outcome:
    """What a job found."""

    violations: tuple[Violation, ...]
    """What broke."""
    extent: Extent
    """How far it went."""

    def __str__(self) -> str:
        """One line."""
        return f"{len(self.violations) or 'nothing'} broke; {self.extent}"


def play(job: Job) -> Outcome:
    """Play a job in this process."""
    if job.file is not None:
        return replay(job.file, job.limits)
    routes = {"expert": find_script(job.task), **ROUTES.get(job.task, {})}
    found: list[Violation | None] = []
    episode = Episode(job.task, job.seed, job.limits)
    beginning = episode.save()
    for route, script in routes.items():
        episode.restore(beginning)
        starts: list[Start] = []
        found.append(episode.play(_led(episode, script, starts), route))
        for branch in range(job.branches // len(routes)):
            found.append(_branch(episode, starts, route, branch))
    return episode.end(found)


def _led(
    episode: Episode, script: Callable[[Arms], Script], starts: list[Start]
) -> Iterator[Array]:
    """The actions of a script, which keeps still at its end; states on the way are appended."""
    arms = Arms(sim_of(episode.env).simulation)
    for _ in chain(script(arms), wait(STEPS)):
        starts.append(episode.save())
        yield arms.action()


def _branch(episode: Episode, starts: Sequence[Start], route: str, branch: int) -> Violation | None:
    """Play one branch, which follows from task, seed, route and number alone."""
    base = sim_of(episode.env)
    rng = np.random.default_rng([episode.seed, branch, *f"{base.task} {route}".encode()])
    start = starts[int(rng.integers(len(starts)))]
    episode.restore(start)
    kind = KINDS[branch % len(KINDS)]
    limits = base.backend.limits
    actions = kind(rng, base.hold_action(), limits.low, limits.high)
    return episode.play(
        actions, f"{route}, branch {branch} of {kind.__name__} from {len(start.actions)}"
    )


def replay(file: Path, limits: Limits = Limits()) -> Outcome:
    """Play a file again that `Violation.save` wrote."""
    with np.load(file) as kept:
        layout = json.loads(str(kept["layout"]))
        episode = Episode(str(kept["task"]), int(kept["seed"]), limits, layout)
        return episode.end([episode.play(kept["actions"], file.stem)])


def task_of(file: Path) -> str:
    """The task of a file."""
    with np.load(file) as kept:
        return str(kept["task"])


def play_all(jobs: Sequence[Job], workers: int) -> Iterator[tuple[Job, Outcome]]:
    """Play jobs in processes, in any order.

    Raises:
        BrokenProcessPool: The engine took a process down with it.
    """
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, context) as pool:
        running = {pool.submit(play, job): job for job in jobs}
        for future in as_completed(running):
            yield running[future], future.result()


def main() -> None:
    """Play what the arguments name, say what breaks, and exit with 1 if anything does."""
    parser = argparse.ArgumentParser(
        prog="python -m dev.tools.fuzz",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--seeds", type=int, default=2, help="seeds of each task")
    parser.add_argument("--branches", type=int, default=BRANCHES, help="branches of each seed")
    parser.add_argument("--tasks", nargs="+", choices=catalog.names(), default=catalog.names())
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("fuzz-run"), help="folder for failures")
    parser.add_argument("--replay", type=Path, metavar="FILE", help="play a saved failure again")
    arguments = parser.parse_args()
    if arguments.replay is not None:
        jobs = [Job(task=task_of(arguments.replay), file=arguments.replay)]
    else:
        seeds = range(arguments.first, arguments.first + arguments.seeds)
        kept = [Job(task=task_of(file), file=file) for file in sorted(KEPT.glob("*.npz"))]
        # The slowest first, so that no worker is left alone with it.
        tasks = sorted(arguments.tasks, key=lambda task: task not in ROUTES)
        jobs = [job for job in kept if job.task in tasks]
        jobs += [
            Job(task=task, seed=seed, branches=arguments.branches)
            for task, seed in product(tasks, seeds)
        ]
    sys.exit(0 if _report(jobs, arguments.workers, arguments.out) else 1)


def _report(jobs: Sequence[Job], workers: int, out: Path) -> bool:
    """Play jobs, print how each went, and tell whether all is sound."""
    waiting, is_sound = list(jobs), True
    try:
        for number, (job, outcome) in enumerate(play_all(jobs, workers), start=1):
            waiting.remove(job)
            is_sound &= not outcome.violations
            print(f"{number}/{len(jobs)} {job}: {outcome}", flush=True)
            for violation in outcome.violations:
                print(f"  {violation}\n  python -m dev.tools.fuzz --replay {violation.save(out)}")
    except BrokenProcessPool:
        print(f"A process died while these were played or waited: {', '.join(map(str, waiting))}")
        return False
    return is_sound


if __name__ == "__main__":
    main()
