"""The command that trains a policy with LeRobot on an exported data set."""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

from duobench.core.errors import (
    DataError,
    NoObjectStatesError,
    OtherRunError,
    PolicyError,
    UnknownNumbersError,
    check_known,
)
from duobench.core.files import read_object, write
from duobench.core.lerobot_keys import (
    ACTION,
    DOMAIN,
    DOMAINS,
    FEATURE_NAMES,
    FORMAT,
    IMAGE_PREFIX,
    LAST,
    OBJECT_STATE,
    ROBOT,
    STATE,
    STEP,
    SUITE,
    feature_names,
    robot_of,
)
from duobench.core.machine import install_extra
from duobench.core.randomness import SUITE_VERSION
from duobench.core.types import CONTROL_HZ
from duobench.envs import action_labels, state_labels
from duobench.envs.action_labels import LABELS
from duobench.envs.action_modes import JOINT
from duobench.envs.spaces import JOINT_NAMES
from duobench.envs.state_labels import StatePart
from duobench.policy.training.recipes import (
    OBJECT_STATES,
    RECIPES,
    SMALL,
    Setting,
    TrainingRecipe,
)
from duobench.tasks import catalog
from duobench.world.robot.cameras import POLICY_CAMERAS

PROGRAM = "lerobot-train"
ALL = "all"
"""Stands for every task of a data set."""
_INFO, _NOTED = "meta/info.json", "meta/duobench"
_SIMULATED = DOMAINS[0]
"""Folder of simulated episodes beside real ones, as the paper's authors publish a task."""
_DESCRIBING = ("meta/tasks.parquet", "meta/episodes/chunk-000/file-000.parquet")
PLUGIN = "lerobot_env_duobench"
"""Distribution that lets the column `domain` reach X-VLA."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Training:
    """A training that can begin; tasks, names and version are what the data set says."""

    settings: tuple[Setting, ...]
    """Options of `lerobot-train`, each with where its value comes from."""
    folder: Path
    tasks: tuple[str, ...]
    names: Mapping[str, Sequence[str]]
    """Names of the numbers of its features."""
    suite_version: str | None
    robot: str | None
    """Gripper and mount that are not the paper's."""
    notes: tuple[str, ...] = ()
    """Sentences about what was assumed of the data, and what of it is left out."""

    def command(self, more: Sequence[str] = ()) -> list[str]:
        """The command; more options, `--name=value`, take the place of those of the same name."""
        replaced = {word.partition("=")[0] for word in more}
        kept = [
            one.argument for one in self.settings if f"--{one.option}" not in replaced
        ]
        return [PROGRAM, *kept, *more]

    @property
    def checkpoint(self) -> Path:
        """Path at which the policy will be."""
        return self.folder / LAST

    def is_finished(self, more: Sequence[str] = ()) -> bool:
        """Whether the last checkpoint has all steps that the command asks for."""
        try:
            done = json.loads((self.folder / STEP).read_bytes())["step"]
            wanted = dict(
                word.split("=", 1) for word in self.command(more)[1:] if "=" in word
            )
            return done >= int(wanted["--steps"])
        except (OSError, ValueError, KeyError, TypeError, RecursionError):
            return False

    def name_features(self) -> None:
        """Write beside every checkpoint what its numbers are, which LeRobot does not keep."""
        facts = {**self.names, SUITE: self.suite_version, ROBOT: self.robot}
        text = json.dumps(facts, indent=2) + "\n"
        for folder in self.checkpoint.parent.parent.glob(f"*/{self.checkpoint.name}"):
            write(folder / FEATURE_NAMES, text)


def plan_all(
    kind: str,
    data: Path,
    out: Path,
    *,
    tasks: Sequence[str] = (),
    steps: int | None = None,
    small: bool = False,
    domain_ids: bool = False,
    assume: str | None = None,
) -> tuple[Training, ...]:
    """Prepare one training, or one for each task where a policy learns one task.

    Args:
        kind: Name of a recipe.
        data: Folder of a data set in LeRobot's format v3.0, or of one for each task.
        out: Folder of the training, new or with one that goes on; with several, that of their
            folders, which are named as their tasks.
        tasks: Ids of the tasks to learn, or `ALL`. A policy that takes no instruction learns each
            in a training of its own, unless only one is named.
        steps: Steps of the optimizer; None takes the recipe's.
        small: Whether to take the recipe for a processor.
        domain_ids: Whether the policy is told which episodes are simulated and which are real, and
            where it plays in an evaluation.
        assume: Mode of the actions, as an export names it, where their names do not say it; a state
            of 16 numbers is then joints and openings.
    """
    data = data.absolute()
    if assume is not None:
        check_known("action mode of an export", assume, LABELS)
    wanted = () if ALL in tasks else tuple(tasks)
    one = partial(
        _plan,
        kind,
        steps=steps,
        small=small,
        domain_ids=domain_ids,
    )
    folders = _folders(data)
    if folders:  # a data set for each task
        for task in wanted:
            check_known(f"task in {data}", task, folders)
        sources = [
            (task, LearningData(folders[task], assume, task))
            for task in wanted or sorted(folders)
        ]
        if not all(_recipe(kind, small, source).one_task for _, source in sources):
            raise DataError(
                f"{kind} learns several tasks from one data set, and {data} holds one for each "
                "task: export all tasks into one, or merge them with lerobot-edit-dataset."
            )
        return tuple(one(source, out / task) for task, source in sources)
    is_published = (data / _SIMULATED / _INFO).exists()
    source = (
        LearningData(data / _SIMULATED, assume, data.name)
        if is_published
        else LearningData(data, assume)
    )
    is_alone = ALL not in tasks and len(set(tasks)) <= 1
    if is_alone or not _recipe(kind, small, source).one_task:
        return (one(source, out, tasks=wanted),)
    learned = _tasks(source, wanted, needed=True)
    return tuple(one(source, out / task, tasks=[task]) for task in learned)


def _folders(data: Path) -> dict[str, Path]:
    """The data sets of a folder by task: TASK, or TASK/sim as the paper's authors publish them."""
    found = [path.parents[1] for path in data.glob(f"*/{_INFO}")]
    folders = {path.name: path for path in found if path.name not in DOMAINS}
    simulated = (path.parents[1] for path in data.glob(f"*/{_SIMULATED}/{_INFO}"))
    return folders or {path.parent.name: path for path in simulated}


def _plan(
    kind: str,
    source: LearningData,
    out: Path,
    *,
    tasks: Sequence[str] = (),
    steps: int | None,
    small: bool,
    domain_ids: bool,
) -> Training:
    """One training, of all tasks of one data set if none is named."""
    recipe = _recipe(kind, small, source)
    learned = _tasks(source, tasks)
    if recipe.one_task and len(learned) > 1:
        raise DataError(
            f"{kind} takes no instruction and learns one task; name one of: {', '.join(learned)}; "
            f"or several, or {ALL}, for a training each."
        )
    settings = [
        Setting("dataset.repo_id", f"local/{source.path.name}", "any name"),
        Setting("dataset.root", str(source.path), "given"),
        Setting(
            "dataset.video_backend", "pyav", "ours: needs no FFmpeg on the machine"
        ),
    ]
    rows = None
    if tasks:
        rows = [
            row for row, task in enumerate(source.episodes() or []) if task in learned
        ]
        listed = ",".join(map(str, rows))
        settings.append(
            Setting("dataset.episodes", f"[{listed}]", "given: their tasks")
        )
    if domain_ids:
        settings.append(_domain_setting(kind, recipe, source))
    seen = {one.option: one for one in source.seen}
    out = out.absolute()
    if out.exists():
        config = _check_same(out, kind, source, rows)
        why = "the training in this folder goes on, with its own settings"
        settings = [
            Setting("config_path", str(config), why),
            Setting("resume", "true", why),
        ]
    else:
        free = max((os.cpu_count() or 1) - 1, 0)
        settings += [
            *(one for one in recipe.settings if one.option not in seen),
            *seen.values(),
            Setting("num_workers", str(min(recipe.workers, free)), "ours: free cores"),
            Setting("policy.push_to_hub", "false", "ours: it stays here"),
            Setting("output_dir", str(out), "given"),
        ]
    settings.append(
        recipe.steps if steps is None else Setting("steps", str(steps), "given")
    )
    return Training(
        settings=tuple(settings),
        folder=out,
        tasks=learned,
        names=source.names,
        suite_version=source.suite_version,
        robot=source.robot,
        notes=tuple(source.notes),
    )


def program() -> Path:
    """Path of `lerobot-train`; a `PolicyError` where LeRobot is not installed."""
    beside = Path(sys.executable).with_name(PROGRAM)
    command = str(beside) if beside.exists() else shutil.which(PROGRAM)
    if command is None:
        raise PolicyError(f"There is no {PROGRAM} here. {install_extra('lerobot')}")
    return Path(command)


def _recipe(
    kind: str,
    small: bool,
    source: LearningData,
) -> TrainingRecipe:
    if source.holds_objects_alone:
        if kind in RECIPES and kind not in OBJECT_STATES:
            raise DataError(
                f"{kind} learns from images, and {source.path} has object states alone: export "
                f"images, or train one of {', '.join(OBJECT_STATES)}, which learn from these."
            )
        check_known("recipe for object states", kind, OBJECT_STATES)
        return OBJECT_STATES[kind]
    recipes = SMALL if small else RECIPES
    if kind in OBJECT_STATES and kind not in RECIPES:
        raise NoObjectStatesError(
            f"{kind} learns from object states without images; {source.path} has no such export."
        )
    check_known("small recipe" if small else "recipe", kind, recipes)
    if not source.has_images:
        raise DataError(
            f"{kind} learns from images, and {source.path} has none: export it with cameras."
        )
    return recipes[kind]


def _tasks(
    source: LearningData, wanted: Sequence[str], *, needed: bool = False
) -> tuple[str, ...]:
    """Ids of the wanted tasks, or of all; none if that is not known, and not needed."""
    episodes = source.episodes()
    if episodes is None:
        if wanted or needed:
            raise DataError(
                f"{source.path} does not say which episodes are of which task: meta/duobench.json "
                "is missing. Train on all of it, or on an export of these tasks."
            )
        return ()
    there = tuple(dict.fromkeys(episodes))
    wanted = [catalog.id_of(task) for task in wanted]
    for task in wanted:
        check_known(f"task in {source.path}", task, there)
    return tuple(dict.fromkeys(wanted)) or there


def _domain_setting(
    kind: str,
    recipe: TrainingRecipe,
    source: LearningData,
) -> Setting:
    """The option that tells a policy which episodes are simulated."""
    if not recipe.takes_domains:
        raise DataError(
            f"{kind} learns from both domains without knowing which is which."
        )
    if not source.mixes_domains():
        raise DataError(f"{source.path} has episodes of one domain alone.")
    try:
        distribution(PLUGIN)
    except PackageNotFoundError as error:
        raise PolicyError(
            "The data set has simulated and real episodes. LeRobot 0.6 tells X-VLA which is which "
            f"only with {PLUGIN}, the second distribution of this repository. In a clone of it: "
            "pip install ./plugins/lerobot"
        ) from error
    why = "given: simulated and real episodes are distinguished; the paper does not"
    return Setting("policy.domain_feature_key", DOMAIN, why)


def _check_same(
    out: Path, kind: str, source: LearningData, rows: list[int] | None
) -> Path:
    """The settings in a folder that holds an earlier part of this training."""
    path = out / LAST / "train_config.json"
    try:
        before = json.loads(path.read_bytes())
        facts = {
            "policy": before["policy"]["type"],
            "data set": before["dataset"]["root"],
            "episodes": before["dataset"].get("episodes"),
        }
    except (
        OSError,
        ValueError,
        KeyError,
        TypeError,
        AttributeError,
        RecursionError,
    ) as error:
        raise OtherRunError(
            f"{out} exists and holds no checkpoint to go on from: no {path.relative_to(out)}. "
            "Train into another folder, or delete this one."
        ) from error
    now: dict[str, object] = {"policy": kind, "data set": str(source.path)}
    if (
        rows is not None
    ):  # else no task is named; an option of LeRobot may have chosen some
        now["episodes"] = rows
    changed = [
        f"{name}: {fact!s:.200}, was {'all' if facts[name] is None else facts[name]!s:.200}"
        for name, fact in now.items()
        if fact != facts[name]
    ]
    if changed:
        raise OtherRunError(
            f"{out} holds another training; this one differs in {'; '.join(changed)}."
        )
    return path


class LearningData:
    """A data set in LeRobot's format that a policy can learn from, as far as its JSON files tell.

    Any writer's will do: this package's export, a merge, or a set of one's own.

    Args:
        path: Its folder.
        assume: Mode of its actions, where their names do not say it.
        task: The task of all its episodes, where only the name of a folder says it.
    """

    def __init__(
        self, path: Path, assume: str | None = None, task: str | None = None
    ) -> None:
        self.path = path
        self._task = task
        info = self._read(_INFO)
        if info is None:
            raise DataError(
                f"{path} holds no data set of LeRobot: there is no meta/info.json. Recordings must "
                "be exported first."
            )
        if info.get("codebase_version") != FORMAT:
            raise DataError(
                f"{path} has LeRobot's format {info.get('codebase_version')}; {FORMAT} is needed."
            )
        self._episodes = info.get("total_episodes") or 0
        lost = self._lost(self._episodes)
        if lost:
            raise DataError(
                f"{path / lost[0]} is not as the export left it; such files: {len(lost)}. Export "
                "again: the same command goes on and writes what is missing."
            )
        features = info.get("features")
        self._features = features if isinstance(features, dict) else {}
        self.notes: list[str] = []
        """Sentences about what was assumed of it, and what of it is left out."""
        found = {key: feature_names(info, key) for key in (STATE, OBJECT_STATE, ACTION)}
        self.names = {
            key: list(map(str, names)) for key, names in found.items() if names
        }
        """Names of the numbers of its features, where it says so or where it is assumed."""
        unknown = [*self._name_actions(assume), *self._name_state(assume)]
        problems = [*unknown, *self._problems(info)]
        if problems:
            error = UnknownNumbersError if unknown else DataError
            raise error(
                f"Nothing that plays here can be learned from {path}: {' '.join(problems)}"
            )
        self.seen = self._choose()
        """Option that leaves out what no policy sees here; none where all can be seen."""
        about = self._read("meta/duobench.json") or {}
        self.suite_version = about.get(SUITE)
        """Version of the suite that its episodes are of, where it says so."""
        if self.suite_version not in (None, SUITE_VERSION):
            raise DataError(
                f"{path} is of suite {self.suite_version}; this version has suite {SUITE_VERSION}, "
                "whose episodes are others. Record or generate and export them again."
            )
        self.robot = robot_of(info)
        """Gripper and mount that are not the paper's, where it says so."""
        options = about.get("options")
        if isinstance(options, Mapping) and options.get("after_success") is False:
            self.notes.append(
                "Its episodes end at success, so it shows little of how hands open, and nothing of "
                "how they retreat; an export can hold what was recorded after success."
            )

    def _name_actions(self, assume: str | None) -> Iterator[str]:
        """Name the numbers of the actions; yields why that is impossible."""
        given = self.names.get(ACTION)
        known = LABELS[assume or JOINT.name]
        labels = action_labels.find(given) if given and not assume else known
        if labels is None:
            yield self._unknown(ACTION, "which no action mode has")
        else:
            self._name(ACTION, f"{labels.mode.name} actions", labels.names)

    def _name_state(self, assume: str | None) -> Iterator[str]:
        """Name the numbers of the state; yields why that is impossible."""
        parts = state_labels.find(self.names.get(STATE, JOINT_NAMES))
        if parts is None and assume is None:
            tools = ", ".join(StatePart.TCP_POSE.names)
            yield self._unknown(
                STATE,
                f"{', '.join(JOINT_NAMES)} are needed, and tool poses may follow: {tools}",
            )
        else:
            names = state_labels.names_of(parts or ())
            self._name(STATE, "joints and openings", names)

    def _unknown(self, key: str, why: str) -> str:
        names = self.names[key]
        listed = ", ".join(names[:_LISTED]) + (", …" if len(names) > _LISTED else "")
        return (
            f"Its {key} has {len(names)} numbers, {listed}; {why}. If they are those of a mode "
            "under other names, in the same order and units, say of which."
        )

    def _name(self, key: str, what: str, names: Sequence[str]) -> None:
        given = self.names.get(key)
        if given != list(names):
            called = f"names of its own ({given[0]}, …)" if given else "no names"
            self.notes.append(
                f"Assumed: {key}, which has {called}, is {len(names)} numbers of {what}, "
                f"{names[0]} to {names[-1]}, in this benchmark's order and units."
            )
        self.names[key] = list(names)

    def _problems(self, info: Mapping[str, Any]) -> Iterator[str]:
        """Reasons why a policy that learns from it cannot play here, a sentence each."""
        if info.get("fps") != CONTROL_HZ:
            yield f"It has {info.get('fps')} rows a second; {CONTROL_HZ:g} are needed."
        for key in (ACTION, STATE):
            shape, size = _shape(self._features.get(key)), len(self.names[key])
            if shape != [size]:
                yield f"{key} has shape {shape}; [{size}] is needed."
        for part in state_labels.find(self.names[STATE]) or ():
            if part not in state_labels.SHOWN:
                yield f"{STATE} holds {part}, which no environment shows; export without it."

    def _choose(self) -> tuple[Setting, ...]:
        """The features that can be seen here, where there are others beside them."""
        others = [
            key
            for key in self._features
            if key.startswith("observation") and key not in _SEEN
        ]
        if not others:
            return ()
        why = f"left out: {', '.join(others)}, which no policy sees here"
        self.notes.append(f"{why[0].upper()}{why[1:]}.")
        inputs = {
            key: {"type": _TYPES.get(key, "VISUAL"), "shape": _channels_first(feature)}
            for key, feature in self._features.items()
            if key in _SEEN
        }
        return (Setting("policy.input_features", json.dumps(inputs), why),)

    def _lost(self, episodes: int) -> list[str]:
        """Files of an export that are missing or not whole; of other writers' none are known."""
        if not (self.path / _NOTED).is_dir():
            return []
        sizes: dict[str, int | None] = dict.fromkeys(_DESCRIBING)
        for index in range(episodes):
            facts = f"{_NOTED}/{index:06d}.json"
            sizes |= {facts: None, **(self._read(facts) or {}).get("sizes", {})}
        return [name for name, size in sizes.items() if not self._is_whole(name, size)]

    def _is_whole(self, name: str, size: int | None) -> bool:
        path = self.path / name
        return path.is_file() and size in {None, path.stat().st_size}

    def _read(self, name: str) -> dict[str, Any] | None:
        return read_object(self.path / name, DataError)

    def episodes(self) -> list[str] | None:
        """The task of each episode; None if nothing says so, as in a merged data set."""
        about = self._read("meta/duobench.json")
        if about is None:
            return None if self._task is None else [self._task] * self._episodes
        try:
            return [Path(episode["file"]).parent.name for episode in about["episodes"]]
        except (KeyError, TypeError) as error:
            raise DataError(
                f"meta/duobench.json of {self.path} does not list episodes with their files, as an "
                "export does; export again."
            ) from error

    @property
    def has_images(self) -> bool:
        """Whether there are images of a camera."""
        return any(
            key.startswith(IMAGE_PREFIX) for key in self._features if key in _SEEN
        )

    @property
    def holds_objects_alone(self) -> bool:
        """Whether there are object states, and no images."""
        return OBJECT_STATE in self._features and not self.has_images

    def mixes_domains(self) -> bool:
        """Whether there are simulated and real episodes."""
        domains = (self._read("meta/stats.json") or {}).get(DOMAIN)
        if DOMAIN not in self._features or not isinstance(domains, dict):
            return False
        return domains.get("min") != domains.get("max")


_SEEN = (STATE, OBJECT_STATE, *(f"{IMAGE_PREFIX}{camera}" for camera in POLICY_CAMERAS))
"""Features that an environment can show, under the names of a data set."""
_TYPES = {STATE: "STATE", OBJECT_STATE: "ENV"}
"""Kinds of these features to LeRobot; the others are images."""
_LISTED = 3
"""Names of numbers that a message shows."""


def _shape(feature: object) -> list[int] | None:
    """Shape of a feature, where the data set says it."""
    shape = feature.get("shape") if isinstance(feature, Mapping) else None
    return list(shape) if isinstance(shape, list) else None


def _channels_first(feature: Mapping[str, Any]) -> list[int] | None:
    """Shape of a feature as LeRobot's policies have it."""
    shape, names = _shape(feature), feature.get("names")
    is_last = isinstance(names, list) and names[-1:] in (["channel"], ["channels"])
    return [shape[-1], *shape[:-1]] if shape and is_last else shape
