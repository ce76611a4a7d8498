from pathlib import Path

import numpy as np
import pytest

from duobench.core.errors import DuoBenchError, PolicyError, ServingError, UnknownNameError
from duobench.policy.serving.message_format import FORMATS, MessageFormat, read_format

ARMS_FIRST = np.array([*range(7), *range(8, 15), 7, 15])


def observation(size: tuple[int, int] = (224, 224)) -> dict:
    drawn = np.random.default_rng(0)
    cameras = ("head", "left_wrist", "right_wrist")
    pixels = {name: drawn.integers(0, 255, (*size, 3), np.uint8) for name in cameras}
    return {
        "agent_pos": np.arange(16, dtype=np.float32),
        "tcp_pose": np.arange(100, 114, dtype=np.float32),
        "pixels": pixels,
    }


def written(folder: Path, text: str) -> str:
    path = folder / "mine.toml"
    path.write_text(text)
    return str(path)


@pytest.mark.parametrize("name", FORMATS)
def test_message_format_of_the_package_asks_and_understands(name: str) -> None:
    message_format = read_format(name)
    metadata = message_format.metadata(name, "1")
    assert metadata.image_size == (224, 224)
    assert "head" in metadata.cameras
    request = message_format.request(observation(), "Do it.")
    assert request[message_format.prompt] == "Do it."
    assert message_format.chunk(np.zeros((50, 16))).shape == (50, 16)
    if name == "vla_eval":  # arms before grippers
        np.testing.assert_array_equal(message_format.chunk(ARMS_FIRST[None]), [np.arange(16)])
        np.testing.assert_array_equal(message_format.measured_action(observation()), ARMS_FIRST)


GRIPPERS = {
    "aloha": ((0, 1), (0, 1)),
    "droid": ((1, 0), (1, 0)),
    "libero": ((0, 1), (1, -1)),
    "vla_eval": ((0, 1), (0, 1)),
    "vlagents": ((0, 1), (0, 1)),
}
"""What closed and open are in states, and in actions, to those whose keys a format has."""


@pytest.mark.parametrize("name", FORMATS)
def test_grippers_of_each_format_mean_what_they_mean_to_its_source(name: str) -> None:
    """The left hand is closed, the right one open."""
    message_format = read_format(name)
    states, actions = GRIPPERS[name]
    seen = observation()
    seen["agent_pos"][:] = 9
    seen["agent_pos"][[7, 15]] = 0, 1
    request = message_format.request(seen, "")
    grippers: list[float] = []
    for key in message_format.state:
        values = request
        for part in key.split("."):
            values = values[part]
        grippers += [number for number in values if number not in (9, *seen["tcp_pose"])]
    assert grippers == list(states)
    asked = message_format.measured_action(seen)
    assert [number for number in asked if number != 9] == list(actions)
    np.testing.assert_array_equal(message_format.chunk(asked[None])[0], seen["agent_pos"])


def test_parts_and_images_are_where_each_format_has_them() -> None:
    seen = observation()
    aloha, droid, vla_eval = (
        read_format(name).request(seen, "") for name in ("aloha", "droid", "vla_eval")
    )
    head = seen["pixels"]["head"].transpose(2, 0, 1)  # channels first
    np.testing.assert_array_equal(aloha["images"]["cam_high"], head)
    parts = [droid[f"observation/{name}_position"] for name in ("joint", "gripper")]
    np.testing.assert_array_equal(np.concatenate(parts), [*ARMS_FIRST[:14], 1 - 7, 1 - 15])
    assert vla_eval["images"].keys() == {"head", "left_wrist", "right_wrist"}
    for state in (aloha["state"], vla_eval["states"]):
        np.testing.assert_array_equal(state, np.arange(16))


def test_poses_are_parts_of_a_state(tmp_path: Path) -> None:
    message_format = read_format(written(tmp_path, '[state]\ntools = ["right_pose", "left_pose"]'))
    state = message_format.request(observation(), "")["tools"]
    np.testing.assert_array_equal(state, [*range(107, 114), *range(100, 107)])


def test_gripper_polarity_is_turned_in_states_and_actions(tmp_path: Path) -> None:
    text = 'gripper = "closed_is_one"\n[state]\nstate = ["left_gripper", "right_arm"]'
    message_format = read_format(written(tmp_path, text))
    assert message_format.request(observation(), "")["state"][0] == 1 - 7
    given = np.tile(np.arange(16, dtype=np.float32), (2, 1))
    expected = given.copy()
    expected[:, [7, 15]] = -6, -14
    np.testing.assert_array_equal(message_format.chunk(given), expected)


def test_letterbox_keeps_the_ratio_between_black_bars(tmp_path: Path) -> None:
    text = 'resize = "letterbox"\n[images]\nfront = "head"'
    message_format = read_format(written(tmp_path, text))
    assert message_format.metadata("", "").image_size == (126, 224)
    seen = observation((126, 224))
    expected = np.zeros((224, 224, 3))
    expected[49:175] = seen["pixels"]["head"]
    np.testing.assert_array_equal(message_format.request(seen, "")["front"], expected)


def test_batch_of_one_chunk_is_a_chunk_and_other_widths_are_refused(tmp_path: Path) -> None:
    message_format = MessageFormat()
    assert message_format.chunk(np.zeros((1, 4, 16))).shape == (4, 16)
    with pytest.raises(PolicyError, match=r"\(H, 16\)"):
        message_format.chunk(np.zeros((4, 14)))
    with pytest.raises(PolicyError, match="array of numbers"):
        message_format.chunk([[1.0], [1.0, 2.0]])
    relative = read_format(written(tmp_path, '[actions]\nmode = "cartesian_relative"'))
    assert relative.chunk(np.zeros((4, 14))).shape == (4, 14)


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        ('imagse = "x"', UnknownNameError, "key of a format 'imagse'. Did you mean 'images'"),
        ('[actions]\nodrer = ["x"]', UnknownNameError, "'odrer'. Did you mean 'order'"),
        ('[state]\ns = ["left_amr"]', UnknownNameError, "'left_amr'. Did you mean 'left_arm'"),
        ('[actions]\norder = ["left_arm"]', ServingError, "each once"),
        ('image_order = "cwh"', ServingError, "image_order"),
        ("image_size = [0, 5]", ServingError, "cannot be made"),
        ('image_size = [100, 224]\nresize = "letterbox"', ServingError, "letterbox needs"),
        ("images = 3", ServingError, "images"),
        ("[state]\ns = []", ServingError, "'s' has no parts"),
        ('[images]\na = "head"\n[state]\na = ["left_arm"]', ServingError, "things at 'a'"),
        ('[images]\n"a.b" = "head"\n[state]\na = ["left_arm"]', ServingError, "things at 'a'"),
        ('[images]\na = "head"\n[state]\n"a.b" = ["left_arm"]', ServingError, "things at 'a'"),
        ('[images]\nprompt = "head"', ServingError, "things at 'prompt'"),
        ("=", ServingError, "Cannot read the format .* Invalid statement"),
    ],
)
def test_message_format_with_a_mistake_is_refused_in_words(
    tmp_path: Path, text: str, error: type[DuoBenchError], message: str
) -> None:
    with pytest.raises(error, match=message):
        read_format(written(tmp_path, text))


def test_unknown_layout_lists_the_known_ones(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'aloha'"):
        read_format("alhoa")
    with pytest.raises(ServingError, match="Cannot read the format"):
        read_format(str(tmp_path / "absent.toml"))
