import numpy as np
import pytest

from duobench.evaluation.video import Picture
from tests.results.samples import SORT

TABLE = np.full((480, 640, 3), 200, np.uint8)
CAPTION = slice(0, 24)


def image(shade: int, height: int = 224, width: int = 224) -> np.ndarray:
    return np.full((height, width, 3), shade, np.uint8)


def test_stage_and_time_stand_in_the_corner_and_nowhere_else() -> None:
    picture = Picture(SORT)
    drawn = [picture.draw(TABLE, number, stage) for number, stage in ((0, 0), (30, 0), (30, 2))]
    assert (TABLE == 200).all()
    for each in drawn:
        assert each.shape == TABLE.shape
        assert (each[CAPTION.stop :] == 200).all()
    assert not np.array_equal(drawn[0], drawn[1])
    assert not np.array_equal(drawn[1], drawn[2])
    assert np.array_equal(drawn[2], Picture(SORT).draw(TABLE, 30, 2))


def test_long_names_end_at_the_edge() -> None:
    drawn = Picture(SORT).draw(TABLE[:, :64], 0, 3)
    assert drawn.shape == (480, 64, 3)
    assert drawn[CAPTION, -4:].max() <= 200


@pytest.mark.parametrize(
    ("sizes", "width"),
    [
        ([(224, 224)] * 3, 640 + 160),
        ([(224, 224)] * 2, 640 + 240),
        ([(96, 128)], 640 + 320),
        ([(224, 224), (90, 160), (224, 224)], 640 + 284),
    ],
)
def test_images_of_the_policy_stand_beside_the_table(
    sizes: list[tuple[int, int]], width: int
) -> None:
    picture = Picture(SORT)
    picture.look(7, {f"camera_{nth}": image(40 + nth, *size) for nth, size in enumerate(sizes)})
    drawn = picture.draw(TABLE, 8, 0)
    assert drawn.shape == (480, width, 3)
    assert (drawn[CAPTION.stop :, :640] == 200).all()
    cell = 480 // max(2, len(sizes))
    for nth in range(len(sizes)):
        assert (drawn[(nth + 1) * cell - 4, 644] == 40 + nth).all()


def test_picture_says_when_the_policy_saw_it_only_if_it_did() -> None:
    columns = []
    for is_seen, number in ((True, 3), (True, 6), (False, 3), (False, 6)):
        picture = Picture(SORT, is_seen=is_seen)
        picture.look(number, {"head": image(40)})
        columns.append(picture.draw(TABLE, 9, 0)[:, 640:])
    assert not np.array_equal(columns[0], columns[1])
    assert np.array_equal(columns[2], columns[3])
