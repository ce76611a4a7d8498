"""The environment of real arms: the spaces and wrappers of the simulated one."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

from numpy.typing import ArrayLike

from duobench.core.errors import OptionError, check_known
from duobench.core.randomness import EVAL, SPLITS
from duobench.envs.config import (
    INSTRUCTION,
    LAYOUT,
    LAYOUT_SEED,
    SPLIT,
    EnvConfig,
    checked_instruction,
    checked_reset_options,
    checked_seed,
)
from duobench.envs.duo_env import (
    DuoEnv,
    DuoWrapper,
    Info,
    Observation,
)
from duobench.envs.episode_wrappers import Judge, TaskStages
from duobench.envs.protocol import stack_on
from duobench.real.canonical import check_seen
from duobench.real.duo import FrankaDuo
from duobench.real.judge import HumanJudge
from duobench.real.opening import open_rig
from duobench.real.rig import Rig
from duobench.tasks import catalog
from duobench.tasks.shifts.shift import NO_SHIFT
from duobench.tasks.task import Task
from duobench.world.sim.layout import Layout

FAULT_KIND = "fault_kind"
"""Key of `info` that says what sort of fault ended an episode; only there where one did."""
WAITS = "waits"
"""Key of `info` that counts how often the arms rested until a late image came."""
OF_REAL = (LAYOUT, LAYOUT_SEED, SPLIT, INSTRUCTION)
"""Options of a reset that mean something on real arms."""


class RealEnv(DuoEnv):
    """A `DuoEnv` on real arms.

    Info also holds `late_s`, how many seconds too late the command came, `image_ages`, the age of
    the latest image in seconds of each camera in use, and `waits`, how often this
    episode the arms rested until a late image came. Where a fault ended the episode, `fault_kind`
    says of what sort it is: a `FaultKind`, such as "contact". It is not there where a person held
    the arms.

    A reset brings the arms home, for which the operator has to have confirmed, and takes the
    options `layout` (where people are to put the objects, as a `Layout` or its JSON form), `split`
    and `layout_seed` (kept in info), and `instruction`. Before the arms move it calls `prepare`
    with its options, which may wait for the operator.

    Making one connects to the rig; nothing moves.

    Raises:
        BackendError: A device cannot be reached.
    """

    backend: FrankaDuo

    def __init__(
        self,
        backend: FrankaDuo,
        task: Task,
        *,
        prepare: Callable[[Mapping[str, Any]], None] | None = None,
    ) -> None:
        super().__init__(backend, task)
        self.rig = backend
        self.prepare = prepare
        self.layout = Layout(poses={})
        """Layout that the operator was asked for; empty if none was given."""
        self._waits = 0

    @property
    def subinstructions(self) -> dict[int, str]:
        """Instructions for stages 0 to n-1, each to reach the next one, in this layout."""
        return self.definition.subinstructions(self.layout)

    def _begin(self, options: Mapping[str, Any]) -> Info:
        options = checked_reset_options(options, OF_REAL)
        split = options.get(SPLIT) or EVAL
        check_known("split", split, SPLITS)
        seed = checked_seed(options.get(LAYOUT_SEED))
        task = self.definition
        self.layout = _layout_of(task, options.get(LAYOUT), seed or 0, split)
        words = checked_instruction(options.get(INSTRUCTION), len(task.instructions))
        number = words if isinstance(words, int) else 0
        own = task.instruct(self.layout, number)
        self._instruction = words if isinstance(words, str) else own
        if self.prepare is not None:
            self.prepare(options)
        if self.config is not None:
            seen = self.config.wanted.values()
            self.rig.see({str(name) for sizes in seen for name in sizes})
        if self.rig.guard is not None:
            self.rig.guard.set_scene(task.props, self.layout)
        self.rig.home()
        self._waits = self.rig.waits
        return {LAYOUT: self.layout.to_json(), "seed": seed, SPLIT: split}

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Observation, Info]:
        """Bring the arms home and begin an episode; a seed is kept as that of the layout.

        Raises:
            OptionError: The seed or an option is invalid.
            BackendError: The operator has not confirmed, or the arms cannot get home.
        """
        given = checked_reset_options(options)
        if seed is not None:
            given.setdefault(LAYOUT_SEED, checked_seed(seed))
        return super().reset(seed=seed, options=given)

    def step(self, action: ArrayLike) -> tuple[Observation, float, bool, bool, Info]:
        """Advance one control step; see `DuoEnv.step`."""
        observation, reward, terminated, truncated, info = super().step(action)
        fault = self.rig.fault
        if truncated and fault is not None:
            info[FAULT_KIND] = str(fault.kind)
        return observation, reward, terminated, truncated, info

    def _info(self, clipped: Any = None) -> Info:
        more = {"late_s": self.rig.late_s, "image_ages": self.rig.image_ages()}
        return {**super()._info(clipped), **more, WAITS: self.rig.waits - self._waits}


def _layout_of(
    task: Task,
    given: Any,
    seed: int,
    split: str,
) -> Layout:
    """Layout of a reset; without one, only variants, which instructions need."""
    if isinstance(given, Layout):
        return given
    if given is not None:
        return Layout.from_json(given)
    if not task.variants:
        return Layout(poses={})
    return Layout(poses={}, variants=next(task.layouts(seed, split)).variants)


def make_real_env(
    rig: FrankaDuo | Rig | Path | str,
    task: str | Task,
    *,
    judge: Judge | None = None,
    prepare: Callable[[Mapping[str, Any]], None] | None = None,
    **options: Any,
) -> DuoWrapper:
    """An environment of a task on real arms, with the wrappers of the simulated one.

    Args:
        rig: A rig, or what `open_rig` takes.
        task: A task, its id, or its import path "module:ATTRIBUTE".
        judge: Who says which stage is reached; a `HumanJudge` where none is given, which is
            `env.get_wrapper_attr("judge")`.
        prepare: Called with a reset's options before the arms go home; see `RealEnv`.
        options: The fields of `EnvConfig` as `EnvConfig.from_options` takes them, such as
            `action_mode`, `cameras`, `image_size`, `horizon`; `speed_fraction` is the rig's.

    Raises:
        UnknownNameError: There is no such task, option, camera or mode.
        OptionError: A value is invalid, or asks for what only a simulation has.
        BackendError: A device cannot be reached, or a camera gives no such images.
    """
    duo = rig if isinstance(rig, FrankaDuo) else open_rig(rig)
    definition = cast("Task", catalog.get(task))
    its_own = {
        "cameras": tuple(duo.cameras),
        "gripper": duo.rig.gripper,
        "mount": duo.rig.mount,
    }
    config = EnvConfig.from_options(its_own | options)
    if config.robot != duo.robot:
        raise OptionError(
            f"The rig has gripper={duo.rig.gripper!r} and mount={duo.rig.mount!r}; got "
            f"{config.gripper!r} and {config.mount!r}."
        )
    if (
        config.object_state
        or config.render_mode is not None
        or config.shift != NO_SHIFT
    ):
        raise OptionError(
            "Object states, `render` and shifts need a simulation; leave them out."
        )
    check_seen(config.wanted, duo.rig.cameras)
    horizon = config.horizon or definition.horizon
    if horizon != definition.horizon:
        definition = replace(definition, horizon=horizon)
    base = RealEnv(duo, definition, prepare=prepare)
    base.config = config
    base.reference = catalog.reference(task)
    judge = judge or HumanJudge(definition.max_stage, duo.clock.now)
    return stack_on(TaskStages(base, judge, reward=config.reward), config, horizon)
