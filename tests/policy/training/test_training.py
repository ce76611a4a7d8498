import json
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from duobench.cli import main
from duobench.core.errors import (
    DataError,
    DuoBenchError,
    PolicyError,
    UnknownNameError,
    UnknownNumbersError,
)
from duobench.core.lerobot_keys import FEATURE_NAMES
from duobench.core.randomness import SUITE_VERSION
from duobench.envs.action_labels import POSE_LABELS
from duobench.envs.spaces import JOINT_NAMES
from duobench.envs.state_labels import StatePart, names_of
from duobench.policy import lerobot_checkpoint as checkpoint
from duobench.policy.lerobot_checkpoint import labels_of
from duobench.policy.training import training
from duobench.policy.training.recipes import OBJECT_STATES, RECIPES, SMALL

TASKS = ("bin_sort", "ball_maze", "bin_sort")


def write(path: Path, content: object) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content))


def untouched(_data: Path) -> None:
    pass


def without_checkpoint(data: Path) -> None:
    data.with_name("out").mkdir()


def export(folder: Path, tasks: tuple[str, ...] = TASKS, domains: tuple[int, int] = (0, 0)) -> Path:
    """The JSON files of an export, which are all that is read here."""
    vectors = {key: {"shape": [16]} for key in ("observation.state", "action")}
    images = {"observation.images.head": {"shape": [96, 96, 3]}}
    features = {**vectors, **images, "domain": {"shape": [1]}}
    info = {"codebase_version": "v3.0", "fps": 30, "features": features}
    write(folder / "meta/info.json", info)
    write(
        folder / "meta/duobench.json",
        {"episodes": [{"file": f"episodes/{task}/0.parquet"} for task in tasks]},
    )
    low, high = domains
    write(folder / "meta/stats.json", {"domain": {"min": [low], "max": [high]}})
    return folder


Change = Callable[[Path], object]
"""Spoils an export."""


def with_info(**values: object) -> Change:
    def change(data: Path) -> None:
        path = data / "meta/info.json"
        write(path, json.loads(path.read_text()) | values)

    return change


def with_features(**features: object) -> Change:
    """Other features; two underscores stand for a dot."""

    def change(data: Path) -> None:
        before = json.loads((data / "meta/info.json").read_text())["features"]
        named = {name.replace("__", "."): feature for name, feature in features.items()}
        with_info(features=before | named)(data)

    return change


def without_images(data: Path) -> None:
    before = json.loads((data / "meta/info.json").read_text())["features"]
    with_info(features={key: before[key] for key in before if "images" not in key})(data)


def without(name: str) -> Change:
    return lambda data: (data / "meta" / name).unlink()


def with_content(name: str, content: object) -> Change:
    return lambda data: write(data / "meta" / name, content)


@pytest.fixture
def data(tmp_path: Path) -> Path:
    return export(tmp_path / "data")


@pytest.fixture
def one_task(tmp_path: Path) -> Path:
    return export(tmp_path / "data", TASKS[:1])


def plan(kind: str, data: Path, **options: Any) -> training.Training:
    (planned,) = training.plan_all(kind, data, data.with_name("out"), **options)
    return planned


def arguments(kind: str, data: Path, **options: Any) -> list[str]:
    return plan(kind, data, **options).command()


@pytest.mark.parametrize("kind", RECIPES)
def test_thirty_actions_are_executed(kind: str, one_task: Path) -> None:
    command = arguments(kind, one_task)
    assert command[0] == "lerobot-train"
    for argument in ("--policy.n_action_steps=30", "--policy.push_to_hub=false"):
        assert argument in command
    assert RECIPES[kind].steps.argument in command


@pytest.mark.parametrize("recipe", [*RECIPES.values(), *SMALL.values(), *OBJECT_STATES.values()])
def test_no_option_is_given_twice_and_each_says_whose_it_is(recipe: object) -> None:
    settings = recipe.settings  # pyright: ignore
    assert len({setting.option for setting in settings}) == len(settings)
    assert all(setting.why.startswith(("paper: ", "authors: ", "ours: ")) for setting in settings)


PUBLISHED = {
    "act": (150000, 64, "1e-5", 100),
    "pi05": (40000, 16, "2.5e-5", 50),
    "xvla": (40000, 48, "1e-4", 30),
}
"""Steps, batch, learning rate and chunk of the authors' checkpoints, as their cards say."""


@pytest.mark.parametrize("kind", PUBLISHED)
def test_the_authors_settings_are_taken_and_named_as_theirs(kind: str, one_task: Path) -> None:
    planned = plan(kind, one_task)
    steps, batch, rate, chunk = PUBLISHED[kind]
    theirs = {
        one.argument
        for one in planned.settings
        if one.why == "authors: as in their published checkpoint"
    }
    assert theirs == {
        f"--steps={steps}",
        f"--batch_size={batch}",
        f"--policy.optimizer_lr={rate}",
        f"--policy.chunk_size={chunk}",
        "--seed=1000",
    }
    assert not any("the paper does not say" in one.why for one in planned.settings)
    (given,) = (word for word in planned.command(["--seed=3"]) if "seed" in word)
    assert given == "--seed=3"


@pytest.mark.parametrize("recipes", [SMALL, OBJECT_STATES])
def test_recipes_for_a_processor_predict_what_is_executed(recipes: dict[str, Any]) -> None:
    arguments = [one.argument for one in recipes["act"].settings]
    assert "--policy.chunk_size=30" in arguments
    assert "--policy.n_action_steps=30" in arguments


@pytest.mark.parametrize("kind", OBJECT_STATES)
def test_object_states_without_images_have_recipes_of_their_own(kind: str, one_task: Path) -> None:
    without_images(one_task)
    with_features(observation__environment_state={"shape": [36]})(one_task)
    command = arguments(kind, one_task)
    assert {setting.argument for setting in OBJECT_STATES[kind].settings} <= set(command)
    with pytest.raises(UnknownNameError, match="recipe for object states 'pi06'"):
        arguments("pi06", one_task)
    with_features(observation__images__head={"shape": [96, 96, 3]})(one_task)
    if kind in RECIPES:
        assert RECIPES[kind].steps.argument in arguments(kind, one_task)
    else:
        with pytest.raises(DataError, match="states without images; "):
            arguments(kind, one_task)


def test_more_options_take_the_place_of_the_recipes(data: Path) -> None:
    command = plan("xvla", data).command(["--policy.path=mine", "--seed=3"])
    assert [word for word in command if "policy.path" in word] == ["--policy.path=mine"]
    assert command[-1] == "--seed=3"


def test_tasks_choose_their_episodes(data: Path) -> None:
    assert "--dataset.episodes=[0,2]" in arguments("act", data, tasks=["bin_sort"])
    assert not any("episodes" in word for word in arguments("pi05", data))


def test_simulated_and_real_episodes_are_told_apart_where_that_is_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = export(tmp_path / "mixed", TASKS[:1], domains=(0, 1))
    key = "--policy.domain_feature_key=domain"
    monkeypatch.setattr(training, "PLUGIN", "pytest")  # any distribution that is installed
    assert key not in arguments("xvla", data)  # as in the paper: an evaluation could not tell
    assert key in arguments("xvla", data, domain_ids=True)
    with pytest.raises(DataError, match="act learns from both"):
        arguments("act", data, domain_ids=True)
    with pytest.raises(DataError, match="one domain alone"):
        arguments("xvla", export(tmp_path / "one", domains=(1, 1)), domain_ids=True)
    monkeypatch.setattr(training, "PLUGIN", "not-installed")
    with pytest.raises(DuoBenchError, match="pip install"):
        arguments("xvla", data, domain_ids=True)


def test_a_training_goes_on_in_its_folder(data: Path) -> None:
    config = data.with_name("out") / "checkpoints/last/pretrained_model/train_config.json"
    dataset = {"root": str(data), "episodes": [0, 2]}
    write(config, {"policy": {"type": "act"}, "dataset": dataset})
    command = arguments("act", data, tasks=["bin_sort"], steps=9)
    assert command[1:] == [f"--config_path={config}", "--resume=true", "--steps=9"]
    with pytest.raises(DuoBenchError, match="policy: xvla, was act"):
        arguments("xvla", data)
    with pytest.raises(DuoBenchError, match=r"episodes: \[1\], was \[0, 2\]"):
        arguments("act", data, tasks=["ball_maze"])


def test_names_of_numbers_are_written_beside_every_checkpoint(one_task: Path) -> None:
    with_features(action={"shape": [20], "names": list(POSE_LABELS)})(one_task)
    out = one_task.with_name("out")
    planned = plan("act", one_task)
    folders = [out / f"checkpoints/{name}/pretrained_model" for name in ("000001", "last")]
    for folder in folders:
        folder.mkdir(parents=True)
    planned.name_features()
    for folder in folders:
        assert labels_of(folder, 20).mode.name == "cartesian"


LEROBOT_TRAIN = """#!{python}
# Stands in for lerobot-train: notes its options, and leaves what it leaves, but for the weights.
import json, sys
from pathlib import Path
options = dict(word[2:].split("=", 1) for word in sys.argv[1:])
with Path(r"{log}").open("a") as log:
    print(Path(options["output_dir"]).name, options["dataset.episodes"], file=log)
if options["dataset.episodes"] == "{breaks}":
    sys.exit(3)
state = Path(options["output_dir"], "checkpoints/last/training_state/training_step.json")
state.parent.mkdir(parents=True)
state.write_text(json.dumps({{"step": int(options["steps"])}}))
dataset = {{"root": options["dataset.root"], "episodes": json.loads(options["dataset.episodes"])}}
config = state.parents[1] / "pretrained_model/train_config.json"
config.parent.mkdir()
config.write_text(json.dumps({{"policy": {{"type": "act"}}, "dataset": dataset}}))
"""


def test_each_task_has_a_training_of_its_own_and_what_is_finished_stays(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out, log, program = (tmp_path / name for name in ("out", "log", "lerobot-train"))
    monkeypatch.setattr(training, "program", lambda: program)

    def train(*more: str, breaks: str = "") -> list[str]:
        program.write_text(LEROBOT_TRAIN.format(python=sys.executable, log=log, breaks=breaks))
        program.chmod(0o755)
        log.write_text("")
        options = ["--data", str(data), "--out", str(out), "--tasks", "all", "--steps", "9"]
        main(["train", "act", *options, *more])
        return log.read_text().splitlines()

    assert train("--print") == []
    assert capsys.readouterr().out.count("lerobot-train ") == 2
    with pytest.raises(SystemExit) as stopped:
        train(breaks="[1]")
    assert stopped.value.code == 3
    assert log.read_text().splitlines() == ["bin_sort [0,2]", "ball_maze [1]"]
    capsys.readouterr()
    assert train() == ["ball_maze [1]"]
    shown = capsys.readouterr().out
    assert f"# Finished: {out}/bin_sort/checkpoints/last/pretrained_model" in shown
    for task in ("bin_sort", "ball_maze"):
        assert f"--tasks {task} --episodes 100 --out {out}/{task}/evaluation" in shown
    assert train() == []
    planned = training.plan_all("act", data, out, tasks=["ball_maze", "bin_sort"], steps=10)
    assert [each.folder.name for each in planned] == ["ball_maze", "bin_sort"]
    assert not any(each.is_finished() for each in planned)
    assert all(each.is_finished(["--steps=8"]) for each in planned)


def test_an_export_of_a_data_set_for_each_task_is_trained_on_as_a_whole(tmp_path: Path) -> None:
    data, out, tasks = tmp_path / "data", tmp_path / "out", ["ball_maze", "bin_sort"]
    for task in tasks:
        export(data / task, (task,))
    for wanted, expected in ((["all"], tasks), ([], tasks), (["bin_sort"], ["bin_sort"])):
        planned = training.plan_all("act", data, out, tasks=wanted)
        assert [each.folder for each in planned] == [out / task for task in expected]
        assert [each.tasks for each in planned] == [(task,) for task in expected]
    with pytest.raises(DataError, match="export all tasks into one"):
        training.plan_all("pi05", data, out)
    with pytest.raises(UnknownNameError, match="Did you mean 'bin_sort'"):
        training.plan_all("act", data, out, tasks=["bin_srot"])


def test_all_tasks_are_one_training_for_a_policy_that_takes_an_instruction(data: Path) -> None:
    out = data.with_name("out")
    planned = plan("pi05", data, tasks=["all"])
    assert (planned.folder, planned.tasks) == (out, ("bin_sort", "ball_maze"))


def test_recordings_are_to_be_exported_first(tmp_path: Path) -> None:
    data = tmp_path / "demos"
    write(data / "dataset.json", {})
    with pytest.raises(SystemExit, match=f"duobench export lerobot {data} --out {data}-lerobot"):
        main(["train", "act", "--data", str(data), "--out", str(tmp_path / "out")])


@pytest.mark.parametrize("kind", RECIPES)
def test_policies_that_see_learn_from_images(kind: str, one_task: Path) -> None:
    without_images(one_task)
    with pytest.raises(DataError, match=f"{kind} learns from images, and .* has none: export"):
        arguments(kind, one_task)
    if kind not in OBJECT_STATES:
        with_features(observation__environment_state={"shape": [36]})(one_task)
        with pytest.raises(DataError, match=r"object states alone: export images, or .* act, dif"):
            arguments(kind, one_task)


POSES = {"shape": [16], "names": list(POSE_LABELS)}
MOTORS = {"shape": [16], "names": {"motors": ["a", "b"]}}


def state(*parts: StatePart, size: int | None = None) -> Change:
    """An export whose state holds some parts, and perhaps says another size."""
    names = list(names_of(parts))
    return with_features(observation__state={"shape": [size or len(names)], "names": names})


def test_a_state_with_tool_poses_is_learned_from_under_its_names(one_task: Path) -> None:
    state(StatePart.TCP_POSE)(one_task)
    planned = plan("act", one_task)
    assert planned.names["observation.state"] == list(names_of([StatePart.TCP_POSE]))
    planned.checkpoint.mkdir(parents=True)
    planned.name_features()
    shape = SimpleNamespace(shape=(30,))
    config = SimpleNamespace(robot_state_feature=shape)
    assert checkpoint.state_parts(planned.checkpoint, config) == (StatePart.TCP_POSE,)


@pytest.mark.parametrize(
    ("change", "tasks", "message"),
    [
        (untouched, "", "learns one task; name one of: bin_sort, ball_maze"),
        (untouched, "bin_srot", "Did you mean 'bin_sort'"),
        (without("info.json"), "", "no meta/info.json"),
        (without("duobench.json"), "bin_sort", "does not say which episodes"),
        (with_info(codebase_version="v2.1"), "", "format v2.1; v3.0 is needed"),
        (with_info(fps=15), "", "has 15 rows a second; 30 are needed"),
        (with_features(action={"shape": [14]}), "", r"action has shape \[14\]; \[16\] is needed"),
        (with_features(action=POSES), "", r"action has shape \[16\]; \[20\] is needed"),
        (
            with_features(action={"shape": [2], "names": ["x", "y"]}),
            "",
            "2 numbers, x, y; which no",
        ),
        (with_features(observation__state={"shape": [7]}), "", r"state has shape \[7\]"),
        (
            with_features(observation__state=MOTORS),
            "",
            "2 numbers, a, b; left_joint_1",
        ),
        (state(StatePart.JOINT_VELOCITY), "", "joint_velocity, which no environment shows"),
        (state(*StatePart), "", "joint_velocity, which no environment shows; export without it"),
        (state(StatePart.TCP_POSE, size=16), "", r"state has shape \[16\]; \[30\] is needed"),
        (with_content("info.json", []), "", "it holds a list, no object"),
        (with_info(features=None), "", "shape None"),
        (with_info(features={"action": []}), "", "shape None"),
        (with_content("duobench.json", {}), "bin_sort", "does not list episodes"),
        (with_content("duobench.json", {"episodes": [3]}), "", "does not list episodes"),
        (without_checkpoint, "bin_sort", "holds no checkpoint to go on from"),
    ],
)
def test_what_cannot_be_trained_on_is_rejected(
    data: Path, change: Change, tasks: str, message: str
) -> None:
    change(data)
    with pytest.raises(DuoBenchError, match=message):
        arguments("act", data, tasks=tasks.split())


def test_the_command_line_prints_the_command_and_the_reasons(
    one_task: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = one_task.with_name("out")
    options = f"--data {one_task} --out {out} --small --print -- --batch_size=2"
    main(["train", "act", *options.split()])
    command, reasons = capsys.readouterr()
    assert command.startswith("lerobot-train \\\n")
    assert command.rstrip().endswith("--batch_size=2")
    assert "paper: one ACT for each task" in reasons
    assert not out.exists()


def test_an_export_and_a_checkpoint_of_another_suite_are_refused(one_task: Path) -> None:
    path = one_task / "meta/duobench.json"
    about = json.loads(path.read_text())
    write(path, {**about, "suite_version": SUITE_VERSION})
    planned = plan("act", one_task)
    planned.checkpoint.mkdir(parents=True)
    planned.name_features()
    for name in ("config.json", "model.safetensors", *checkpoint.PROCESSORS):
        (planned.checkpoint / name).touch()
    assert checkpoint.find(str(planned.checkpoint)) == planned.checkpoint
    names = planned.checkpoint / FEATURE_NAMES
    assert json.loads(names.read_text())["suite_version"] == SUITE_VERSION
    write(names, {"suite_version": "4"})
    with pytest.raises(PolicyError, match=f"trained on suite 4; .* plays suite {SUITE_VERSION}"):
        checkpoint.find(str(planned.checkpoint))
    write(path, {**about, "suite_version": "4"})
    with pytest.raises(DataError, match=f"is of suite 4; this version has suite {SUITE_VERSION}"):
        plan("act", one_task)


# --- data sets of others -------------------------------------------------------------------------

THEIR_NAMES = [f"{arm}_{part}" for arm in "lr" for part in (*"0123456", "g")]
SPELLINGS = {
    "none": None,
    "a list": THEIR_NAMES,
    "under a heading": {"motors": [f"{name}.pos" for name in THEIR_NAMES]},
}
"""How the paper's authors may have named the 16 numbers, which is not known."""


def theirs(folder: Path, names: object, **features: Any) -> Path:
    """The description of a data set in the form of the paper's authors."""
    video = {"dtype": "video", "shape": [224, 224, 3], "names": ["height", "width", "channels"]}
    numbers = {"dtype": "float32", "shape": [16], "names": names}
    cameras = ("head", "left_wrist", "right_wrist")
    known = {f"observation.images.{camera}": video for camera in cameras}
    known |= {"observation.state": numbers, "action": numbers}
    named = {name.replace("__", "."): feature for name, feature in features.items()}
    info = {
        "codebase_version": "v3.0",
        "fps": 30,
        "total_episodes": 50,
        "total_frames": 26000,
        "robot_type": "fr3_duo",
        "features": known | named,
    }
    write(folder / "meta/info.json", info)
    return folder


@pytest.mark.parametrize("assume", [None, "joint"])
@pytest.mark.parametrize("spelling", SPELLINGS)
def test_the_authors_data_are_learned_from_and_what_is_assumed_is_said(
    tmp_path: Path, spelling: str, assume: str | None
) -> None:
    data = theirs(tmp_path / "theirs", SPELLINGS[spelling])
    if assume is None and spelling != "none":
        with pytest.raises(UnknownNumbersError, match=r"16 numbers, l_0, l_1, l_2, …; which no"):
            plan("act", data)
        return
    planned = plan("act", data, assume=assume)
    said = " ".join(planned.notes)
    for key in ("action", "observation.state"):
        assert f"Assumed: {key}, which has " in said
        assert planned.names[key] == list(JOINT_NAMES)
    assert "left_joint_1 to right_gripper" in said
    assert ("names of its own (l_0, …)" in said) == (spelling != "none")
    planned.checkpoint.mkdir(parents=True)
    planned.name_features()
    assert labels_of(planned.checkpoint, 16).mode.name == "joint"


def test_an_assumed_mode_must_have_as_many_numbers(tmp_path: Path) -> None:
    data = theirs(tmp_path / "theirs", THEIR_NAMES)
    with pytest.raises(DataError, match=r"action has shape \[16\]; \[20\] is needed"):
        plan("act", data, assume="cartesian")
    with pytest.raises(UnknownNameError, match="action mode of an export 'joints'"):
        plan("act", data, assume="joints")


@pytest.mark.parametrize("kind", ["act", "xvla"])
def test_what_no_policy_sees_here_is_left_out_with_a_sentence(tmp_path: Path, kind: str) -> None:
    other = {"dtype": "float32", "shape": [20], "names": None}
    top = {"dtype": "video", "shape": [96, 96, 3], "names": ["height", "width", "channels"]}
    more = {"observation__state_eef": other, "action_eef": other, "observation__images__top": top}
    planned = plan(kind, theirs(tmp_path / "theirs", None, **more))
    (sentence,) = (note for note in planned.notes if "eft out" in note)
    assert "observation.state_eef, observation.images.top" in sentence
    (chosen,) = (one for one in planned.settings if one.option == "policy.input_features")
    inputs = json.loads(chosen.value)
    assert inputs["observation.state"] == {"type": "STATE", "shape": [16]}
    assert inputs["observation.images.head"] == {"type": "VISUAL", "shape": [3, 224, 224]}
    assert len(inputs) == 4
    hidden = theirs(tmp_path / "hidden", None, **more)
    about = json.loads((hidden / "meta/info.json").read_text())
    for key in (key for key in inputs if "images" in key):
        del about["features"][key]
    write(hidden / "meta/info.json", about)
    with pytest.raises(DataError, match="has none: export it with cameras"):
        plan(kind, hidden)


def test_simulated_episodes_are_found_where_the_authors_publish_them(tmp_path: Path) -> None:
    data, out = tmp_path / "duobench", tmp_path / "out"
    for task in ("ball_maze", "bin_sort"):
        for domain in ("sim", "real"):
            theirs(data / task / domain, None)
    planned = training.plan_all("act", data, out)
    assert [each.tasks for each in planned] == [("ball_maze",), ("bin_sort",)]
    assert f"--dataset.root={data}/bin_sort/sim" in planned[1].command()
    (one,) = training.plan_all("act", data, out, tasks=["bin_sort"])
    assert one.folder == out / "bin_sort"
    for tasks in ((), ("bin_sort",)):
        (alone,) = training.plan_all("act", data / "bin_sort", out, tasks=tasks)
        assert (alone.tasks, alone.folder) == (("bin_sort",), out)
        assert f"--dataset.root={data}/bin_sort/sim" in alone.command()
    with pytest.raises(DataError, match="or merge them with lerobot-edit-dataset"):
        training.plan_all("xvla", data, out)


def test_the_command_line_says_what_to_assume_and_what_was(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = theirs(tmp_path / "theirs", THEIR_NAMES)
    words = ["train", "act", "--data", str(data), "--out", str(tmp_path / "out"), "--print"]
    with pytest.raises(SystemExit, match="--assume joint"):
        main(words)
    main([*words, "--assume", "joint"])
    assert "Assumed: action, which has names of its own (l_0, …)" in capsys.readouterr().err


def test_an_export_that_ends_at_success_says_so(one_task: Path) -> None:
    path = one_task / "meta/duobench.json"
    about = json.loads(path.read_text())
    for after_success in (False, True):
        write(path, {**about, "options": {"after_success": after_success}})
        said = " ".join(plan("act", one_task).notes)
        assert ("Its episodes end at success" in said) == (not after_success)
