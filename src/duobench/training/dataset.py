"""A data set in LeRobot's format, as far as its JSON files tell, checked against this benchmark."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from duobench.envs import action_labels
from duobench.envs.spaces import JOINT_NAMES
from duobench.errors import DataError
from duobench.lerobot_keys import (
    ACTION,
    DOMAIN,
    IMAGE_PREFIX,
    OBJECT_STATE,
    STATE,
    SUITE,
    feature_names,
)
from duobench.randomness import SUITE_VERSION
from duobench.types import CONTROL_HZ, POLICY_CAMERAS

FORMAT = "v3.0"


class LearningData:
    """A data set that a policy can learn from.

    Any writer's will do: this package's export, a merge, or a set of one's own.
    """

    def __init__(self, path: Path) -> None:
        """Read what describes the data set.

        Args:
            path: Its folder.

        Raises:
            DataError: There is none, or a policy that learns from it could not play here; the
                message lists all of it.
        """
        self.path = path
        info = self._read("meta/info.json")
        if info is None:
            raise DataError(
                f"{path} holds no data set of LeRobot: there is no meta/info.json. Recordings must "
                "be exported first."
            )
        if info.get("codebase_version") != FORMAT:
            raise DataError(
                f"{path} has LeRobot's format {info.get('codebase_version')}; {FORMAT} is needed."
            )
        self._features = info.get("features") or {}
        if problems := list(_problems(info, self._features)):
            raise DataError(
                f"Nothing that plays here can be learned from {path}: {' '.join(problems)}"
            )
        found = {key: feature_names(info, key) for key in (STATE, OBJECT_STATE, ACTION)}
        self.names = {key: list(map(str, names)) for key, names in found.items() if names}
        """What the numbers of its features are, where it says so."""
        self.suite_version = (self._read("meta/duobench.json") or {}).get(SUITE)
        """Version of the suite that its episodes are of, where it says so."""
        if self.suite_version not in (None, SUITE_VERSION):
            raise DataError(
                f"{path} is of suite {self.suite_version}; this version has suite {SUITE_VERSION}, "
                "whose episodes are others. Record or generate and export them again."
            )

    def _read(self, name: str) -> dict[str, Any] | None:
        path = self.path / name
        try:
            content = json.loads(path.read_bytes())
        except FileNotFoundError:
            return None
        except (OSError, ValueError) as error:
            raise DataError(f"Cannot read {path}: {error}") from error
        if not isinstance(content, dict):
            raise DataError(f"Cannot read {path}: it holds a {type(content).__name__}, no object.")
        return content

    def episodes(self) -> list[str] | None:
        """The task of each episode; None if nothing says so, as in a merged data set."""
        about = self._read("meta/duobench.json")
        if about is None:
            return None
        try:
            return [Path(episode["file"]).parent.name for episode in about["episodes"]]
        except (KeyError, TypeError) as error:
            raise DataError(
                f"meta/duobench.json of {self.path} does not list episodes with their files, as an "
                "export does; export again."
            ) from error

    @property
    def holds_objects_alone(self) -> bool:
        """Whether there are object states, and no images."""
        return OBJECT_STATE in self._features and not any(
            key.startswith(IMAGE_PREFIX) for key in self._features
        )

    def mixes_domains(self) -> bool:
        """Whether there are simulated and real episodes."""
        domains = (self._read("meta/stats.json") or {}).get(DOMAIN)
        return (
            DOMAIN in self._features
            and isinstance(domains, dict)
            and domains.get("min") != domains.get("max")
        )


def _problems(info: Mapping[str, Any], features: Any) -> Iterator[str]:
    """What keeps a policy that learns from a data set from playing here, one sentence each."""
    if info.get("fps") != CONTROL_HZ:
        yield f"It has {info.get('fps')} rows a second; {CONTROL_HZ:g} are needed."
    if not isinstance(features, Mapping):
        features = {}
    names = feature_names(info, ACTION)
    labels = action_labels.find(JOINT_NAMES if names is None else names)
    if labels is None:
        yield (
            f"Its actions are {', '.join(map(str, names or ()))}, which no action mode has; see "
            "docs/lerobot.md for the names."
        )
    else:
        yield from _wrong_shape(features, ACTION, len(labels.names))
    yield from _wrong_shape(features, STATE, len(JOINT_NAMES))
    if (names := feature_names(info, STATE)) not in (None, list(JOINT_NAMES)):
        yield f"{STATE} is {', '.join(map(str, names))}; {', '.join(JOINT_NAMES)} are needed."
    for key in features:
        if key.startswith("observation") and key not in _SEEN:
            yield f"There is no {key} here; a policy sees {', '.join(_SEEN)}."


_SEEN = (STATE, OBJECT_STATE, *(f"{IMAGE_PREFIX}{camera}" for camera in POLICY_CAMERAS))
"""What an environment can show, under the names of a data set."""


def _wrong_shape(features: Mapping[str, Any], key: str, size: int) -> Iterator[str]:
    feature = features.get(key)
    shape = feature.get("shape") if isinstance(feature, Mapping) else None
    if list(shape or ()) != [size]:
        yield f"{key} has shape {shape}; [{size}] is needed."
