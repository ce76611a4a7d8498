"""The three trainings of the paper: on simulated episodes, on real ones, and on both.

The real ones are from simulated drivers in place of a robot. Runs in an environment with LeRobot,
which `make test-lerobot` makes.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import duobench
from duobench.cli import main
from duobench.data import Actor, DataSet, Recorder
from duobench.data.rig import RigRecorder
from duobench.real.env import make_real_env
from tests.lerobot.tools import TINY, load, record
from tests.real.rigs import new_rig
from tests.real.simulated import MARK, MARKS

TASK = "bin_sort"
LENGTH = 34
STEPS = 2


@pytest.fixture(scope="module")
def sets(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated and a real episode, exported apart and together, as the page lerobot says."""
    folder = tmp_path_factory.mktemp("data")
    record(Recorder(duobench.make(TASK, cameras=(), horizon=LENGTH), folder / "sim-demos"))
    duo = new_rig()
    real = make_real_env(duo, TASK, cameras=(), horizon=LENGTH)
    duo.supervisor.confirm()
    rig = RigRecorder(duo, waits=True)
    record(Recorder(real, folder / "real-demos", Actor(name="sine"), rig=rig))
    for name, sources in (("sim", ["sim"]), ("real", ["real"]), ("mixed", ["sim", "real"])):
        folders = [str(folder / f"{source}-demos") for source in sources]
        words = ["--cameras", "head", "--size", "64", "64"]
        main(["export", "lerobot", *folders, "--out", str(folder / name), *words])
    return folder


def test_both_domains_are_in_one_data_set(sets: Path) -> None:
    dataset = load(sets / "mixed")
    assert (dataset.num_episodes, dataset.num_frames) == (2, 2 * LENGTH)
    assert [int(dataset[row]["domain"]) for row in (0, LENGTH - 1, LENGTH)] == [0, 0, 1]
    stats = json.loads((sets / "mixed/meta/stats.json").read_text())
    assert (stats["domain"]["min"], stats["domain"]["max"]) == ([0], [1])
    assert json.loads((sets / "mixed/meta/duobench.json").read_text())["domains"] == ["sim", "real"]


def number_of(image: np.ndarray) -> int:
    """The number that a simulated camera wrote into an image of native size, encoded or not."""
    middles = image[MARK // 2, MARK // 2 : MARKS * MARK : MARK]
    return int((middles.sum(axis=-1) > 3 * 127) @ (1 << np.arange(MARKS)))


def test_real_images_are_those_of_the_rows(sets: Path) -> None:
    (recording,) = DataSet(sets / "real-demos").recordings()
    words = ["--cameras", "head", "--size", "720", "1280"]
    native = sets / "native"
    main(["export", "lerobot", str(sets / "real-demos"), "--out", str(native), *words])
    dataset = load(native)
    for row in range(0, LENGTH, 5):
        image = dataset[row]["observation.images.head"].permute(1, 2, 0).numpy()
        assert number_of((255 * image).astype(np.uint8)) == recording.frame_number[row, 0]


@pytest.mark.parametrize("domain", ["sim", "real", "mixed"])
def test_a_policy_trains_on_it(domain: str, sets: Path, tmp_path: Path) -> None:
    words = ["train", "act", "--data", str(sets / domain), "--out", str(tmp_path / domain)]
    main([*words, "--small", "--steps", str(STEPS), "--", *TINY])
    last = tmp_path / domain / "checkpoints/last/pretrained_model"
    assert (last / "model.safetensors").exists()
    settings = json.loads((last / "train_config.json").read_text())
    assert settings["dataset"]["episodes"] is None
    assert "domain" not in settings["policy"]["input_features"]
