"""Depth and places of cameras in exports: their codes, their columns, what is said about them."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import av
import numpy as np
import pyarrow.parquet as pq
import pytest

from duobench.cli import main
from duobench.core.errors import DataError, DuoBenchError, OtherRunError, UnknownNameError
from duobench.data import DataSet, ImageSource
from duobench.data.card import write_data_card
from duobench.data.lerobot.depth import encoded, metres
from duobench.data.lerobot.export import export_lerobot
from duobench.data.lerobot.folder import ExportFolder
from duobench.data.lerobot.options import PER_EPISODE, ExportOptions, Format
from duobench.world.robot.cameras import FARTHEST, Camera
from tests.data.tools import TASK

SIDE = Camera(name="side", position=(0.5, 1.2, 0.5), look_at=(0.5, 0.0, 0.0), size=(16, 32))
OPTIONS = ExportOptions(cameras=("left_wrist", SIDE), depth=True, size=(32, 48))
POSE = "table_from_camera.left_wrist"


@pytest.fixture(scope="module")
def exported(original: DataSet, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("export") / "depth"
    export_lerobot(original, out, OPTIONS, workers=0)
    return out


def codes(path: Path) -> list[np.ndarray]:
    with av.open(path) as container:
        return [frame.to_ndarray(format="gray12le") for frame in container.decode(video=0)]


def test_a_code_is_the_nearest_and_none_stays_none() -> None:
    depth = np.linspace(0.014, FARTHEST, 200_001, dtype=np.float32)
    found = metres()[encoded(depth)]
    assert (np.abs(found - depth) <= 0.5001 * 0.00051 * (1.0 + depth)).all()
    assert encoded(np.zeros(1, np.float32)) == 0
    assert metres()[0] == 0.0
    np.testing.assert_array_equal(encoded(metres().astype(np.float32)), np.arange(4096))


def test_videos_hold_the_codes_of_what_is_rendered(original: DataSet, exported: Path) -> None:
    recording, folder = next(original.recordings()), ExportFolder(exported)
    source = ImageSource(TASK, cameras=("left_wrist", SIDE), size=(32, 48), depth=True)
    videos = {name: codes(folder.video(f"{name}_depth", 0)) for name in ("left_wrist", "side")}
    poses = pq.read_table(folder.data(0)).column(POSE).to_pylist()
    for row in range(0, len(recording), 7):
        seen = source.images_by_kind(recording, row)["depth"]
        for name, video in videos.items():
            np.testing.assert_array_equal(video[row], encoded(seen[name]))
        placed = source.geometry(recording, row)["left_wrist"].table_from_camera
        np.testing.assert_array_equal(np.float32(poses[row]), placed.ravel().astype(np.float32))
    source.close()
    assert [video[0].shape for video in videos.values()] == [(32, 48), (16, 32)]


def test_features_say_how_numbers_are_read_and_where_cameras_are(
    original: DataSet, exported: Path
) -> None:
    features = json.loads((exported / "meta/info.json").read_text())["features"]
    source = ImageSource(TASK, cameras=("left_wrist", SIDE), size=(32, 48))
    placed = source.geometry(next(original.recordings()), 0)
    for end in ("", "_depth"):
        wrist, side = (
            features[f"observation.images.{name}{end}"]["info"] for name in ("left_wrist", "side")
        )
        assert wrist["is_depth_map"] is (end != "")
        np.testing.assert_array_equal(side["matrix"], placed["side"].matrix)
        np.testing.assert_array_equal(side["table_from_camera"], placed["side"].table_from_camera)
        np.testing.assert_array_equal(wrist["matrix"], placed["left_wrist"].matrix)
        assert wrist["table_from_camera"] == POSE
    assert features[POSE]["shape"] == [16]
    depth = features["observation.images.side_depth"]
    assert depth["shape"] == [16, 32, 1]
    assert depth["info"]["depth_unit"] == "m"
    stats = json.loads((exported / "meta/stats.json").read_text())["observation.images.side_depth"]
    folder = ExportFolder(exported)
    every = metres()[[codes(folder.video("side_depth", index)) for index in range(3)]]
    for name, expected in (
        ("min", every.min()),
        ("max", every.max()),
        ("mean", every.mean()),
        ("std", every.std()),
        ("q90", np.quantile(every, 0.9)),
    ):
        np.testing.assert_allclose(np.array(stats[name]), [[[expected]]], rtol=1e-9, err_msg=name)


def test_colours_are_those_of_an_export_without_depth(
    original: DataSet, exported: Path, tmp_path: Path
) -> None:
    options = replace(OPTIONS, depth=False, geometry=False, cameras=("left_wrist",))
    export_lerobot(original, tmp_path / "plain", options, workers=0)
    plain, deep = ExportFolder(tmp_path / "plain"), ExportFolder(exported)
    assert plain.video("left_wrist", 1).read_bytes() == deep.video("left_wrist", 1).read_bytes()
    assert POSE not in pq.read_schema(plain.data(1)).names


def test_an_export_goes_on_as_it_began_and_not_otherwise(
    original: DataSet, exported: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lost = ExportFolder(exported).video("side_depth", 2)
    before = lost.read_bytes()
    lost.unlink()
    side = json.dumps({"name": "side", "position": [0.5, 1.2, 0.5], "look_at": [0.5, 0, 0]})
    words = ["export", "lerobot", str(original.path), "--out", str(exported), "--workers", "0"]
    words += ["--size", "32", "48", "--depth"]
    main([*words, "--cameras", "left_wrist", side.replace("}", ', "size": [16, 32]}')])
    assert lost.read_bytes() == before
    assert "3 episodes" in capsys.readouterr().out
    with pytest.raises(OtherRunError, match="depth left_wrist instead of left_wrist side"):
        export_lerobot(original, exported, replace(OPTIONS, depth="left_wrist"), workers=0)
    with pytest.raises(SystemExit, match="cameras"):
        main([*words, "--cameras", "left_wrist", side])


def test_depth_alone_has_no_images_of_colour(original: DataSet, tmp_path: Path) -> None:
    options = ExportOptions(cameras=(), depth=True, size=(16, 16), look=PER_EPISODE)
    assert options.depth == ("head", "left_wrist", "right_wrist")
    assert not options.geometry
    export_lerobot(original, tmp_path / "out", replace(options, depth="head"), workers=0)
    features = json.loads((tmp_path / "out/meta/info.json").read_text())["features"]
    assert [key for key in features if "images" in key] == ["observation.images.head_depth"]
    card = write_data_card(tmp_path / "out", "me/depth", "mit").read_text()
    assert "Depth maps (`observation.images.head_depth`)" in card
    assert "duobench train" not in card


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"format": Format.V21}, DataError, "Depth maps need format v3.0"),
        ({"size": (8, 16)}, DataError, "even numbers from 16 on, got 8x16"),
        ({"depth": "side"}, UnknownNameError, "'side'"),
        ({"depth": {"head"}}, DuoBenchError, "depth is True, False, the name"),
        ({"look": PER_EPISODE, "geometry": True}, DataError, "one look for all episodes"),
        ({"cameras": ("head", replace(SIDE, size=(15, 32)))}, DataError, "even numbers"),
        ({"cameras": ("head", replace(SIDE, name="head_depth"))}, DataError, "'head_depth'"),
    ],
)
def test_what_cannot_be_exported_is_said(options: dict[str, Any], error: type, words: str) -> None:
    with pytest.raises(error, match=words):
        ExportOptions(**{"depth": True, **options})


def test_what_real_arms_did_not_record_is_said(real: DataSet, tmp_path: Path) -> None:
    for options in ({"depth": True}, {"geometry": True}):
        with pytest.raises(DataError, match="recorded on real arms, as videos alone"):
            export_lerobot(real, tmp_path / "out", ExportOptions(**options), workers=0)
    with pytest.raises(DataError, match="no video of the camera side"):
        export_lerobot(real, tmp_path / "out", ExportOptions(cameras=(SIDE,)), workers=0)
