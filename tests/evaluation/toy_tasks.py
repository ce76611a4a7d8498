"""A task that takes a second, and policies that behave and misbehave, for processes to import."""

import asyncio
import gc
import math
import multiprocessing
import os
import random
import re
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from duobench.core.errors import RenderingError
from duobench.core.randomness import EVAL, around, episode_seed, policy_seed
from duobench.policy import HoldPolicy, PolicyMetadata, RandomPolicy
from duobench.tasks.stages.logic import Predicate, StateView
from duobench.tasks.stages.progress import Stage
from duobench.tasks.task import Category, Placement, Task
from duobench.world.objects.blocks import CUBE_EDGE, RED, cube
from duobench.world.objects.prop import Prop
from duobench.world.robot.cameras import Camera

HOME_HEIGHT = 0.54
HORIZON = 24
MARKS = "DUOBENCH_TEST_MARKS"
"""Environment variable: folder in which policies leave marks for other processes."""


SIDE = Camera(name="side", position=(0.5, 1.2, 0.5), look_at=(0.5, 0.0, 0.0))


def left_tool_moved(distance: float) -> Predicate:
    """Left tool is that far (metres) above or below its height at home."""

    def test(moment: StateView) -> bool:
        height = moment.simulation.site_pose("left/tcp").translation[2]
        return abs(float(height) - HOME_HEIGHT) > distance

    return Predicate(f"left tool moved {distance}", test)


def sticks_once(moment: StateView) -> bool:
    """The simulation itself does not come back, once, while an episode runs."""
    if moment.simulation.data.time > 0.0 and mark("stuck"):
        time.sleep(1000)
    return False


def _task(name: str, distances: tuple[float, ...]) -> Task:
    return Task(
        id=name,
        title=name.title(),
        category=Category.PARALLEL_EXECUTION,
        instruction=f"Do the {name}.",
        horizon=HORIZON,
        props=(Prop(name="cube", solid=cube(RED)),),
        placements={"cube": Placement(x=around(0.5, 0.1), y=around(0, 0.1), z=CUBE_EDGE / 2)},
        stages=tuple(
            Stage(name=f"moved {distance} m", instruction="Move.", holds=left_tool_moved(distance))
            for distance in distances
        ),
    )


WAVE = _task("wave", (0.05, 0.6, 0.65))  # the first is reached by all random motion
NOD = _task("nod", (0.55, 0.7))
STUCK = replace(
    WAVE,
    id="stuck",
    stages=(Stage(name="came back", instruction="Wait.", holds=Predicate("stuck", sticks_once)),),
)
NUDGE = _task("nudge", (0.03,))  # solved by any motion, in half of the horizon
WAVE_NAME, NOD_NAME = f"{__name__}:WAVE", f"{__name__}:NOD"
NUDGE_NAME = f"{__name__}:NUDGE"


def mark(text: str) -> bool:
    """Leave a mark that outlives this process; whether it is the first of its kind."""
    path = Path(os.environ[MARKS]) / text
    is_first = not path.exists()
    path.touch()
    return is_first


def seed_of(task_id: str, index: int, split: str = EVAL) -> int:
    """The seed that a policy gets in an episode."""
    return policy_seed(task_id, episode_seed(task_id, index, split), split)


def fork_a_helper() -> None:
    pid = os.fork()
    if pid == 0:
        time.sleep(1000)
    mark(f"helper-{pid}")


def dies() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def hangs() -> None:
    """Keep the interpreter busy in C code, so that no other thread can do anything."""
    re.match(r"(a+)+$", "a" * 100 + "b")


def exits() -> None:
    sys.exit(3)


def raises() -> None:
    raise ZeroDivisionError("my policy is broken")


def cancels() -> None:
    raise asyncio.CancelledError


def raises_bytes() -> None:
    raise FileNotFoundError("weights-\udcff.bin \x1b[31m")


def raises_much() -> None:
    raise ValueError("line\n" * 1_000_000)


def cannot_be_made() -> None:
    raise ZeroDivisionError("no weights")


def dies_when_made() -> None:
    dies()


FAULTS: tuple[Callable[[], None], ...] = (exits, raises, cancels, raises_bytes, raises_much)


class Acts:
    """Does something before each answer of an episode; the first one is also asked in advance."""

    instruction, seed, acts = "", 0, 0

    def reset(self, instruction: str, seed: int) -> None:
        super().reset(instruction, seed)  # pyright: ignore[reportAttributeAccessIssue]
        self.instruction, self.seed, self.acts = instruction, seed, 0

    def act(self, observation: Mapping[str, Any]) -> Any:
        self.acts += 1
        self.before()
        return super().act(observation)  # pyright: ignore[reportAttributeAccessIssue]

    def before(self) -> None:
        """What is done before an answer."""


class DiesOnce(Acts, RandomPolicy):
    """Random, but kills its process in the middle of the first attempt at every episode.

    A forked child stays behind, which keeps every file of its parent open.
    """

    def before(self) -> None:
        if self.acts == 5 and mark(f"{self.instruction}-{self.seed}"):
            fork_a_helper()
            dies()


class NeverReady(HoldPolicy):
    """Is being made until somebody loses patience."""

    def __init__(self) -> None:
        super().__init__()
        sys.stderr.write("not ready\n")
        sys.stderr.flush()
        time.sleep(600)


class ClosesOutputs(HoldPolicy):
    """Prints, and closes what others print to."""

    def reset(self, instruction: str, seed: int) -> None:
        super().reset(instruction, seed)
        for stream in (sys.stdout, sys.stderr):
            if stream is not None and not stream.closed:
                stream.write("noise\n")
        if sys.stdout is not None:
            sys.stdout.close()


class DiesAtOnce(Acts, HoldPolicy):
    def before(self) -> None:
        dies()


class DiesInOne(Acts, HoldPolicy):
    """Kills its process in one episode of the second task."""

    def before(self) -> None:
        if self.seed == seed_of("nod", 1):
            dies()


FLOOD = "DUOBENCH_TEST_FLOOD"
"""Environment variable: when hostile messages are sent, and of which of these kinds."""
FLOODS: Mapping[str, Callable[[random.Random, int], bytes]] = {
    "junk": lambda some, _: some.randbytes(some.randint(0, 200)) + b"\n",
    "fails": lambda _, k: FAILED % (b"annotations", b"sys", b"PolicyError")[k % 3] + b"\n",
    "answers": lambda _, k: ANSWERS % (k, k) + b"\n",
    "deep": lambda _some, _: b"[" * 10_000 + b"\n",
    "empty": lambda _some, _: b"\n" * 10_000,
    "endless": lambda _some, _: b"a" * 30_000,
}
FAILED = b'{"type": "ProcessFailed", "error": "%s", "message": "\\u001b[31m"}'
ADDRESS = b'{"host": "host%d", "port": %d, "key": "k", "batching": null}'
ANSWERS = b'{"type": "Answering", "address": ' + ADDRESS + b"}"


class Floods(Acts, HoldPolicy):
    """Sends hostile messages to the parent, of the kind and at the moment that are asked for."""

    def __init__(self) -> None:
        super().__init__()
        self._flood("made")

    def before(self) -> None:
        if self.acts == 3:  # after what is rehearsed
            self._flood("plays")

    def _flood(self, when: str) -> None:
        if os.environ[FLOOD].startswith(when):
            some, connection = random.Random(0), int(sys.argv[2])
            for k in range(10_000):
                os.write(connection, FLOODS[os.environ[FLOOD].split()[1]](some, k))


class SpoilsClock(Acts, HoldPolicy):
    """Writes nonsense into every file in memory that it inherited, and does not come back."""

    def before(self) -> None:
        if self.acts > 1:
            for path in Path("/proc/self/fd").iterdir():
                with suppress(OSError):
                    if "memfd:" in str(path.readlink()):
                        os.pwrite(int(path.name), struct.pack("3d", 1.0, 1.0, math.inf), 0)
            time.sleep(1000)


class ThinksTwice(HoldPolicy):
    """Thinks for two seconds before the first answer that is played, and says when it begins to."""

    def act(self, observation: Mapping[str, Any]) -> np.ndarray:
        if not mark("rehearsed") and not mark("rehearsed again") and mark("thinking"):
            time.sleep(2.0)
        return super().act(observation)


class HasHelpers(HoldPolicy):
    """Starts processes of every kind, and none of them ever ends."""

    def __init__(self) -> None:
        super().__init__()
        mark(f"policy-{os.getpid()}")
        fork_a_helper()
        mark(f"helper-{subprocess.Popen(['sleep', '1000']).pid}")
        process = multiprocessing.get_context("spawn").Process(
            target=time.sleep, args=(1000,), daemon=True
        )
        process.start()
        mark(f"helper-{process.pid}")

    def close(self) -> None:
        mark("closed")


class Faulty(Acts, HoldPolicy):
    """Breaks in the fourth step of the first episodes, each time in another way."""

    def before(self) -> None:
        seeds = [seed_of("wave", index) for index in range(len(FAULTS))]
        if self.acts == 4 and self.seed in seeds:
            FAULTS[seeds.index(self.seed)]()


class Hangs(Acts, HoldPolicy):
    """Hangs in the fourth step of the first episode."""

    def before(self) -> None:
        if self.acts == 4 and self.seed == seed_of("wave", 0):
            hangs()


class Tires(Acts, RandomPolicy):
    """The same in every episode: two stages, and then too long for the 23rd answer."""

    def reset(self, instruction: str, seed: int) -> None:  # noqa: ARG002 - always the same
        super().reset(instruction, seed=2481962773)

    def before(self) -> None:
        time.sleep(3.2 if self.acts == 23 else 0.0)


class Interrupts(Acts, HoldPolicy):
    """Raises what Ctrl-C raises."""

    def before(self) -> None:
        if self.acts > 1:
            raise KeyboardInterrupt


class Dawdles(Acts, HoldPolicy):
    """Takes a tenth of a second for every answer but the first."""

    def before(self) -> None:
        time.sleep(0.1 if self.acts > 1 else 0.0)


class RaisesInTheSecondAnswer(Acts, HoldPolicy):
    def before(self) -> None:
        if self.acts > 1:
            raises()


class BreaksOnce(Acts, RandomPolicy):
    """Random, but raises in the first attempt at the second and the third episode of a task."""

    def before(self) -> None:
        broken = {seed_of(name, index) for name in ("wave", "nod") for index in (1, 2)}
        if self.seed in broken and self.acts == 1 and mark(f"{self.instruction}-{self.seed}"):
            raises()


class Moves(HoldPolicy):
    """Changes the working folder."""

    def __init__(self) -> None:
        super().__init__()
        os.chdir(os.environ[MARKS])


class UsesGlobalGenerators(HoldPolicy):
    """Draws its actions from Python's and NumPy's global generators."""

    def act(self, observation: Mapping[str, Any]) -> Any:
        drawn = random.random() + np.random.random()  # noqa: NPY002 - that is the point
        return super().act(observation) + 0.1 * drawn


class Sees(HoldPolicy):
    """Asks for a small image and acts in chunks of five."""

    metadata = PolicyMetadata(name="sees", cameras=("head",), image_size=(24, 32))

    def act(self, observation: Mapping[str, Any]) -> Any:
        if observation["pixels"]["head"].shape != (24, 32, 3):
            raise ValueError("this is not what was asked for")
        return np.repeat(super().act(observation), 5, axis=0)


class Measures(RandomPolicy):
    """Acts on a random number for each distance, part and colour that it sees."""

    metadata = PolicyMetadata(
        name="measures",
        version="1",
        cameras={"head": 24, SIDE: (24, 32)},  # type: ignore[arg-type]
        depth=("side", "left_wrist"),
        segmentation="head",  # type: ignore[arg-type]
        image_size=16,  # type: ignore[arg-type]
        horizon=4,
    )

    def act(self, observation: Mapping[str, Any]) -> Any:
        shapes = {
            kind: {name: image.shape[:2] for name, image in observation[kind].items()}
            for kind in ("pixels", "depth", "segmentation")
        }
        if shapes != {
            "pixels": {"head": (24, 24), "side": (24, 32)},
            "depth": {"side": (24, 32), "left_wrist": (16, 16)},
            "segmentation": {"head": (24, 24)},
        }:
            raise ValueError(f"this is not what was asked for: {shapes}")
        return np.concatenate([super(Measures, self).act(observation) for _ in range(4)])


class Glances(RandomPolicy):
    """Asks for a small image and acts in chunks of seven, which it announces."""

    metadata = PolicyMetadata(name="glances", cameras=("head",), image_size=(24, 32), horizon=7)

    def act(self, observation: Mapping[str, Any]) -> Any:
        return np.concatenate([super(Glances, self).act(observation) for _ in range(7)])


class Reads(HoldPolicy):
    """Asks for the state of the objects, no images, and moves by where the cube is."""

    metadata = PolicyMetadata(name="reads", version="1", object_state=True, cameras=(), horizon=3)

    def act(self, observation: Mapping[str, Any]) -> Any:
        return np.tile(observation["agent_pos"] + observation["environment_state"][0], (3, 1))


class SeesNowhere(HoldPolicy):
    metadata = PolicyMetadata(name="sees_nowhere", cameras=("haed",))


class IsTooWide(HoldPolicy):
    """Gives actions of 17 numbers."""

    def act(self, observation: Mapping[str, Any]) -> Any:
        return np.pad(np.atleast_2d(super().act(observation)), ((0, 0), (0, 1)))


def simulators() -> list[object]:
    """Everything in this process that may be a simulator, and modules that make one."""
    kinds = ("Simulation", "MjData", "MjModel", "SimBackend", "SimEnv")
    found = [each for each in gc.get_objects() if type(each).__name__ in kinds]
    return [*found, *({"mujoco", "duobench.world.sim.simulation"} & sys.modules.keys())]


class Searches(Acts, RandomPolicy):
    """Random, but looks for a simulator in every step, and stops if it finds one."""

    def before(self) -> None:
        if found := simulators():
            raise RuntimeError(f"found {found}")


MISBEHAVIOUR = "DUOBENCH_TEST_WORKER"
"""Environment variable: what a worker, which imports this for its tasks, does wrong."""


def answers_for_another() -> None:
    """The worker once plays another episode than the one that it was asked for."""
    from duobench.evaluation.episode import EpisodeRunner

    play = EpisodeRunner.play

    def other(runner: Any, episode: Any) -> Any:
        if episode.index == 1 and mark(f"other-{episode.task.id}"):
            episode = replace(episode, index=0)
        return play(runner, episode)

    EpisodeRunner.play = other


def dies_in_one() -> None:
    """The worker ends in one episode, whatever plays it."""
    from duobench.evaluation import episode

    rollout = episode.rollout

    def dying(*words: Any, seed: int, **options: Any) -> Any:
        return dies() if seed == episode_seed("nod", 1) else rollout(*words, seed=seed, **options)

    episode.rollout = dying


def answers_twice() -> None:
    """The worker once gives a result twice."""
    from duobench.evaluation.episode import EpisodeResult
    from duobench.evaluation.runners.process import Parent

    report = Parent.report

    def twice(parent: Any, message: Any) -> None:
        report(parent, message)
        if isinstance(message, EpisodeResult) and mark("twice"):
            report(parent, message)

    Parent.report = twice


def swaps_recordings() -> None:
    """The worker once gives the recording of the episode before."""
    from duobench.evaluation.episode import EpisodeRunner

    play, before = EpisodeRunner.play, []

    def swapped(runner: Any, episode: Any) -> Any:
        result = play(runner, episode)
        before.append(result.recording)
        if episode.index == 1 and mark("swapped-once"):
            result = msgspec.structs.replace(result, recording=before[0])
        return result

    EpisodeRunner.play = swapped


def has_no_graphics() -> None:
    """The worker meets graphics that do not work."""
    from duobench.evaluation import episode

    episode.rollout = without_graphics


def without_graphics(*_words: Any, **_options: Any) -> None:
    raise RenderingError("The driver hangs.")


if os.environ.get(MISBEHAVIOUR) and "duobench.evaluation.runners.worker" in sys.modules:
    globals()[os.environ[MISBEHAVIOUR]]()
