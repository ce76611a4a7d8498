"""The light from all around: its file, and what a matt surface gets of it."""

import struct

import numpy as np
import pytest

from duobench.world.looks.surroundings import (
    _directions,
    _matt,
    _packed,
    _radiance,
    image_light,
)

HEAD = 64
"""Bytes of the head of a file."""


def test_the_file_holds_what_its_head_says() -> None:
    content = image_light()
    assert content == image_light()
    assert content[:12] == b"\xabKTX 11\xbb\r\n\x1a\n"
    _, _, _, _, _, _, width, height, _, _, faces, levels, words = struct.unpack(
        "<13I", content[12:HEAD]
    )
    place = HEAD + words
    for level in range(levels):
        (size,) = struct.unpack("<I", content[place : place + 4])
        assert size == 4 * (width >> level) * (height >> level)
        place += 4 + faces * size
    assert place == len(content)


def test_colours_survive_their_packing() -> None:
    colours = np.array([[0.0, 1.0, 2.5], [0.3, 9.0, 0.7]], dtype=np.float32)
    packed = _packed(colours)
    numbers = [packed << 4 & 0x7FF0, packed >> 7 & 0x7FF0, packed >> 17 & 0x7FE0]
    found = np.stack(numbers, axis=-1).astype(np.uint16).view(np.float16)
    assert found == pytest.approx(colours, rel=0.04)


@pytest.mark.parametrize("facing", [(0, 0, 1), (0, 0, -1), (1, 0, 0), (0, 0.6, 0.8)])
def test_a_matt_surface_gets_the_light_of_its_half_of_the_room(
    facing: tuple[float, float, float],
) -> None:
    seen = _directions(64).reshape(-1, 3)
    share = np.max(np.abs(seen), axis=1) ** 3
    cosine = np.clip(seen @ np.array(facing), 0.0, None)
    light = _radiance(seen, 0.0)
    expected = (4 * (share * cosine)[:, None] * light).sum(axis=0) / share.sum()
    x, y, z = facing[0], facing[2], -facing[1]  # of the cube, whose y points up
    basis = [1, y, z, x, x * y, y * z, 3 * z * z - 1, x * z, x * x - y * y]
    found = (np.array(basis)[:, None] * _matt()).sum(axis=0)
    assert found == pytest.approx(expected, rel=0.08)


def test_what_is_rough_mirrors_the_same_light_less_sharply() -> None:
    seen = _directions(64)
    share = np.max(np.abs(seen), axis=-1, keepdims=True) ** 3
    sharp, soft = (_radiance(seen, roughness) for roughness in (0.0, 0.8))
    assert soft.max() < sharp.max() / 2
    assert np.sum(share * soft) == pytest.approx(np.sum(share * sharp), rel=0.15)
