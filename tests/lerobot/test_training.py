"""`duobench train` runs LeRobot's training on an export, and what it saves plays."""

import json
import shutil
from pathlib import Path

import draccus
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import torch
from lerobot.configs.train import TrainPipelineConfig
from safetensors.torch import load_file

import duobench
from duobench.cli import main
from duobench.data.dataset import DataSet
from duobench.data.lerobot.export import export_lerobot
from duobench.data.lerobot.options import ExportOptions
from duobench.data.recorder import Recorder
from duobench.policy import make
from duobench.policy.training.recipes import RECIPES
from tests.lerobot import checkpoints
from tests.lerobot.checkpoints import CAMERAS, SIZE
from tests.lerobot.tools import HERE, NEEDS_GROOT, QUICK, TINY, record

TASKS = ("bin_sort", "transfer_cube")
LENGTH = 36
STEPS = 2


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An export of one episode of each task."""
    folder = tmp_path_factory.mktemp("data")
    demos = DataSet.open(folder / "demos")
    for task in TASKS:
        record(Recorder(duobench.make(task, cameras=(), horizon=LENGTH), demos))
    export_lerobot(demos, folder / "set", ExportOptions(cameras=CAMERAS, size=(SIZE, SIZE)))
    return folder / "set"


def train(*words: object) -> None:
    main(["train", *map(str, words)])


def test_a_small_act_trains_goes_on_and_plays(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    command = ["act", "--data", data, "--out", out, "--tasks", TASKS[0], "--small"]
    train(*command, "--steps", STEPS, "--", *TINY)
    last = out / "checkpoints/last/pretrained_model"
    settings = json.loads((last / "train_config.json").read_text())
    assert settings["policy"]["chunk_size"] == settings["policy"]["n_action_steps"] == 30
    assert settings["dataset"]["episodes"] == [0]
    saved = json.loads((last / "config.json").read_text())
    images = {f"observation.images.{camera}" for camera in CAMERAS}
    assert saved["input_features"].keys() == {"observation.state", *images}
    assert saved["output_features"].keys() == {"action"}
    weights = load_file(last / "model.safetensors").values()
    assert all(torch.isfinite(each).all() for each in weights)
    train(*command, "--steps", STEPS + 1)
    assert (out / f"checkpoints/{STEPS + 1:06d}").is_dir()
    monkeypatch.syspath_prepend(HERE)
    run = tmp_path / "run"
    play = ["eval", "--policy", f"lerobot:{last}?device=cpu", "--tasks", "swing_task:TASK"]
    main([*play, "--episodes", "1", "--workers", "0", "--videos", "0", "--out", str(run)])
    (record,) = run.rglob("records/*/*/*.json")
    assert json.loads(record.read_text())["steps"] == LENGTH


@pytest.mark.parametrize(
    ("kind", "tiny"), [("act", TINY), ("diffusion", (*QUICK, "--policy.down_dims=[32,64,128]"))]
)
def test_what_sees_objects_and_moves_tools_trains_and_loads(
    kind: str, tiny: tuple[str, ...], data: Path, tmp_path: Path
) -> None:
    demos, objects, out = data.with_name("demos"), tmp_path / "objects", tmp_path / "out"
    options = ExportOptions(tasks=TASKS[:1], cameras=(), object_state=True, action="cartesian")
    export_lerobot(DataSet.open(demos), objects, options, workers=0)
    train(kind, "--data", objects, "--out", out, "--steps", STEPS, "--", *tiny)
    shutil.rmtree(objects)  # what the actions are stands beside the checkpoint
    checkpoint = out / "checkpoints/last/pretrained_model"
    metadata = make(f"lerobot:{checkpoint}?device=cpu").metadata
    assert (metadata.cameras, metadata.object_state) == ((), True)
    assert metadata.action_mode == "cartesian"


def test_the_recipe_of_act_is_what_lerobot_trains_and_plays(data: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    words = ["act", "--data", data, "--out", out, "--tasks", TASKS[0], "--steps", STEPS]
    train(*words, "--", *TINY, "--policy.pretrained_backbone_weights=null")
    check_recipe("act", out)


@pytest.mark.parametrize("kind", [pytest.param("groot", marks=NEEDS_GROOT), "smolvla"])
def test_recipes_of_models_with_a_base_train_it_and_play(
    kind: str, data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # where GR00T finds its words
    if kind == "groot":  # it learns nothing from the last rows of an episode, a chunk less one
        base = checkpoints.groot_base(tmp_path / "base")
        options = [f"--policy.base_model_path={base}", "--policy.chunk_size=30"]
    else:  # with other names of cameras, as the published one
        seen = checkpoints.features(("camera1", "camera2"), width=6)
        options = [f"--policy.path={checkpoints.smolvla(tmp_path / 'base', **seen)}"]
    words = [kind, "--data", data, "--out", tmp_path / "out", "--steps", STEPS]
    train(*words, "--", *QUICK, *options)
    check_recipe(kind, tmp_path / "out")


def check_recipe(kind: str, out: Path) -> None:
    """What was trained has the settings of its recipe that no test changes, and loads."""
    last = out / "checkpoints/last/pretrained_model"
    trained = json.loads((last / "train_config.json").read_text())
    recipe = {setting.option: setting.value for setting in RECIPES[kind].settings}
    for name in ("chunk_size", "n_action_steps", "optimizer_lr"):
        if value := recipe.get(f"policy.{name}"):
            assert trained["policy"][name] == float(value)
    assert trained["seed"] == int(recipe.get("seed", 1000))
    metadata = make(f"lerobot:{last}?device=cpu").metadata
    assert (metadata.cameras, metadata.horizon) == (CAMERAS, 30)
    assert metadata.action_mode == "joint"


@pytest.mark.parametrize("kind", ["act", "groot", "pi05"])
def test_lerobot_knows_every_option_of_a_recipe(kind: str) -> None:
    given = (*RECIPES[kind].settings, RECIPES[kind].steps)
    options = [one.argument for one in given if not one.option.startswith("policy.pretrained_path")]
    parsed = draccus.parse(
        TrainPipelineConfig, args=["--dataset.repo_id=local/any", "--policy.device=cpu", *options]
    )
    assert (parsed.steps, parsed.policy.type) == (int(RECIPES[kind].steps.value), kind)
    assert parsed.policy.n_action_steps == 30


def say_real(data: Path, copy: Path, episode: int) -> Path:
    """A copy of a data set, one of whose episodes is from the real robot."""
    shutil.copytree(data, copy)
    shutil.rmtree(copy / "meta/duobench")  # which tells the size that each file had
    path = copy / f"data/chunk-000/file-{episode:03d}.parquet"
    table = pq.read_table(path)
    column = table.schema.get_field_index("domain")
    ones = pa.array([1] * len(table), pa.int64())
    pq.write_table(table.set_column(column, table.schema.field(column), ones), path)
    stats = copy / "meta/stats.json"
    content = json.loads(stats.read_text())
    content["domain"]["max"] = [1]
    stats.write_text(json.dumps(content))
    return copy


@pytest.mark.parametrize("learned", range(len(TASKS)))
def test_x_vla_learns_from_simulated_and_real_episodes_apart(
    data: Path, tmp_path: Path, learned: int
) -> None:
    base = checkpoints.xvla(tmp_path / "base", action_mode="ee6d", num_domains=2)
    mixed = say_real(data, tmp_path / "mixed", episode=1)
    words = ["xvla", "--data", mixed, "--out", tmp_path / "out", "--tasks", TASKS[learned]]
    model = (f"--policy.path={base}", "--policy.dtype=float32")
    train(*words, "--domain-ids", "--steps", STEPS, "--", *QUICK, *model)
    last = tmp_path / "out/checkpoints/last/pretrained_model"
    before, after = (load_file(folder / "model.safetensors") for folder in (base, last))
    (prompts,) = (name for name in before if name.endswith("soft_prompt_hub.weight"))
    changed = [not torch.equal(*pair) for pair in zip(before[prompts], after[prompts], strict=True)]
    assert changed == [learned == 0, learned == 1]
