"""Pictures of depth and parts: colours, their order, and the names below them."""

import numpy as np

from duobench.core.false_colours import (
    FARTHEST,
    depth_legend,
    depth_picture,
    pictures,
    segmentation_legend,
    segmentation_picture,
    with_legend,
)


def test_far_is_darker_than_near_and_nothing_is_black() -> None:
    depth = np.array([[0.05, 0.1, 0.3, 1.0, FARTHEST, 6.0, 0.0]], np.float32)
    picture = depth_picture(depth)
    assert (picture.shape, picture.dtype) == ((1, 7, 3), np.uint8)
    light = picture[0].astype(int) @ (299, 587, 114)
    assert light[0] == light[1] > light[2] > light[3] > light[4] == light[5] > light[6] == 0
    assert depth_legend()["1 m"] == tuple(picture[0, 3])


def test_parts_have_colours_of_their_own_that_the_legend_names() -> None:
    numbers = np.array([[0, 1, 2, 7], [40, 41, 7, 7]], np.int32)
    picture = segmentation_picture(numbers)
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) == 6
    legend = segmentation_legend(numbers, {"table": 1, "cup": 7, "unseen": 9})
    assert legend == {"table": tuple(picture[0, 1]), "cup": tuple(picture[0, 3])}
    every = segmentation_picture(np.arange(60, dtype=np.int32)[None])
    assert len(np.unique(every[0], axis=0)) == 60


def test_a_legend_has_as_many_lines_as_it_needs() -> None:
    picture = np.zeros((20, 100, 3), np.uint8)
    one, three = (
        with_legend(picture, dict.fromkeys(names, (1, 2, 3))) for names in ("a", "abcdefg")
    )
    assert one.shape[1] == three.shape[1] == 100
    assert 20 < one.shape[0] < three.shape[0]
    np.testing.assert_array_equal(one[:20], picture)


def test_what_is_seen_is_shown_kind_by_kind() -> None:
    seen = {
        "agent_pos": np.zeros(16),
        "segmentation": {"head": np.ones((2, 3), np.int32)},
        "depth": {"head": np.ones((2, 3), np.float32)},
        "pixels": {"side": np.zeros((2, 3, 3), np.uint8)},
    }
    found = dict(pictures(seen))
    assert [*found] == ["side", "head depth", "head segmentation"]
    assert {image.shape for image in found.values()} == {(2, 3, 3)}
