"""Real images become those of the simulation's cameras."""

from __future__ import annotations

import numpy as np
import pytest

from duobench.core.errors import OptionError
from duobench.core.types import Array
from duobench.envs.sim_env import SimEnv
from duobench.real.canonical import NATIVE, CanonicalView, focal_of, nominal_pose, remapped
from duobench.real.rig import UNPOSED, CameraCalibration
from duobench.tasks import catalog
from duobench.world.robot.cameras import HEAD, POLICY_CAMERAS, describe_cameras
from duobench.world.sim.rendering import Renderer
from tests.quick_first import quick_first
from tests.real.lenses import D405, ZED, directions_of


def pinhole(camera: str) -> CameraCalibration:
    focal = focal_of(camera)
    return CameraCalibration(fx=focal, fy=focal, cx=639.5, cy=359.5, pose=UNPOSED)


def waves(directions: Array) -> np.ndarray:
    """A smooth picture of the world, as a function of where one looks."""
    x, y = directions[..., 0], directions[..., 1]
    colours = [np.sin(40 * x), np.sin(40 * y), np.sin(25 * (x + y))]
    return np.rint(127.5 + 120 * np.stack(colours, axis=-1)).astype(np.uint8)


@pytest.mark.parametrize(("camera", "lens"), quick_first([(HEAD, ZED), ("left_wrist", D405)]))
def test_a_view_through_a_lens_becomes_that_of_the_simulation(
    camera: str, lens: CameraCalibration
) -> None:
    seen = waves(directions_of(lens))
    expected = waves(directions_of(pinhole(camera)))
    view = CanonicalView(camera, lens)
    error = np.abs(view.image(seen).astype(int) - expected)
    before = np.abs(seen.astype(int) - expected)
    assert view.coverage > 0.995
    inside = error[8:-8, 8:-8]
    assert inside.max() <= 4
    assert inside.mean() < 0.6
    assert before.mean() > 10 * inside.mean(), "the lens makes no difference in this test"


def test_a_rendered_image_comes_back() -> None:
    base = SimEnv(catalog.get("bin_sort"))
    base.reset(seed=3)
    with Renderer(base.simulation.model, height=720, width=1280) as renderer:
        rendered = renderer.render(base.simulation.data, HEAD)
    base.close()
    places = directions_of(ZED) * focal_of(HEAD) + (639.5, 359.5)
    view, white = CanonicalView(HEAD, ZED), np.full_like(rendered, 255)
    back = view.image(remapped(rendered, places))
    known = view.image(remapped(white, places)).min(axis=-1) == 255
    assert known.mean() > 0.98
    error = np.abs(back.astype(int) - rendered)[known]
    assert error.mean() < 2.0
    small = (72, 128)
    plain = CanonicalView(HEAD, None)
    coarse = np.abs(plain.image(back, small).astype(int) - plain.image(rendered, small))
    assert coarse[4:-4, 4:-4].mean() < 1.0


def test_places_outside_are_black() -> None:
    narrow = CameraCalibration(fx=1480.0, fy=1480.0, cx=639.5, cy=359.5, pose=UNPOSED)
    view = CanonicalView(HEAD, narrow)
    image = view.image(np.full((720, 1280, 3), 200, np.uint8))
    assert view.coverage == pytest.approx(0.25, abs=0.01)
    assert image[0, 0].max() == image[-1, -1].max() == 0
    assert image[360, 640].tolist() == [200, 200, 200]


def test_without_a_calibration_images_are_resized() -> None:
    view = CanonicalView(HEAD, None)
    image = np.zeros((*NATIVE, 3), np.uint8)
    image[:, ::2] = 200
    small = view.image(image, (90, 160))
    assert small.shape == (90, 160, 3)
    assert set(np.unique(small)) == {100}, "a pixel is the mean of what it covers"
    same = view.image(image)
    assert np.array_equal(same, image)
    assert not np.shares_memory(same, image)


def test_depth_is_that_of_one_pixel_and_none_outside() -> None:
    near_and_far = np.full(NATIVE, 0.2, np.float32)
    near_and_far[:, 640:] = 0.9
    near_and_far[360:] = 0.0
    shifted = CameraCalibration(fx=740.0, fy=740.0, cx=839.5, cy=359.5, pose=UNPOSED)
    for calibration, edge in ((None, 640), (shifted, 440)):
        view = CanonicalView(HEAD, calibration)
        for height, width in (NATIVE, (90, 160), (48, 48)):
            depth = view.depth(near_and_far, (height, width))
            assert (depth.shape, depth.dtype) == ((height, width), np.float32)
            assert {*np.unique(depth).tolist()} == {0.0, *map(float, np.float32([0.2, 0.9]))}
            row = depth[height // 4]
            assert abs(np.argmax(row > 0.5) - edge * width / 1280) <= 1.0
            assert not depth[height // 2 + 1 :].any()
            beyond = row[-(width // 8) :]
            assert beyond.all() == (calibration is None)


def test_cameras_of_other_sizes_are_remapped_too() -> None:
    half = CameraCalibration(fx=370.0, fy=370.0, cx=319.5, cy=179.5, pose=UNPOSED)
    view = CanonicalView(HEAD, half, (360, 640))
    seen = waves(directions_of(half, (360, 640)))
    error = np.abs(view.image(seen).astype(int) - waves(directions_of(pinhole(HEAD))))
    assert error[8:-8, 8:-8].max() <= 6
    with pytest.raises(OptionError, match="640x360 with 3 colours"):
        view.image(np.zeros((*NATIVE, 3), np.uint8))


@pytest.mark.parametrize("camera", POLICY_CAMERAS)
def test_lens_and_place_are_those_that_the_package_publishes(camera: str) -> None:
    described = describe_cameras()[camera]
    assert described["intrinsics"][0][0] == focal_of(camera)
    if camera == HEAD:
        pose = nominal_pose(camera)
        np.testing.assert_allclose(pose.rotation, np.array(described["frame_from_camera"])[:3, :3])
