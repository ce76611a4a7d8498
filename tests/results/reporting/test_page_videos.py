from fractions import Fraction
from pathlib import Path

import numpy as np
from PIL import Image

from duobench.results.metrics import task_result
from duobench.results.reporting.videos import PageVideos
from duobench.video import VP9, write_video
from tests.results.samples import SORT, sample_folder, sample_record, sample_run

SHADES = [np.full((48, 64, 3), shade, np.uint8) for shade in range(0, 250, 2)]


def test_poster_is_the_last_frame_and_goes_with_its_episode(tmp_path: Path) -> None:
    record = sample_record(SORT, 0, (5,))
    run = sample_run()
    folder = sample_folder(tmp_path, run, [record])
    videos = PageVideos(folder, run)
    assert videos.video(record) is None
    path = folder.video(SORT.id, 0)
    path.parent.mkdir(parents=True)
    write_video(SHADES, path, VP9, Fraction(15))
    assert videos.poster(record) == "videos/sort/00000.jpg"
    with Image.open(folder.poster(SORT.id, 0)) as poster:
        assert poster.size == (64, 48)
        assert abs(int(np.asarray(poster).mean()) - 248) < 8
    folder.discard(record)
    assert not list(tmp_path.glob("videos/*/*"))


def test_what_is_no_video_has_no_poster(tmp_path: Path) -> None:
    record = sample_record(SORT, 0, (5,))
    run = sample_run()
    folder = sample_folder(tmp_path, run, [record])
    path = folder.video(SORT.id, 0)
    path.parent.mkdir(parents=True)
    path.write_bytes(b"video")
    assert PageVideos(folder, run).poster(record) is None


def test_one_video_is_shown_for_each_last_stage(tmp_path: Path) -> None:
    reached = ((), (5,), (5,), (1, 2, 3), ())
    records = [sample_record(SORT, episode, each) for episode, each in enumerate(reached)]
    run = sample_run()
    folder = sample_folder(tmp_path, run, records)
    for episode in (1, 2, 3, 4):
        path = folder.video(SORT.id, episode)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"video")
    featured = PageVideos(folder, run).featured(task_result(SORT, records))
    assert [record.episode for record in featured] == [4, 1, 3]
