"""Depth as a stereo camera measures it: range, noise, and holes where it cannot match."""

import hashlib
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from duobench.world.robot.camera_geometry import matrix_of
from duobench.world.robot.cameras import (
    FARTHEST,
    NATIVE_WIDTH,
    ZED_MINI,
    Camera,
    RobotCamera,
)

Depth = NDArray[np.float32]

D405_BASELINE, ZED_BASELINE = 0.018, 0.063
"""Distance between the two lenses of a camera in metres [data sheets]."""
D405_NEAREST, ZED_NEAREST = 0.07, 0.10
"""Smallest distance in metres [data sheets: ideal range 7 to 50 cm; 0.1 to 15 m]."""
UNIT = 1e-4
"""Metres that a measured distance is a whole number of, as those of a D405 are."""
PATCH = 4
"""Side in pixels of the patches that holes on shiny things are made of."""


class StereoQuality(NamedTuple):
    """Quality of the depth of a stereo camera."""

    subpixel: float
    """Standard deviation of the matched disparity in native pixels; 0.08 on textured walls."""
    farthest: float
    """Distance in metres from which on a D405 gives none."""
    shiny_share: float
    """Share of the surface of shiny things that is not matched."""


def measured_depth(
    depth: Depth,
    shiny: NDArray[np.bool_],
    camera: RobotCamera | Camera,
    quality: StereoQuality,
    key: bytes,
) -> Depth:
    """A depth image (height, width) as a camera measures it; 0 where it gives none.

    The head measures as a ZED Mini, every other camera as an Intel RealSense D405:

    - Nothing nearer than 7 cm, or beyond the range that the quality says; 50 cm end the ideal one
      [Intel, data sheet of the D400 family, 337029].
    - The standard deviation of noise is z² · subpixel / (focal length · baseline), with 650 native
      pixels and 18 mm 1.7 mm at 0.5 m [Intel, Tuning depth cameras for best performance].
    - Where the right imager does not see what the left one sees, beside edges of what is nearer,
      there is a hole.
    - Patches of what is shiny, bare metal and glass, are not matched: the two imagers see different
      reflections there.

    Args:
        depth: True distances along the optical axis in metres, 0 for none.
        shiny: Pixels that show what is shiny.
        camera: The camera.
        quality: How good it is.
        key: Seed of the samples: the same key, camera name and size, the same image.
    """
    is_zed = isinstance(camera, RobotCamera) and camera.kind == ZED_MINI
    baseline = ZED_BASELINE if is_zed else D405_BASELINE
    nearest = ZED_NEAREST if is_zed else D405_NEAREST
    farthest = FARTHEST if is_zed else min(quality.farthest, FARTHEST)
    height, width = depth.shape
    across = float(matrix_of(camera, (height, width))[0, 0])
    native = across * NATIVE_WIDTH / width
    digest = hashlib.blake2b(key + camera.name.encode(), digest_size=16).digest()
    rng = np.random.Generator(np.random.PCG64(int.from_bytes(digest, "big")))
    noise = rng.standard_normal(depth.shape, dtype=np.float32)
    patches = rng.random((-(-height // PATCH), -(-width // PATCH)))
    z = depth.astype(np.float64)
    measured = z + z * z * (quality.subpixel / (native * baseline)) * noise
    unmatched = np.repeat(np.repeat(patches, PATCH, axis=0), PATCH, axis=1)
    shown = (z > 0.0) & (measured >= nearest) & (measured <= farthest)
    shown &= ~_hidden(z, across * baseline)
    shown &= ~(shiny & (unmatched[:height, :width] < quality.shiny_share))
    return np.where(shown, np.rint(measured / UNIT) * UNIT, 0.0).astype(np.float32)


def _hidden(z: NDArray[np.float64], disparity: float) -> NDArray[np.bool_]:
    """Pixels whose point something nearer hides from the right imager.

    That one shows a pixel of column x at `x - disparity / z`, with the disparity in pixels at 1 m;
    it is hidden by any to its right that is shown further to the left.
    """
    columns = np.arange(z.shape[1]) - disparity / np.where(z > 0.0, z, np.inf)
    leftmost = np.minimum.accumulate(columns[:, ::-1], axis=1)[:, ::-1]
    hidden = np.zeros(z.shape, dtype=bool)
    hidden[:, :-1] = columns[:, :-1] > leftmost[:, 1:]
    return hidden
