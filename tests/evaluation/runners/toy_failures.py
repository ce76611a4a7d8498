"""Policies and tasks that fail on purpose, one way each, for processes to import."""

import gc
import os
import signal
import stat
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from duobench.core.errors import ConnectionLostError
from duobench.core.randomness import episode_seed
from duobench.policy import HoldPolicy, PolicyMetadata
from duobench.tasks.stages.logic import Predicate, StateView
from duobench.tasks.stages.progress import Stage
from duobench.world.objects.prop import Prop
from duobench.world.sim.layout import Layout
from duobench.world.sim.simulation import Simulation
from tests.evaluation.toy_tasks import WAVE, mark, seed_of

WHAT = "DUOBENCH_TEST_FAILURE"
"""Environment variable: the name of what a policy does."""
BAD = 1
"""The episode that it does it in."""


def dies() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def raises() -> None:
    raise ZeroDivisionError("on purpose")


def says_machinery() -> None:
    raise ConnectionLostError("not my fault")


def closes_files() -> None:
    """Close what this process has open, its listening socket too."""
    os.closerange(3, 1000)


def exits() -> None:
    sys.exit(3)


def late() -> None:
    time.sleep(4.0)


def bad_frame() -> None:
    """Write nonsense into every socket of this process."""
    for path in Path("/proc/self/fd").iterdir():
        with suppress(OSError):
            if stat.S_ISSOCK(os.fstat(int(path.name)).st_mode):
                os.write(int(path.name), b"\0\0\0\0\0\0\0\5hello")


def diverges() -> None:
    """Do to the simulator, which shares this process, what no finite action should."""
    for each in gc.get_objects():
        if type(each) is Simulation:
            each.data.qvel[:] = 1e30


DOES: Mapping[str, Callable[[], None]] = {
    "raises": raises,
    "says machinery": says_machinery,
    "closes files": closes_files,
    "exits": exits,
    "dies": dies,
    "dies once": lambda: dies() if mark("died") else None,
    "late": late,
    "bad frame": bad_frame,
    "diverges": diverges,
}


class Fails(HoldPolicy):
    """Holds, but does something in the second answer of one episode, or in the first of all."""

    metadata = PolicyMetadata(name="fails", cameras=(), version="1")

    def reset(self, instruction: str, seed: int) -> None:
        super().reset(instruction, seed)
        self.is_bad, self.acts, what = seed == seed_of("wave", BAD), 0, os.environ.get(WHAT, "")
        self.first = what.endswith(" first")
        self.what = what.removesuffix(" first").removesuffix(" beside another")
        if self.is_bad and self.what == "raises in reset":
            raises()

    def act(self, observation: Mapping[str, Any]) -> Any:
        self.acts += 1
        if not (self.first or (self.is_bad and self.acts == 2)):
            return super().act(observation)
        if self.what in DOES:
            DOES[self.what]()
        if self.what == "ends":
            dies()
        action = np.atleast_2d(super().act(observation))
        return {
            "too wide": np.pad(action, ((0, 0), (0, 1))),
            "not a number": action * np.nan,
            "no array": "no array",
        }.get(self.what, action)


class Turns(HoldPolicy):
    """Asks for poses without a rotation, from the second answer on."""

    metadata = PolicyMetadata(name="turns", cameras=(), action_mode="cartesian")

    def reset(self, instruction: str, seed: int) -> None:
        super().reset(instruction, seed)
        self.acts, self.is_bad = 0, seed == seed_of("wave", BAD)

    def act(self, observation: Mapping[str, Any]) -> Any:
        self.acts += 1
        pose = np.asarray(observation["tcp_pose"]).reshape(2, 7)
        action = np.hstack([pose, np.ones((2, 1), np.float32)]).reshape(1, 16)
        return action * (not (self.is_bad and self.acts == 2))


class Intends(HoldPolicy):
    """Says in one episode that it wanted what is no action."""

    intended_action: Any = None

    def reset(self, instruction: str, seed: int) -> None:
        super().reset(instruction, seed)
        self.intended_action = "nonsense" if seed == seed_of("wave", BAD, "train") else None


class Looks(HoldPolicy):
    metadata = PolicyMetadata(name="looks", cameras=("head",), image_size=(24, 32))


class Elsewhere(HoldPolicy):
    metadata = PolicyMetadata(name="elsewhere", cameras=("haed",))


def cannot_be_made() -> None:
    raise ZeroDivisionError("no weights")


def dies_when_made() -> None:
    dies()


# --- tasks ------------------------------------------------------------------------------------


def broken(*_words: Any) -> Any:
    raise KeyError("a slip in my task")


def late_slip(moment: StateView) -> bool:
    return moment.simulation.data.time > 0.2 and broken()


def empty(*_words: Any) -> Any:
    return next(iter(()))


def lost(*_words: Any) -> Any:
    raise ConnectionLostError("not my fault")


def _stage(predicate: Predicate) -> Stage:
    return Stage(name="done", instruction="Do it.", holds=predicate)


def never(_moment: StateView) -> bool:
    return False


def of_task(name: str, **changes: Any) -> Any:
    return replace(WAVE, id=name, **changes)


OBJECT = of_task("object_raises", props=(Prop(name="cube", solid=broken),))
NAME = of_task(
    "misspelt", stages=(_stage(Predicate("odd", lambda s: s.simulation.speed("x")[0] > 0)),)
)
ARRANGE = of_task("arrange_raises", arrange=broken)
STAGE = of_task("stage_raises", stages=(_stage(Predicate("slips", late_slip)),))
WORDS = of_task("words_raise", stages=(_stage(Predicate("silent", never, otherwise=broken)),))
NEXT = of_task("stage_has_none", stages=(_stage(Predicate("empty", never, otherwise=empty)),))
LOST = of_task("stage_blames_others", stages=(_stage(Predicate("lost", lost)),))
NOWHERE = of_task("nowhere", accept=lambda _layout: False)


def _accepts(layout: Layout) -> bool:
    return layout.poses["cube"].translation[0] != _UNWANTED or broken()


_UNWANTED = float("nan")
ACCEPT = of_task("accept_raises", accept=_accepts)
_UNWANTED = next(ACCEPT.layouts(episode_seed("accept_raises", BAD))).poses["cube"].translation[0]
