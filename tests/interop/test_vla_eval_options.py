"""Parameters of vla-eval's DuoBench, and what is refused of them."""

from typing import Any

import pytest

from duobench.errors import DuoBenchError, OptionError, UnknownNameError
from duobench.interop.vla_eval_options import format_for, tasks_by_id
from duobench.policy.serving.message_format import MessageFormat, read_format
from duobench.tasks import catalog
from tests.evaluation import toy_tasks

DEFAULTS: dict[str, Any] = {
    "name": "vla_eval",
    "control_mode": None,
    "relative_to": None,
    "send_state": True,
    "send_wrist_image": True,
    "camera_resolution": None,
}


def chosen(**options: Any) -> MessageFormat:
    return format_for(**DEFAULTS | options)


def test_without_parameters_it_is_the_format() -> None:
    assert chosen() == read_format("vla_eval")


@pytest.mark.parametrize(
    ("control_mode", "relative_to", "mode"),
    [
        ("joints", None, "joint"),
        (None, "last_step", "joint_relative"),
        ("JOINTS", "NONE", "joint"),
        ("cartesian_tquat", None, "cartesian"),
        ("cartesian_rotvec", "last_step", "cartesian_relative"),
    ],
)
def test_control_mode_and_frame_are_an_action_mode(
    control_mode: str | None, relative_to: str | None, mode: str
) -> None:
    message_format = chosen(control_mode=control_mode, relative_to=relative_to)
    assert message_format.actions.mode == mode


def test_what_is_shown_can_be_less() -> None:
    message_format = chosen(send_state=False, send_wrist_image=False, camera_resolution=[96, 128])
    assert dict(message_format.images) == {"images.head": "head"}
    assert not message_format.state
    assert message_format.image_size == (96, 128)


@pytest.mark.parametrize(
    "resolution", [(48, 64), {name: [48, 64] for name in ("head", "left_wrist", "right_wrist")}]
)
def test_resolution_is_one_for_all_images(resolution: object) -> None:
    assert chosen(camera_resolution=resolution).image_size == (48, 64)
    assert chosen(camera_resolution=96).image_size == (96, 96)
    assert chosen(camera_resolution={"head": 224}).image_size == (224, 224)
    assert chosen(camera_resolution={}).image_size == (224, 224)


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"control_mode": "cartesian_trpy"}, OptionError, "joints with none or"),
        (
            {"control_mode": "cartesian_tquat", "relative_to": "last_step"},
            OptionError,
            "rotation vector",
        ),
        ({"relative_to": "configured_origin"}, OptionError, "configured_origin"),
        ({"camera_resolution": {"head": [96, 96]}}, OptionError, "one size"),
        (
            {"camera_resolution": {"head": [96, 96], "left_wrist": [1, 1], "right_wrist": [1, 1]}},
            OptionError,
            "one size",
        ),
        ({"camera_resolution": {"haed": [96, 96]}}, UnknownNameError, "Did you mean 'head'"),
        ({"camera_resolution": [9000, 96]}, OptionError, "at most"),
        ({"camera_resolution": [96]}, OptionError, "height, width"),
        ({"camera_resolution": "96"}, OptionError, "height, width"),
        ({"camera_resolution": {"head": None}}, OptionError, "height, width"),
        ({"name": "vla_evl"}, UnknownNameError, "Did you mean 'vla_eval'"),
    ],
)
def test_what_there_is_not_is_refused_in_words(
    options: dict[str, Any], error: type[DuoBenchError], message: str
) -> None:
    with pytest.raises(error, match=message):
        chosen(**options)


def test_tasks_are_those_of_the_benchmark_or_anybodys() -> None:
    assert tuple(tasks_by_id(None)) == catalog.names()
    assert tasks_by_id(["bin_sort", toy_tasks.WAVE_NAME]) == {
        "bin_sort": "bin_sort",
        "wave": toy_tasks.WAVE_NAME,
    }
    assert tasks_by_id("bin_sort") == {"bin_sort": "bin_sort"}
    with pytest.raises(OptionError, match="named twice"):
        tasks_by_id(["bin_sort", "bin_sort"])
    with pytest.raises(UnknownNameError, match="Did you mean 'bin_sort'"):
        tasks_by_id(["bin_sotr"])
