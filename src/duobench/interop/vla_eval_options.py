"""The parameters that vla-eval's own DuoBench has, turned into a format."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from duobench.envs.config import EnvConfig
from duobench.errors import OptionError
from duobench.policy.serving.message_format import MessageFormat, read_format
from duobench.policy.serving.vla_eval import MODES
from duobench.tasks import catalog
from duobench.types import HEAD

Size = Sequence[int] | int
Resolution = Mapping[str, Size] | Size


def format_for(
    name: str,
    *,
    control_mode: str | None,
    relative_to: str | None,
    send_state: bool,
    send_wrist_image: bool,
    camera_resolution: Resolution | None,
) -> MessageFormat:
    """A format with what a configuration changes about it.

    Args:
        name: Name of a format, or the path of a file that ends in `.toml`.
        control_mode: What an arm's numbers are; None takes the format's.
        relative_to: What they are relative to; None takes the format's.
        send_state: Whether there is a state.
        send_wrist_image: Whether the wrist cameras are shown.
        camera_resolution: [height, width] of all images, or of each by its camera.

    Raises:
        DuoBenchError: If there is no such format, or no environment like that.
    """
    message_format = read_format(name)
    mode = _mode(message_format.actions.mode, control_mode, relative_to)
    images = {
        key: camera
        for key, camera in message_format.images.items()
        if send_wrist_image or camera == HEAD
    }
    return replace(
        message_format,
        images=images,
        image_size=_size(camera_resolution, message_format),
        state=message_format.state if send_state else {},
        actions=replace(message_format.actions, mode=mode),
    )


def tasks_by_id(import_paths: Sequence[str] | None) -> dict[str, str]:
    """Import paths of tasks by their ids: all of the benchmark if there are none.

    Raises:
        UnknownNameError: If there is no such task.
        OptionError: If one is named twice.
    """
    if isinstance(import_paths, str):
        import_paths = [import_paths]
    paths: dict[str, str] = {}
    for path in import_paths or catalog.names():
        task_id = catalog.get(path).id
        if task_id in paths:
            raise OptionError(f"Task {task_id!r} is named twice in task_ids. Name each task once.")
        paths[task_id] = path
    return paths


def _mode(usual: str, control_mode: str | None, relative_to: str | None) -> str:
    control, relative = next((key for key, mode in MODES.items() if mode == usual), (usual, "none"))
    mode = str(control_mode or control).lower(), str(relative_to or relative).lower()
    if mode in MODES:
        return MODES[mode]
    known = " or ".join(f"{theirs} with {frame}" for theirs, frame in MODES)
    raise OptionError(
        f"There are no actions with control_mode {mode[0]!r} and relative_to {mode[1]!r}. There "
        f"are {known}: poses are x y z qx qy qz qw, displacements of the tool a translation and a "
        "rotation vector along the axes of the table frame."
    )


def _size(resolution: Resolution | None, message_format: MessageFormat) -> tuple[int, int]:
    if resolution is None:
        return message_format.image_size
    if not isinstance(resolution, Mapping):
        return _checked(resolution)
    EnvConfig.from_options({"cameras": resolution.keys()})
    sizes = {_checked(size) for size in resolution.values()}
    if not set(message_format.images.values()) <= resolution.keys():
        sizes.add(message_format.image_size)
    if len(sizes) > 1:
        raise OptionError(
            "All images have one size here: give camera_resolution as [height, width], or with the "
            f"same size for each camera; got {resolution!r}."
        )
    return sizes.pop() if sizes else message_format.image_size


def _checked(size: object) -> tuple[int, int]:
    return EnvConfig.from_options({"image_size": size}).image_size
