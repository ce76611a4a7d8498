from collections.abc import Container
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
from PIL import Image

from duobench import Camera
from duobench.core.codecs import VP9
from duobench.core.video import write_video
from duobench.envs.config import EnvConfig
from duobench.policy import Batching, PolicyMetadata
from duobench.results.folder import RunFolder
from duobench.results.pages import PageVideos, identity, stacks
from duobench.results.records import Record
from duobench.results.run import Run
from duobench.results.scores import RunPart, group_by_condition, task_result
from tests.results.samples import SORT, TURN, sample_folder, sample_record, sample_run


def part_of(run: Run) -> RunPart:
    (part,) = group_by_condition(run, [])
    return part


def test_a_run_is_told_by_everything_that_was_chosen() -> None:
    run = sample_run(
        tasks=(SORT, TURN),
        first_episode=3,
        look="dark",
        metadata=PolicyMetadata(
            name="net", version="7", horizon=30, object_state=True, dtype="float16", device="cuda"
        ),
        config=EnvConfig(
            cameras=("head",), image_size=(96, 128), object_state=True, action_mode="cartesian"
        ),
        batching=Batching(mode="dynamic", size=4),
    )
    facts = identity(part_of(run))
    assert "privileged" in facts["Other observations"]
    assert (
        facts.items()
        >= {
            "Policy": "mine (net)",
            "Its version": "7",
            "Tasks": "sort, turn",
            "Episodes": "numbers 3–6, 4 of each task",
            "Look": "dark",
            "Cameras": "head, 128 × 96 pixels",
            "Action mode": "cartesian",
            "Chunk": "30 actions",
            "Inference": "float16, cuda, dynamic batches of 4",
        }.items()
    )


def test_sizes_are_told_of_each_camera_that_is_seen_in_any_way() -> None:
    side = Camera(name="side", position=(0.5, 1.2, 0.6), look_at=(0.5, 0, 0), size=(48, 64))
    options = {"cameras": {"head": (16, 24), side: None}, "depth": ("head", "left_wrist")}
    config = EnvConfig.from_options({**options, "image_size": 32})
    facts = identity(part_of(sample_run(config=config)))
    assert facts["Cameras"] == (
        "head, 24 × 16 pixels; side, 64 × 48 pixels; left_wrist, 32 × 32 pixels"
    )


def test_what_is_not_known_is_said() -> None:
    facts = identity(part_of(sample_run(metadata=PolicyMetadata(name="mine"))))
    known = {"Its version": "not known", "Inference": "not known", "Cameras": "none"}
    assert facts.items() >= {**known, "Chunk": "of varying or unknown length"}.items()


def test_machines_and_software_are_told_once_each() -> None:
    here = {"platform": "Linux", "processor": "Best 9", "renderer": None, "numpy": "2", "mink": ""}
    record = sample_record(TURN, 0, (3,), versions=here)
    other = replace(record, episode=2, versions={**here, "renderer": "NVIDIA H100"})
    slow = replace(record, episode=3, versions={**here, "renderer": "llvmpipe (LLVM 15)"})
    *stacked, by_processor = stacks([record, replace(record, episode=1), other, slow])
    assert by_processor["Renderer"] == (
        "llvmpipe (LLVM 15): no graphics card rendered the images, so they took longer"
    )
    assert stacked == [
        {
            "Platform": "Linux",
            "Processor": "Best 9",
            "Renderer": "none: no images for the policy",
            "Software": "numpy 2",
        },
        {
            "Platform": "Linux",
            "Processor": "Best 9",
            "Renderer": "NVIDIA H100",
            "Software": "numpy 2",
        },
    ]


def test_software_with_another_engine_is_marked() -> None:
    record = sample_record(TURN, 0, (3,), versions={"mujoco": "4.1.0"})
    (facts,) = stacks([record])
    assert facts["Software"] == "mujoco 4.1.0 (MuJoCo 4.1.0 instead of 4.0)"


SHADES = [np.full((48, 64, 3), shade, np.uint8) for shade in range(0, 250, 2)]


def videos_of(
    path: Path, records: list[Record], *, without: Container[int] = ()
) -> tuple[RunFolder, PageVideos]:
    """The folder of a run with what is no video beside its records, and what finds videos in it."""
    run = sample_run()
    folder = sample_folder(path, run, records)
    for record in records:
        video = folder.video(record.key)
        video.parent.mkdir(parents=True, exist_ok=True)
        if record.episode not in without:
            video.write_bytes(b"video")
    return folder, PageVideos(folder, run, folder.path, False)


def test_poster_is_the_last_frame_and_goes_with_its_episode(tmp_path: Path) -> None:
    record = sample_record(SORT, 0, (5,))
    folder, videos = videos_of(tmp_path, [record], without=[0])
    assert videos.video(record) is None
    write_video(SHADES, folder.video(record.key), VP9, Fraction(15))
    assert videos.poster(record) == "videos/sort/mine.sim.none.default/00000.jpg"
    with Image.open(folder.poster(record.key)) as poster:
        assert poster.size == (64, 48)
        assert abs(int(np.asarray(poster).mean()) - 248) < 8
    folder.discard(record.key)
    assert not list(tmp_path.glob("videos/*/*/*"))


def test_one_video_is_shown_for_each_last_stage_and_what_is_none_has_no_poster(
    tmp_path: Path,
) -> None:
    reached = ((), (5,), (5,), (1, 2, 3), ())
    records = [sample_record(SORT, episode, each) for episode, each in enumerate(reached)]
    _, videos = videos_of(tmp_path, records, without=[0])
    shown = videos.featured(task_result(SORT, records))
    assert [record.episode for record in shown] == [4, 1, 3]
    assert videos.poster(records[1]) is None
