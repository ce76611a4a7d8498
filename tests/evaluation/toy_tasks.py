"""A task that takes a second, and policies that behave and misbehave, for processes to import."""

import asyncio
import math
import multiprocessing
import os
import random
import re
import signal
import stat
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

from duobench.errors import RenderingError
from duobench.objects.blocks import CUBE_EDGE, RED, cube
from duobench.objects.prop import Prop
from duobench.policy import HoldPolicy, PolicyMetadata, RandomPolicy
from duobench.randomness import EVAL, around, episode_seed, policy_seed
from duobench.stages.logic import Predicate, StateView
from duobench.stages.progress import Stage
from duobench.tasks.task import Category, Placement, Task

HOME_HEIGHT = 0.54
HORIZON = 24
MARKS = "DUOBENCH_TEST_MARKS"
"""Environment variable: folder in which policies leave marks for other processes."""


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


class DiesOnce(RandomPolicy):
    """Random, but kills its process in the middle of the first attempt at every episode.

    A forked child stays behind, which keeps every file of its parent open.
    """

    def reset(self, instruction: str, seed: int) -> None:
        super().reset(instruction, seed)
        self._dies = mark(f"{instruction}-{seed}")
        self._acts = 0

    def act(self, observation: Mapping[str, Any]) -> Any:
        self._acts += 1
        if self._dies and self._acts == 5:
            fork_a_helper()
            os.kill(os.getpid(), signal.SIGKILL)
        return super().act(observation)


class DiesAtTheEnd(HoldPolicy):
    """Kills its process in every episode of the second task."""

    def reset(self, instruction: str, seed: int) -> None:
        super().reset(instruction, seed)
        if "nod" in instruction:
            os.kill(os.getpid(), signal.SIGKILL)


class SpoilsOnce(RandomPolicy):
    """Random, but once writes nonsense into every socket that it inherited."""

    def act(self, observation: Mapping[str, Any]) -> Any:
        if mark("nonsense"):
            for path in Path("/proc/self/fd").iterdir():
                with suppress(OSError):
                    if stat.S_ISSOCK(os.fstat(int(path.name)).st_mode):
                        os.write(int(path.name), b"\0\0\0\0\0\0\0\5hello")
        return super().act(observation)


class AnswersForAnother(RandomPolicy):
    """Random, in a process that once plays another episode than the one that it was asked for."""

    def __init__(self) -> None:
        super().__init__()
        from duobench.evaluation.episode import EpisodeRunner

        play = EpisodeRunner.play

        def other(runner: Any, episode: Any) -> Any:
            if episode.index == 1 and mark(f"other-{episode.task.id}"):
                episode = replace(episode, index=0)
            return play(runner, episode)

        EpisodeRunner.play = other


class AnswersTwice(RandomPolicy):
    """Random, in a process that once gives a result twice."""

    def __init__(self) -> None:
        super().__init__()
        from duobench.evaluation import worker
        from duobench.evaluation.episode import EpisodeResult

        report = worker._report

        def twice(channel: Any, message: Any) -> None:
            report(channel, message)
            if isinstance(message, EpisodeResult) and mark("twice"):
                report(channel, message)

        worker._report = twice


class SwapsRecordings(HoldPolicy):
    """Still, in a process that once gives the recording of the episode before."""

    def __init__(self) -> None:
        super().__init__()
        from duobench.evaluation.episode import EpisodeRunner

        play, before = EpisodeRunner.play, []

        def swapped(runner: Any, episode: Any) -> Any:
            result = play(runner, episode)
            before.append(result.recording)
            if episode.index == 1 and mark("swapped-once"):
                result = msgspec.structs.replace(result, recording=before[0])
            return result

        EpisodeRunner.play = swapped


class SpoilsClock(HoldPolicy):
    """Writes nonsense into every file in memory that it inherited, and does not come back."""

    def act(self, observation: Mapping[str, Any]) -> Any:  # noqa: ARG002 - sees nothing
        for path in Path("/proc/self/fd").iterdir():
            with suppress(OSError):
                if "memfd:" in str(path.readlink()):
                    os.pwrite(int(path.name), struct.pack("3d", 1.0, 1.0, math.inf), 0)
        time.sleep(1000)


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


def fork_a_helper() -> None:
    pid = os.fork()
    if pid == 0:
        time.sleep(1000)
    mark(f"helper-{pid}")


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


FAULTS: tuple[Callable[[], None], ...] = (exits, raises, cancels, raises_bytes, raises_much)


class Faulty(HoldPolicy):
    """Breaks in the fourth step of the first episodes, each time in another way."""

    def reset(self, instruction: str, seed: int) -> None:
        super().reset(instruction, seed)
        seeds = [seed_of("wave", index) for index in range(len(FAULTS))]
        self._fault = FAULTS[seeds.index(seed)] if seed in seeds else lambda: None
        self._acts = 0

    def act(self, observation: Mapping[str, Any]) -> Any:
        self._acts += 1
        if self._acts == 4:
            self._fault()
        return super().act(observation)


class Hangs(HoldPolicy):
    """Hangs in the fourth step of the first episode."""

    def reset(self, instruction: str, seed: int) -> None:
        super().reset(instruction, seed)
        self._acts = 0 if seed == seed_of("wave", 0) else 100

    def act(self, observation: Mapping[str, Any]) -> Any:
        self._acts += 1
        if self._acts == 4:
            hangs()
        return super().act(observation)


class Tires(RandomPolicy):
    """The same in every episode: two stages, and then too long for the 23rd answer."""

    def reset(self, instruction: str, seed: int) -> None:  # noqa: ARG002 - always the same
        super().reset(instruction, seed=2481962773)
        self._acts = 0

    def act(self, observation: Mapping[str, Any]) -> Any:
        self._acts += 1
        if self._acts == 23:
            time.sleep(3.2)
        return super().act(observation)


class HasNoGraphics(HoldPolicy):
    """Meets graphics that do not work."""

    def act(self, observation: Mapping[str, Any]) -> Any:  # noqa: ARG002 - sees nothing
        raise RenderingError("The driver hangs.")


class Interrupts(HoldPolicy):
    """Raises what Ctrl-C raises."""

    def act(self, observation: Mapping[str, Any]) -> Any:  # noqa: ARG002 - sees nothing
        raise KeyboardInterrupt


class Dawdles(HoldPolicy):
    """Takes a tenth of a second for every answer."""

    def act(self, observation: Mapping[str, Any]) -> Any:
        time.sleep(0.1)
        return super().act(observation)


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


class Reads(HoldPolicy):
    """Asks for the state of the objects, no images, and moves by where the cube is."""

    metadata = PolicyMetadata(name="reads", version="1", object_state=True, cameras=(), horizon=3)

    def act(self, observation: Mapping[str, Any]) -> Any:
        return np.tile(observation["agent_pos"] + observation["environment_state"][0], (3, 1))


class SeesNowhere(HoldPolicy):
    """Expects a camera that does not exist."""

    metadata = PolicyMetadata(name="sees_nowhere", cameras=("haed",))


class IsSlow(HoldPolicy):
    """Expects another control rate."""

    metadata = PolicyMetadata(name="is_slow", cameras=(), control_rate_hz=10.0)


class BreaksOnce(RandomPolicy):
    """Random, but raises in the first attempt at the second and the third episode of a task."""

    def reset(self, instruction: str, seed: int) -> None:
        super().reset(instruction, seed)
        broken = {seed_of(name, index) for name in ("wave", "nod") for index in (1, 2)}
        if seed in broken and mark(f"{instruction}-{seed}"):
            raise ZeroDivisionError("my policy was broken")


def cannot_be_made() -> None:
    raise ZeroDivisionError("no weights")


def dies_when_made() -> None:
    os.kill(os.getpid(), signal.SIGKILL)
