from pathlib import Path

import numpy as np
import pytest

from duobench.errors import DuoBenchError, PolicyError, ServingError, UnknownNameError
from duobench.policy.serving.layout import LAYOUTS, Layout, read_layout

PARTS = ["left_arm", "left_gripper", "right_arm", "right_gripper"]


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


@pytest.mark.parametrize("name", LAYOUTS)
def test_layout_of_the_package_asks_and_understands(name: str) -> None:
    layout = read_layout(name)
    metadata = layout.metadata(name, "1", seeded=False)
    assert metadata.image_size == (224, 224)
    assert "head" in metadata.cameras
    request = layout.request(observation(), "Do it.")
    assert request[layout.prompt] == "Do it."
    assert layout.chunk(np.zeros((50, 16))).shape == (50, 16)


def test_aloha_nests_images_with_channels_first() -> None:
    request = read_layout("aloha").request(observation(), "Do it.")
    np.testing.assert_array_equal(
        request["images"]["cam_high"], observation()["pixels"]["head"].transpose(2, 0, 1)
    )
    np.testing.assert_array_equal(request["state"], np.arange(16))


def test_droid_orders_arms_before_grippers_both_ways() -> None:
    layout = read_layout("droid")
    request = layout.request(observation(), "Do it.")
    np.testing.assert_array_equal(request["observation/gripper_position"], [7, 15])
    joined = np.concatenate(
        [request["observation/joint_position"], request["observation/gripper_position"]]
    )
    np.testing.assert_array_equal(layout.chunk(joined[None]), np.arange(16)[None])


def test_vla_eval_nests_images_and_orders_arms_before_grippers() -> None:
    layout = read_layout("vla_eval")
    request = layout.request(observation(), "Do it.")
    assert request["images"].keys() == {"head", "left_wrist", "right_wrist"}
    np.testing.assert_array_equal(request["states"], np.arange(16))
    given = np.concatenate([np.arange(7), np.arange(8, 15), [7, 15]])
    np.testing.assert_array_equal(layout.chunk(given[None]), np.arange(16)[None])
    np.testing.assert_array_equal(layout.measured_action(observation()), given)


def test_poses_are_parts_of_a_state(tmp_path: Path) -> None:
    layout = read_layout(written(tmp_path, '[state]\ntools = ["right_pose", "left_pose"]'))
    state = layout.request(observation(), "")["tools"]
    np.testing.assert_array_equal(state, [*range(107, 114), *range(100, 107)])


def test_gripper_polarity_is_turned_in_states_and_actions(tmp_path: Path) -> None:
    text = 'gripper = "closed_is_one"\n[state]\nstate = ["left_gripper", "right_arm"]'
    layout = read_layout(written(tmp_path, text))
    assert layout.request(observation(), "")["state"][0] == 1 - 7
    given = np.tile(np.arange(16, dtype=np.float32), (2, 1))
    chunk = layout.chunk(given)
    np.testing.assert_array_equal(chunk[:, [7, 15]], [[-6, -14]] * 2)
    np.testing.assert_array_equal(np.delete(chunk, [7, 15], 1), np.delete(given, [7, 15], 1))


def test_letterbox_keeps_the_ratio_between_black_bars(tmp_path: Path) -> None:
    text = 'resize = "letterbox"\n[images]\nfront = "head"'
    layout = read_layout(written(tmp_path, text))
    assert layout.metadata("", "", seeded=True).image_size == (126, 224)
    seen = observation((126, 224))
    image = layout.request(seen, "")["front"]
    assert image.shape == (224, 224, 3)
    assert not image[:49].any()
    assert not image[175:].any()
    np.testing.assert_array_equal(image[49:175], seen["pixels"]["head"])


def test_batch_of_one_chunk_is_a_chunk_and_other_widths_are_refused(tmp_path: Path) -> None:
    layout = Layout()
    assert layout.chunk(np.zeros((1, 4, 16))).shape == (4, 16)
    with pytest.raises(PolicyError, match=r"\(H, 16\)"):
        layout.chunk(np.zeros((4, 14)))
    with pytest.raises(PolicyError, match="array of numbers"):
        layout.chunk([[1.0], [1.0, 2.0]])
    relative = read_layout(written(tmp_path, '[actions]\nmode = "cartesian_relative"'))
    assert relative.chunk(np.zeros((4, 14))).shape == (4, 14)


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        ('imagse = "x"', UnknownNameError, "key of a layout 'imagse'. Did you mean 'images'"),
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
        ("=", ServingError, "no TOML"),
    ],
)
def test_layout_with_a_mistake_is_refused_in_words(
    tmp_path: Path, text: str, error: type[DuoBenchError], message: str
) -> None:
    with pytest.raises(error, match=message):
        read_layout(written(tmp_path, text))


def test_unknown_layout_lists_the_known_ones(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'aloha'"):
        read_layout("alhoa")
    with pytest.raises(ServingError, match="cannot be read"):
        read_layout(str(tmp_path / "absent.toml"))
