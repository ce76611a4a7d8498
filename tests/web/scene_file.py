"""Reads a scene file as a browser does."""

import gzip
import json
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from duobench.core.spatial import matrix_from_wxyz

NO_SHADOWS = 1 << 16


@dataclass(frozen=True)
class SceneFile:
    header: dict[str, Any]
    points: NDArray[np.float32]
    normals: NDArray[np.float64]
    emission: NDArray[np.uint8]
    colours: NDArray[np.uint8]
    highlight: NDArray[np.uint8]
    bodies: NDArray[np.uint32]
    triangles: NDArray[np.int64]

    def placed(self, poses: NDArray[np.float32]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Points and normals (n, 3) in the world, for poses of the moving bodies."""
        everywhere = np.vstack([[0, 0, 0, 1, 0, 0, 0], poses]).astype(np.float64)
        rotations = np.array([matrix_from_wxyz(pose[3:]) for pose in everywhere])
        bodies = self.bodies % NO_SHADOWS
        points = np.einsum("nij,nj->ni", rotations[bodies], self.points)
        normals = np.einsum("nij,nj->ni", rotations[bodies], self.normals)
        return points + everywhere[bodies, :3], normals


def read_scene(data: bytes) -> SceneFile:
    content = gzip.decompress(data)
    length = int.from_bytes(content[:4], "little")
    header = json.loads(content[4 : 4 + length])
    count, start = header["vertices"], 4 + length

    def take(kind: str, width: int, rows: int) -> NDArray[Any]:
        nonlocal start
        plane = np.frombuffer(content, kind, width * rows, start).reshape(rows, width)
        start += plane.nbytes
        return plane

    points = take("<f4", 3, count)
    shading, tints = take("u1", 4, count), take("u1", 4, count)
    bodies = take("<u4", 1, count)[:, 0]
    corners = np.cumsum(take("<i4", 1, header["corners"])[:, 0], dtype=np.int64)
    assert start == len(content)
    assert (start - 4 - length - 4 * header["corners"]) == 24 * count
    return SceneFile(
        header=header,
        points=points,
        normals=shading[:, :3].view(np.int8) / 127,
        emission=shading[:, 3],
        colours=tints[:, :3],
        highlight=tints[:, 3],
        bodies=bodies,
        triangles=corners.reshape(-1, 3),
    )
