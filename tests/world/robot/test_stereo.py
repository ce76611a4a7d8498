"""Depth as a stereo camera measures it, on images whose true depth is known."""

import math

import numpy as np
import pytest

from duobench.world.robot.cameras import CAMERAS, Camera
from duobench.world.robot.stereo import StereoQuality, measured_depth

SIZE = (120, 200)
GOOD = StereoQuality(subpixel=0.0, farthest=math.inf, shiny_share=0.0)
NOISY = StereoQuality(subpixel=0.08, farthest=math.inf, shiny_share=0.0)
WRIST, HEAD = CAMERAS["left_wrist"], CAMERAS["head"]
DULL = np.zeros(SIZE, dtype=bool)


def flat(distance: float) -> np.ndarray:
    return np.full(SIZE, distance, dtype=np.float32)


def test_noise_grows_with_the_square_of_the_distance() -> None:
    found = {}
    for distance in (0.2, 0.4, 0.8):
        measured = measured_depth(flat(distance), DULL, WRIST, NOISY, b"1")
        found[distance] = (measured - distance).std()
        assert measured.mean() == pytest.approx(distance, rel=1e-3)
        assert found[distance] == pytest.approx(distance**2 * 0.08 / (650 * 0.018), rel=0.05)
    assert found[0.8] / found[0.4] == pytest.approx(4.0, rel=0.02)
    head = measured_depth(flat(0.8), DULL, HEAD, NOISY, b"1")
    assert (head - 0.8).std() == pytest.approx(0.8**2 * 0.08 / (740 * 0.063), rel=0.05)


@pytest.mark.parametrize(
    ("camera", "distance", "is_measured"),
    [
        (WRIST, 0.06, False),
        (WRIST, 0.08, True),
        (WRIST, 0.45, True),
        (WRIST, 0.55, False),
        (HEAD, 0.09, False),
        (HEAD, 3.0, True),
        (HEAD, 0.0, False),
    ],
)
def test_a_range_ends_on_both_sides(camera: Camera, distance: float, *, is_measured: bool) -> None:
    quality = StereoQuality(subpixel=0.0, farthest=0.5, shiny_share=0.0)
    measured = measured_depth(flat(distance), DULL, camera, quality, b"1")
    assert measured.dtype == np.float32
    expected = distance if is_measured else 0.0
    assert measured == pytest.approx(flat(expected), abs=1e-6)


def test_what_the_right_imager_does_not_see_is_a_hole_left_of_what_is_nearer() -> None:
    depth = flat(0.6)
    depth[:, 100:140] = 0.2
    measured = measured_depth(depth, DULL, WRIST, GOOD, b"1")
    width = 650 * 200 / 1280 * 0.018 * (1 / 0.2 - 1 / 0.6)
    holes = np.flatnonzero(measured[60] == 0.0)
    assert holes.tolist() == list(range(100 - len(holes), 100))
    assert len(holes) == pytest.approx(width, abs=1.0)
    assert not (measured_depth(flat(0.6), DULL, WRIST, GOOD, b"1") == 0.0).any()


def test_a_share_of_what_is_shiny_is_a_hole() -> None:
    shiny = DULL.copy()
    shiny[:, 100:] = True
    quality = StereoQuality(subpixel=0.0, farthest=math.inf, shiny_share=0.6)
    holes = measured_depth(flat(0.3), shiny, WRIST, quality, b"1") == 0.0
    assert holes[:, 100:].mean() == pytest.approx(0.6, abs=0.05)
    assert not holes[:, :100].any()


def test_samples_follow_from_key_and_camera_alone() -> None:
    own = Camera(name="side", position=(0, 0, 1), look_at=(1, 0, 0))
    again, other, third = (
        measured_depth(flat(0.5), DULL, camera, NOISY, key)
        for camera, key in ((own, b"1"), (own, b"2"), (WRIST, b"1"))
    )
    measured = measured_depth(flat(0.5), DULL, own, NOISY, b"1")
    assert np.array_equal(measured, again)
    assert not np.array_equal(measured, other)
    assert not np.array_equal(measured, third)
