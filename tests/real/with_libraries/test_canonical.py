"""OpenCV and NumPy make the same canonical images."""

from __future__ import annotations

import numpy as np
import pytest

from duobench.real.canonical import CanonicalView, remapped
from tests.real.lenses import ZED

cv2 = pytest.importorskip("cv2", reason="It is not installed here: make test-hardware")


def test_both_ways_agree() -> None:
    noise = np.random.default_rng(0).integers(0, 256, (45, 80, 3), dtype=np.uint8)
    image = cv2.resize(noise, (1280, 720), interpolation=cv2.INTER_CUBIC)
    view = CanonicalView("head", ZED)
    assert view._map is not None
    by_numpy = remapped(image, view._map).astype(int)
    error = np.abs(view.image(image) - by_numpy)[4:-4, 4:-4]
    assert error.max() <= 3
    assert error.mean() < 0.3


def test_lenses_are_those_of_the_library() -> None:
    matrix = np.array([[ZED.fx, 0, ZED.cx], [0, ZED.fy, ZED.cy], [0, 0, 1]])
    wanted = np.array([[740.0, 0, 639.5], [0, 740.0, 359.5], [0, 0, 1]])
    maps = cv2.initUndistortRectifyMap(
        matrix, np.array(ZED.distortion), None, wanted, (1280, 720), cv2.CV_32FC2
    )
    np.testing.assert_allclose(CanonicalView("head", ZED)._map, maps[0], atol=1e-3)
