"""LeRobot's programs play our episodes: the same ones, with the same outcome."""

import json
import sys
from pathlib import Path

import pytest
from lerobot.configs import FeatureType, PolicyFeature

from duobench.cli import main
from duobench.core.lerobot_keys import FEATURE_NAMES
from duobench.core.randomness import episode_seed
from duobench.envs.action_labels import POSE_LABELS
from duobench.envs.config import EnvConfig
from duobench.envs.state_labels import StatePart, names_of
from duobench.tasks import catalog
from tests.lerobot import checkpoints
from tests.lerobot.checkpoints import CAMERAS, SIZE
from tests.lerobot.tools import HERE, run as run_program

TASK = "swing_task:TASK"
EPISODES = 4


EVALUATION = """
import sys
from lerobot.robots import RobotConfig
from lerobot.scripts import lerobot_eval
from lerobot.teleoperators import TeleoperatorConfig
from lerobot.utils.import_utils import register_third_party_plugins

register_third_party_plugins()
from lerobot.envs import EnvConfig

assert "duobench" in EnvConfig.get_known_choices()
assert "duobench" in TeleoperatorConfig.get_known_choices()
assert {"duobench", "duobench_duo"} <= set(RobotConfig.get_known_choices())
devices = ("duobench.real", "duobench.web", "duobench.teleop", "franky", "pymodbus")
print([name for name in devices if name in sys.modules])
"""


def test_one_distribution_registers_all_and_an_evaluation_loads_no_drivers() -> None:
    assert run_program([sys.executable, "-c", EVALUATION]).splitlines()[-1] == "[]"


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return checkpoints.act(tmp_path_factory.mktemp("checkpoint") / "act")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory, checkpoint: Path) -> Path:
    """The folder of an evaluation by our runner."""
    return played(checkpoint, tmp_path_factory.mktemp("runs") / "run")


def played(checkpoint: Path, out: Path) -> Path:
    command = f"eval --tasks {TASK} --episodes {EPISODES} --workers 0 --videos 0".split()
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(HERE)
        main([*command, "--policy", f"lerobot:{checkpoint}?device=cpu", "--out", str(out)])
    return out


def evaluate(checkpoint: Path, out: Path, *options: str) -> dict:
    """What `lerobot-eval` finds out."""
    command = [
        "lerobot-eval",
        f"--policy.path={checkpoint}",
        "--policy.device=cpu",
        "--env.type=duobench",
        f"--env.task={TASK}",
        f"--env.cameras=[{','.join(CAMERAS)}]",
        f"--env.image_size={SIZE}",
        f"--eval.n_episodes={EPISODES}",
        "--seed=0",
        f"--output_dir={out}",
        *options,
    ]
    run_program(command, PYTHONPATH=str(HERE))
    return json.loads((out / "eval_info.json").read_text())


@pytest.mark.parametrize("batch", [1, 2])
def test_lerobot_eval_finds_what_our_runner_finds(
    run: Path, checkpoint: Path, tmp_path: Path, batch: int
) -> None:
    found = evaluate(checkpoint, tmp_path / "out", f"--eval.batch_size={batch}")
    check_same(found, run)


@pytest.mark.parametrize("batch", [1, 2])
def test_lerobot_eval_plays_tool_poses_and_object_states(tmp_path: Path, batch: int) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(HERE)
        numbers = len(catalog.get(TASK).object_state.names)
    state = names_of([StatePart.TCP_POSE])
    seen = {
        "observation.state": PolicyFeature(FeatureType.STATE, (len(state),)),
        "observation.environment_state": PolicyFeature(FeatureType.ENV, (numbers,)),
    }
    told = {"action": PolicyFeature(FeatureType.ACTION, (len(POSE_LABELS),))}
    folder = checkpoints.act(tmp_path / "act", input_features=seen, output_features=told)
    names = {"action": POSE_LABELS, "observation.state": state}
    (folder / FEATURE_NAMES).write_text(json.dumps(names))
    options = ("--env.action=cartesian", "--env.state=[tcp_pose]", "--env.object_state=true")
    several = ("--env.cameras=[]", f"--eval.batch_size={batch}")
    found = evaluate(folder, tmp_path / "out", *options, *several)
    check_same(found, played(folder, tmp_path / "run"))


def test_environments_have_the_gripper_that_is_asked_for() -> None:
    from lerobot_env_duobench import DuoBenchEnv

    asked = {"gripper": "franka_hand", "mount": "wide"}
    options = DuoBenchEnv(task="bin_sort", cameras=(), **asked).gym_kwargs
    assert EnvConfig.from_options(options).other_robot == "franka_hand wide"


def check_same(found: dict, run: Path) -> None:
    """LeRobot's program found what our runner did."""
    records = [json.loads(path.read_text()) for path in sorted(run.rglob("records/*/*/*.json"))]
    assert [record["seed"] for record in records] == [
        episode_seed("swing", number) for number in range(EPISODES)
    ]
    (task,) = found["per_task"]
    assert task["task_group"] == "swing"
    successes = [record["success"] for record in records]
    progress = [record["final_stage"] / record["max_stage"] for record in records]
    assert len(set(successes)) == 2, "the episodes should differ"
    assert task["metrics"]["successes"] == successes
    assert task["metrics"]["max_rewards"] == pytest.approx(progress)
    summary = json.loads((run / "summary.json").read_text())["tasks"]["swing"]
    overall = found["overall"]
    assert overall["pc_success"] == pytest.approx(100 * summary["success_rate"])
    assert overall["avg_max_reward"] == pytest.approx(summary["mean_final_progress"])


def test_actions_in_bfloat16_are_executed_too(checkpoint: Path, tmp_path: Path) -> None:
    found = evaluate(checkpoint, tmp_path / "out", "--eval.batch_size=2", "--policy.use_amp=true")
    assert len(found["per_task"][0]["metrics"]["successes"]) == EPISODES
