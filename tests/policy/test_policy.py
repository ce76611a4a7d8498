from typing import Any

import msgspec
import numpy as np
import pytest

from duobench.envs.config import EnvConfig
from duobench.errors import PolicyError
from duobench.policy import PolicyMetadata, as_chunk
from duobench.types import POLICY_CAMERAS


def test_chunk_is_returned_as_float32() -> None:
    chunk = as_chunk([[0] * 16, [1] * 16])
    assert chunk.shape == (2, 16)
    assert chunk.dtype == np.float32


@pytest.mark.parametrize("shape", [(16,), (0, 16), (1, 15), (1, 1, 16), ()])
def test_wrong_shape_is_refused_with_the_right_one(shape: tuple[int, ...]) -> None:
    with pytest.raises(PolicyError, match=r"\(H, 16\).*actions\[None, :\]"):
        as_chunk(np.zeros(shape))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_number_that_is_not_finite_is_refused_with_its_place(bad: float) -> None:
    actions = np.zeros((3, 16))
    actions[2, 5] = bad
    with pytest.raises(PolicyError, match="action 2 of its chunk, number 5"):
        as_chunk(actions)


@pytest.mark.parametrize(
    "nonsense",
    [
        "left",
        None,
        [[0] * 16, [0] * 3],
        {"a": 1},
        [[10**309]],
        np.zeros((1, 16), dtype=complex),
        [["1"] * 16],
        np.zeros((1, 16), dtype="timedelta64[s]"),
        np.ma.masked_equal(np.zeros((1, 16)), 0.0),
    ],
    ids=str,
)
def test_what_is_no_array_is_refused(nonsense: object) -> None:
    with pytest.raises(PolicyError):
        as_chunk(nonsense)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("name", ["name", "version", "dtype", "device"])
def test_text_that_cannot_be_written_down_is_refused_as_given(name: str) -> None:
    message = rf"The {name} of a policy is printable text, got 'w\\udcff'"
    with pytest.raises(PolicyError, match=message):
        PolicyMetadata(**{"name": "mine", name: "w\udcff"})


@pytest.mark.parametrize(
    "fields",
    [
        {"control_rate_hz": 0.0},
        {"control_rate_hz": float("nan")},
        {"image_size": (0, 224)},
        {"image_size": (224,)},
        {"image_size": 0},
        {"image_size": True},
        {"image_size": "32"},
        {"image_size": (224.5, 224)},
        {"version": 3},
        {"name": 3},
        {"action_mode": None},
        {"cameras": None},
        {"cameras": (1,)},
        {"control_rate_hz": "often"},
        {"horizon": 1.5},
        {"horizon": "3"},
        {"horizon": 0},
    ],
)
def test_metadata_that_no_environment_meets_is_refused(fields: dict[str, Any]) -> None:
    given: dict[str, Any] = {"name": "mine"} | fields
    with pytest.raises(PolicyError):
        PolicyMetadata(**given)


def test_metadata_takes_numpy_numbers_and_one_camera() -> None:
    given = PolicyMetadata(name="mine", cameras="head", image_size=np.array([48, 64]))  # type: ignore[arg-type]
    assert given == PolicyMetadata(name="mine", cameras=("head",), image_size=(48, 64))
    assert all(type(pixels) is int for pixels in given.image_size or ())


@pytest.mark.parametrize("size", [32, np.int64(32)])
def test_one_number_is_a_square_image(size: Any) -> None:
    assert PolicyMetadata(name="mine", image_size=size).image_size == (32, 32)


def test_metadata_of_numpy_can_be_written_down() -> None:
    given = PolicyMetadata(
        name="mine",
        control_rate_hz=np.float32(30),  # type: ignore[arg-type]
        horizon=np.int64(3),  # type: ignore[arg-type]
        object_state=np.True_,  # type: ignore[arg-type]
        seeded=np.False_,  # type: ignore[arg-type]
    )
    assert msgspec.json.decode(msgspec.json.encode(given), type=PolicyMetadata) == given


def test_chunk_does_not_change_when_the_policy_uses_its_array_again() -> None:
    actions = np.zeros((1, 16), np.float32)
    chunk = as_chunk(actions)
    actions[:] = 1
    assert not chunk.any()


def test_a_first_policy_sees_what_an_environment_shows_by_default() -> None:
    assert PolicyMetadata(name="mine").cameras == EnvConfig().cameras == POLICY_CAMERAS
