"""The baselines on object states: recorded, exported and played as a reader would."""

import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from itertools import permutations
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import duobench
from duobench.core.errors import (
    DataError,
    EvaluationError,
    OtherRunError,
    PolicyError,
    UnknownNameError,
)
from duobench.data import DataSet, Recording
from duobench.evaluation.rollouts import rollout
from duobench.results.folder import RunFolder
from duobench.results.scores import wilson_interval
from duobench.results.suite import Suite
from duobench.tasks import catalog
from duobench.world.robot.cameras import POLICY_CAMERAS
from duobench.world.robot.frames import robot_with
from duobench.world.robot.gripper import GRIPPERS
from duobench.world.sim.backend import SimBackend
from tests.docs.markdown import ROOT

EXAMPLES = ROOT / "examples" / "object_states"
TASK = "carry_pot"
EXPORT = ("--per-task", "--after-success", "--cameras", "none", "--object-state")
EXPORT += ("--action", "cartesian")


def run(*words: str, folder: Path) -> str:
    program = str(Path(sys.executable).with_name("duobench"))
    done = subprocess.run(
        [program, *words], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def exports(tmp_path_factory: pytest.TempPathFactory, demonstrations: Callable[..., Path]) -> Path:
    folder = tmp_path_factory.mktemp("baselines")
    (folder / "demos").symlink_to(demonstrations(TASK, episodes=2))
    run("export", "lerobot", "demos", "--out", "exports", *EXPORT, folder=folder)
    return folder / "exports"


@pytest.fixture
def example(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(EXAMPLES))


@pytest.fixture
def checkpoint(monkeypatch: pytest.MonkeyPatch, exports: Path) -> None:
    """Demonstrations that are played, where nothing else is."""
    monkeypatch.setenv("CHECKPOINT", str(exports / TASK))


@pytest.mark.long
@pytest.mark.usefixtures("example", "checkpoint")
def test_nearest_state_does_again_what_was_shown(exports: Path) -> None:
    from nearest import Nearest  # pyright: ignore[reportMissingImports]

    env = duobench.make(
        TASK, cameras=False, object_state=True, action_mode="cartesian", split="train"
    )
    policy = Nearest()
    for path in DataSet.open(exports.with_name("demos")).episodes():
        rollout(env, policy, seed=Recording.read_info(path).seed or 0)
        assert env.get_wrapper_attr("judge").stage == 3


@pytest.mark.long
@pytest.mark.usefixtures("example", "checkpoint")
def test_nearest_state_is_evaluated_as_a_privileged_policy(exports: Path) -> None:
    for name in ("nearest.py", "demonstrations.py", "frames.py"):
        (exports / name).write_text((EXAMPLES / name).read_text())
    words = ("--policy", "nearest:Nearest", "--tasks", TASK, "--episodes", "1", "--workers", "1")
    shown = run("eval", *words, "--out", "runs", folder=exports)
    assert "nearest:Nearest (privileged)" in shown
    (record,) = RunFolder(exports / "runs").read_records(RunFolder(exports / "runs").read_run())
    assert record.error is None
    assert record.steps > 0


@pytest.mark.slow
@pytest.mark.usefixtures("example", "checkpoint")
def test_one_policy_plays_the_file_of_the_task_that_is_instructed(
    exports: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import eleven  # pyright: ignore[reportMissingImports]
    from demonstrations import Demonstrations  # pyright: ignore[reportMissingImports]

    data = Demonstrations.load(exports / TASK)
    eleven.keep(data, tmp_path / f"{TASK}.npz")
    monkeypatch.setenv("CHECKPOINT", str(tmp_path))
    with pytest.raises(PolicyError, match=eleven.LIST):
        eleven.Eleven()
    (tmp_path / eleven.LIST).write_text(eleven.listing(tmp_path))
    policy = eleven.Eleven()
    listed = hashlib.sha256((tmp_path / eleven.LIST).read_bytes()).hexdigest()
    assert listed.startswith(policy.metadata.version)
    monkeypatch.setenv("CHECKPOINT", "nowhere")
    monkeypatch.setattr(eleven, "__file__", str(tmp_path / "eleven.py"))  # as a card says
    assert eleven.Eleven().metadata == policy.metadata
    with pytest.raises(PolicyError, match="Fold the towel"):
        policy.reset("Fold the towel.", 0)
    env = duobench.make(
        TASK, cameras=False, object_state=True, action_mode="cartesian", split="train"
    )
    (path, *_) = DataSet.open(exports.with_name("demos")).episodes()
    rollout(env, policy, seed=Recording.read_info(path).seed or 0)
    assert env.get_wrapper_attr("judge").stage == 3


@pytest.mark.usefixtures("example")
def test_instructions_begin_otherwise_for_every_task() -> None:
    begins = [catalog.get(name).instruction.partition("{")[0] for name in catalog.names()]
    assert not [(a, b) for a, b in permutations(begins, 2) if a.startswith(b)]


@pytest.mark.slow
@pytest.mark.usefixtures("example")
def test_grippers_open_late_and_stay_at_what_was_shown() -> None:
    from demonstrations import Grippers  # pyright: ignore[reportMissingImports]

    grippers = Grippers([[0.0, 0.45, 1.0], [0.0, 1.0]])

    def switched(left: float, right: float) -> tuple[float, float]:
        label = np.zeros(20, dtype=np.float32)
        label[9], label[19] = left, right
        grippers.switch(label)
        return round(float(label[9]), 2), float(label[19])

    assert switched(0.8, 0.6) == (1.0, 1.0)
    assert switched(0.4, 0.4) == (0.45, 0.0)
    assert switched(0.1, 0.8) == (0.0, 0.0)
    assert switched(0.4, 0.9) == (0.45, 1.0)
    assert switched(0.9, 0.9) == (0.45, 1.0)
    assert switched(0.95, 0.9) == (1.0, 1.0)


@pytest.mark.slow
@pytest.mark.usefixtures("example", "checkpoint")
def test_demonstrations_are_cut_at_success_and_at_the_release(exports: Path) -> None:
    from demonstrations import (  # pyright: ignore[reportMissingImports]
        Demonstrations,
        opening_columns,
    )

    recordings = list(DataSet.open(exports.with_name("demos")).recordings())
    whole, success, release = (
        Demonstrations.load(exports / TASK, until=until) for until in ("end", "success", "release")
    )
    assert whole.lengths.tolist() == [len(recording) for recording in recordings]
    assert success.lengths.tolist() == [r.success_step for r in recordings]
    assert (release.lengths < success.lengths).all()
    for data in (whole, release):
        last = np.cumsum(data.lengths) - 1
        opened = (data.labels[last] - data.labels[last - 1])[:, opening_columns(data.labels)]
        assert (opened > 0).any() == (data is release)


@pytest.mark.slow
@pytest.mark.usefixtures("example", "checkpoint")
def test_joint_labels_are_played_as_they_are(exports: Path) -> None:
    from demonstrations import action_mode, to_actions  # pyright: ignore[reportMissingImports]

    folder = exports.parent
    words = ("export", "lerobot", "demos", "--out", "joint", *EXPORT[:-1], "joint")
    run(*words, folder=folder)
    from demonstrations import Demonstrations  # pyright: ignore[reportMissingImports]

    data = Demonstrations.load(folder / "joint" / TASK, 1)
    recording = next(DataSet.open(folder / "demos").recordings())
    assert action_mode(data.labels) == "joint"
    assert np.array_equal(to_actions(data.labels), np.float32(recording.action))


@pytest.mark.long
@pytest.mark.usefixtures("example", "checkpoint")
def test_what_cannot_be_learned_from_is_refused_with_what_to_export(exports: Path) -> None:
    import network  # pyright: ignore[reportMissingImports]
    from demonstrations import Demonstrations  # pyright: ignore[reportMissingImports]
    from frames import features  # pyright: ignore[reportMissingImports]

    folder = exports.parent
    others = {
        "relative": (*EXPORT[:-1], "cartesian_relative"),
        "targets": (*EXPORT[:-1], "joint"),
        "blind": ("--per-task", "--cameras", "none"),
        "longer": (*EXPORT, "--state", "tcp_pose"),
    }
    for name, words in others.items():
        run("export", "lerobot", "demos", "--out", name, *words, folder=folder)
    whole, longer = (Demonstrations.load(folder / name / TASK) for name in ("exports", "longer"))
    assert np.array_equal(whole.state, longer.state)  # the environment shows these alone
    for name, words in (
        ("demos", "no export of one task. Export with .*--action cartesian"),
        ("exports", "no export of one task"),
        (f"relative/{TASK}", "no targets of joints or tools. Export with .*--action cartesian"),
        (f"blind/{TASK}", "does not say where the objects are"),
    ):
        with pytest.raises(DataError, match=words):
            Demonstrations.load(folder / name)
    with pytest.raises(DataError, match="has 2 demonstrations, and 3 were asked for"):
        Demonstrations.load(exports / TASK, 3)
    with pytest.raises(DataError, match="those of another task"):
        features(whole.state, whole.objects[:, 1:], whole.names)
    with pytest.raises(DataError, match=r"joint targets: export with --action cartesian"):
        network.train(Demonstrations.load(folder / "targets" / TASK), folder / "no.npz", 0)
    with pytest.raises(DataError, match=r"One demonstration in 10 is held out.* got 2"):
        network.train(whole, folder / "no.npz", 0)


@pytest.mark.slow
@pytest.mark.usefixtures("example", "checkpoint")
def test_nothing_is_played_without_a_checkpoint(monkeypatch: pytest.MonkeyPatch) -> None:
    import nearest  # pyright: ignore[reportMissingImports]
    import network  # pyright: ignore[reportMissingImports]

    with pytest.raises(PolicyError, match="no file of a network"):
        network.Network()  # of the folder of an export
    monkeypatch.delenv("CHECKPOINT")
    for policy in (nearest.Nearest, network.Network):
        with pytest.raises(PolicyError, match="CHECKPOINT=exports/bin_sort"):
            policy()


NAMES = tuple(
    duobench.make("ball_maze", cameras=False, object_state=True).get_wrapper_attr(
        "object_state_names"
    )
)
MIDDLE = 2.0
"""Column and row of the cell in the middle of a maze."""


def board(quarters: int, walls: dict[tuple[float, float], int], goal: np.ndarray) -> np.ndarray:
    """Object states (1, n) of a maze on a board that is turned by quarters.

    Args:
        quarters: Turns of the board by 90 degrees.
        walls: Whether a wall is at a place of the table's frame, in cells from the middle.
        goal: Cell of the goal (2,) there.
    """
    back = np.linalg.matrix_power(np.array([[0, 1], [-1, 0]]), quarters)
    x = np.linalg.matrix_power(np.array([[0, -1], [1, 0]]), quarters) @ (1, 0)
    told = dict.fromkeys(NAMES, 0.0)
    told |= {"board_x_axis_x": x[0], "board_x_axis_y": x[1], "board_z_axis_z": 1.0}
    column, row = back @ goal + MIDDLE
    told |= {"goal_column": column, "goal_row": row, "start_column": MIDDLE, "start_row": MIDDLE}
    for place, is_there in walls.items():
        column, row = back @ place + MIDDLE
        kind = "east" if column % 1 else "north"
        told[f"wall_{kind}_of_{int(column)}_{int(row)}"] = is_there
    return np.array([[told[name] for name in NAMES]], dtype=np.float32)


@pytest.mark.usefixtures("example")
def test_a_maze_looks_the_same_on_a_board_turned_by_quarters() -> None:
    from frames import features, frames  # pyright: ignore[reportMissingImports]

    rng = np.random.default_rng(0)
    between = [(x + 0.5, y) for x in range(-2, 2) for y in range(-2, 3)]
    walls: dict[tuple[float, float], int] = {
        place: int(rng.random() < 0.5) for x, y in between for place in ((x, y), (y, x))
    }
    state = np.zeros((1, 16), np.float32)
    seen = []
    for quarters in range(4):
        objects = board(quarters, walls, np.array([2, -1]))
        here = frames(state, objects, NAMES)
        assert here.quarters[0].tolist() == [0, 0, quarters, 0, 0]
        assert np.allclose(here.rotations[0, 2], np.eye(3), atol=1e-6)
        seen.append(features(state, objects, NAMES)[0, -54:])
    assert seen[0].sum() > 10
    assert all(np.array_equal(one, seen[0]) for one in seen)


@pytest.mark.usefixtures("example")
@pytest.mark.parametrize("gripper", GRIPPERS)
def test_frames_of_objects_point_forwards_and_are_turned_about_their_own_axis(gripper: str) -> None:
    from frames import bodies, frames  # pyright: ignore[reportMissingImports]

    env = duobench.make("bin_sort", cameras=False, object_state=True, gripper=gripper)
    names = tuple(env.get_wrapper_attr("object_state_names"))
    seen = [env.reset(seed=seed)[0] for seed in range(20)]
    state, objects = (np.stack([o[k] for o in seen]) for k in ("agent_pos", "environment_state"))
    here = frames(state, objects, names, robot_with(gripper))
    for number, thing in enumerate(bodies(names), 2):
        column = names.index(f"{thing}_x_axis_x")
        yaws = np.arctan2(here.rotations[:, number, 1, 0], here.rotations[:, number, 0, 0])
        assert np.abs(yaws).max() <= np.pi / 4 + 1e-6
        turned = np.arctan2(objects[:, column + 1], objects[:, column]) - yaws
        quarters = here.quarters[:, number]
        assert np.allclose(np.exp(1j * turned), 1j**quarters, atol=1e-5)
    tools = np.stack([o["tcp_pose"].reshape(2, 7)[:, :3] for o in seen])
    assert np.allclose(here.positions[:, :2], tools, atol=1e-5)


def brief(passes: int) -> Any:
    import network  # pyright: ignore[reportMissingImports]

    return network.Training(held_out=2, least=passes, most=passes, every=1, decay=1, batch=64)


@pytest.mark.slow
@pytest.mark.usefixtures("example", "checkpoint")
def test_network_is_trained_and_played(exports: Path, tmp_path: Path) -> None:
    torch = pytest.importorskip("torch", reason="PyTorch is not installed here: make test-lerobot")
    import network  # pyright: ignore[reportMissingImports]
    from demonstrations import Demonstrations  # pyright: ignore[reportMissingImports]
    from frames import features, frames  # pyright: ignore[reportMissingImports]

    data = Demonstrations.load(exports / TASK)
    told = [network.train(data, tmp_path / f"{n}.npz", 0, brief(n)) for n in (2, 40)]
    assert told[1]["held_out_error"] < told[0]["held_out_error"] / 2
    assert told[1]["passes"] == 40
    network.train(data, tmp_path / "again.npz", 0, brief(2))
    one, other = (dict(np.load(tmp_path / f"{name}.npz")) for name in ("2", "again"))
    assert all(np.array_equal(one[name], other[name]) for name in one)
    pytest.MonkeyPatch().setenv("CHECKPOINT", str(tmp_path / "40.npz"))
    policy = network.Network()
    policy.reset("", 0)
    env = duobench.make(TASK, cameras=False, object_state=True, action_mode="cartesian")
    chunk = policy.act(env.reset(seed=0)[0])
    assert chunk.shape == (30, 16)
    shown = np.array(policy._openings[0] + policy._openings[1], np.float32)
    assert set(np.unique(chunk[:, [7, 15]])) <= set(shown)

    rows = network._Rows(data, policy._net, "cpu")  # NumPy plays what PyTorch trained
    module = network.module(rows.x.shape[1], rows.positions.shape[1], policy._net)
    module.load_state_dict({k: torch.tensor(v) for k, v in policy._net.items() if "." in k})
    with torch.no_grad():
        expected = module(rows.x[:1], rows.positions[:1], rows.rotations[:1]).numpy()
    expected = expected * policy._net["y_scale"] + policy._net["y_mean"]
    first = data.state[:1], data.objects[:1], data.names
    seen = network._normal(features(*first), policy._net)[0]
    assert np.allclose(policy.chunk(seen, frames(*first)), expected[0], atol=1e-4)


@pytest.mark.usefixtures("example")
def test_training_goes_on_while_what_is_held_out_gets_better() -> None:
    import network  # pyright: ignore[reportMissingImports]

    how = network.Training(least=30, most=60, every=5, patience=10, decay=10)
    better = [1.0 / (n + 1) for n in range(20)]
    assert not network._is_over(better[:3], how)
    assert not network._is_over([1.0] * 3, how)  # too few passes to say
    assert network._is_over([1.0] * 5, how)
    assert not network._is_over(better[:9], how)
    assert network._is_over(better[:10], how)


def options(exports: Path, folder: Path, **words: object) -> SimpleNamespace:
    """What the table is asked by its command line."""
    usual: dict[str, object] = {"export": exports, "out": folder / "runs", "demonstrations": 2}
    usual |= {"results": folder / "results", "until": "end", "episodes": 1, "device": "cpu"}
    usual |= {"passes": None, "images": None, "self_imitation": None, "tasks": [TASK]}
    usual |= {"still": False}
    return SimpleNamespace(**usual | {"seeds": 1, "workers": 1} | words)


@pytest.mark.slow
@pytest.mark.usefixtures("example", "checkpoint")
def test_a_network_knows_the_gripper_that_it_learned_with(
    exports: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("torch", reason="PyTorch is not installed here: make test-lerobot")
    import eleven  # pyright: ignore[reportMissingImports]
    import network  # pyright: ignore[reportMissingImports]
    from demonstrations import Demonstrations  # pyright: ignore[reportMissingImports]

    shutil.copytree(exports / TASK, tmp_path / TASK)
    about = tmp_path / TASK / "meta" / "duobench.json"
    about.write_text(json.dumps(json.loads(about.read_text()) | {"robot": "franka_hand"}))
    data = Demonstrations.load(tmp_path / TASK)
    assert Demonstrations.load(exports / TASK).gripper == "robotiq_2f85"
    assert {one.gripper for one in (*(data + data).split(2), data.still())} == {"franka_hand"}
    network.train(data, tmp_path / "net.npz", 0, brief(2))
    eleven.keep(data, tmp_path / "nearest.npz")
    nearest, played = (eleven.read(tmp_path / f"{name}.npz") for name in ("nearest", "net"))
    assert nearest._data.gripper == "franka_hand"
    assert played._robot == robot_with("franka_hand")
    assert {one.metadata.robot for one in (nearest, played)} == {"franka_hand"}
    monkeypatch.setenv("GRIPPER", "robotiq_2f85")
    assert network.Network(tmp_path / "net.npz")._robot == robot_with("robotiq_2f85")


@pytest.mark.slow
@pytest.mark.usefixtures("example", "checkpoint")
def test_the_table_goes_on_where_it_was_stopped(
    exports: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("torch", reason="PyTorch is not installed here: make test-lerobot")
    import network  # pyright: ignore[reportMissingImports]
    import table  # pyright: ignore[reportMissingImports]

    short = brief(2)
    monkeypatch.setattr(network, "Training", lambda device: replace(short, device=device))
    monkeypatch.chdir(EXAMPLES)
    asked = options(exports, tmp_path)
    for seed in range(2):
        assert "of 1" in table.job(asked, TASK, seed)
    assert "is there" in table.job(asked, TASK, 0)
    (tmp_path / "results" / "2" / f"{TASK}-1.json").unlink()
    monkeypatch.setattr(network, "train", lambda *_: pytest.fail("trained again"))
    assert "of 1" in table.job(asked, TASK, 1)
    rows = list(table.table(asked.results, table.setting(asked)))
    assert rows[2].startswith(f"| `{TASK}` | ")
    rows = list(table.failures(asked.results, table.setting(asked)))
    assert rows[2].startswith(f"| `{TASK}` | 2 | ")


@pytest.mark.slow
@pytest.mark.usefixtures("example", "checkpoint")
def test_what_a_policy_achieved_is_there_to_be_learned_from(
    exports: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from demonstrations import Demonstrations  # pyright: ignore[reportMissingImports]
    from self_imitation import practise  # pyright: ignore[reportMissingImports]

    shown = Demonstrations.load(exports / TASK)
    monkeypatch.chdir(EXAMPLES)
    own, told = practise("nearest:Nearest", TASK, tmp_path, 1)
    assert told["successes"] == 1 <= told["played"]
    assert len(own.lengths) == 1
    assert own.names == shown.names
    again, _ = practise("nearest:Nearest", TASK, tmp_path, 1)
    assert np.array_equal(own.labels, again.labels)
    both = shown + own
    assert both.lengths.tolist() == [*shown.lengths, *own.lengths]
    assert np.array_equal(both.state[-own.lengths[0] :], own.state)


@pytest.mark.slow
@pytest.mark.usefixtures("example", "checkpoint")
def test_a_network_learns_from_what_the_one_before_it_achieved(
    exports: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("torch", reason="PyTorch is not installed here: make test-lerobot")
    import network  # pyright: ignore[reportMissingImports]
    import table  # pyright: ignore[reportMissingImports]
    from self_imitation import practise  # pyright: ignore[reportMissingImports]

    learned, played = [], []

    def train(data: Any, out: Path, *_: object) -> dict[str, int]:
        learned.append(len(data.lengths))
        out.write_bytes(bytes([len(learned)]))
        return {"passes": 1}

    def by_nearest(policy: str, task: str, folder: Path, count: int) -> Any:
        played.append((policy, os.environ["CHECKPOINT"]))
        os.environ["CHECKPOINT"] = str(exports / TASK)
        return practise("nearest:Nearest", task, folder, count)

    monkeypatch.chdir(EXAMPLES)
    monkeypatch.setattr(network, "train", train)
    monkeypatch.setattr(table, "practise", by_nearest)
    asked = options(exports, tmp_path, self_imitation=1)
    checkpoint, told = table.trained(asked, TASK, 0)
    first = tmp_path / "runs" / "2" / TASK / "0.npz"
    assert played == [("network:Network", str(first))]
    assert learned == [2, 3]
    assert told["played"] >= told["successes"] == 1
    assert table.setting(asked) == "2-self-1"
    assert table.trained(asked, TASK, 0) == (checkpoint, told)
    assert learned == [2, 3]


@pytest.mark.slow
@pytest.mark.usefixtures("example", "checkpoint")
def test_success_is_told_by_demonstrations_and_passes(
    exports: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("torch", reason="PyTorch is not installed here: make test-lerobot")
    import network  # pyright: ignore[reportMissingImports]
    import table  # pyright: ignore[reportMissingImports]

    short = brief(2)
    monkeypatch.setattr(network, "Training", lambda device: replace(short, device=device))
    monkeypatch.chdir(EXAMPLES)
    asked = options(exports, tmp_path)
    for asked.passes in (short.decay + 1, short.decay + 2):
        table.job(asked, TASK, 0)
    file = table.result(asked, TASK, 0)
    told = json.loads(file.read_text())
    assert told["training"]["passes"] == asked.passes
    fewer = tmp_path / "results" / f"1-passes-{asked.passes}" / file.name
    fewer.parent.mkdir()
    fewer.write_text(json.dumps({**told, "demonstrations": 1, "successes": 1}))
    head, _, *rows = table.curve(asked.results)
    first, second = short.decay + 1, short.decay + 2
    assert head == f"| task | demonstrations | {first} passes | {second} passes |"
    assert rows == [f"| `{TASK}` | 1 |  | 100 |", rows[1]]
    assert rows[1].startswith("|  | 2 | ")


@pytest.mark.usefixtures("example")
def test_the_interval_holds_the_spread_of_the_seeds() -> None:
    from table import interval  # pyright: ignore[reportMissingImports]

    alike, apart = interval([0.5, 0.5, 0.5], 100), interval([0.2, 0.5, 0.8], 100)
    assert alike == wilson_interval(50, 100)
    assert apart[0] < 0.25
    assert apart[1] > 0.75
    assert interval([1.0, 1.0], 100)[0] > 0.95


@pytest.mark.slow
@pytest.mark.usefixtures("example", "checkpoint")
def test_a_table_of_nothing_and_results_of_another_suite(exports: Path, tmp_path: Path) -> None:
    import table  # pyright: ignore[reportMissingImports]

    asked = options(exports, tmp_path, tasks=["bin_sort"])
    assert len(list(table.table(asked.results, "2"))) == 2  # its head alone
    with pytest.raises(DataError, match="bin_sort holds no export of one task"):
        table.run(asked)
    asked.tasks = ["bin_srot"]
    with pytest.raises(UnknownNameError, match="Did you mean 'bin_sort'"):
        table.run(asked)
    table.result(asked, TASK, 0).parent.mkdir(parents=True)
    table.result(asked, TASK, 0).write_text('{"suite": "1"}')
    with pytest.raises(OtherRunError, match=r"is of suite 1.* name another folder of results"):
        table.job(asked, TASK, 0)


@pytest.mark.slow
@pytest.mark.usefixtures("example", "checkpoint")
def test_a_run_of_another_state_of_the_code_is_told_with_what_to_do(
    exports: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import table  # pyright: ignore[reportMissingImports]

    def refuse(_policy: str, _suite: Suite, folder: RunFolder) -> None:
        raise OtherRunError(f"{folder.path} holds another evaluation.")

    monkeypatch.setattr(table, "evaluate", refuse)
    monkeypatch.setattr(table, "trained", lambda *_: (tmp_path / "0.npz", {}))
    with pytest.raises(OtherRunError, match=r"run-0 holds another evaluation\. Delete it"):
        table.job(options(exports, tmp_path), TASK, 0)


@pytest.mark.slow
@pytest.mark.usefixtures("example", "checkpoint")
def test_a_killed_process_of_the_table_is_told_in_a_sentence(
    exports: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import table  # pyright: ignore[reportMissingImports]

    monkeypatch.setattr(table, "job", kill_this_process)
    with pytest.raises(EvaluationError, match=r"was killed.* goes on where it was"):
        table.run(options(exports, tmp_path))


def kill_this_process(*_: object) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.slow
@pytest.mark.usefixtures("example", "checkpoint")
def test_a_network_that_sees_images_is_trained_and_played(
    exports: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    torch = pytest.importorskip("torch", reason="PyTorch is not installed here: make test-lerobot")
    import frames  # pyright: ignore[reportMissingImports]
    import images  # pyright: ignore[reportMissingImports]
    import network  # pyright: ignore[reportMissingImports]
    import pictures  # pyright: ignore[reportMissingImports]
    import sight  # pyright: ignore[reportMissingImports]
    import table  # pyright: ignore[reportMissingImports]
    from demonstrations import Demonstrations  # pyright: ignore[reportMissingImports]

    monkeypatch.chdir(EXAMPLES)
    monkeypatch.setattr(pictures, "HELD_OUT", 2)
    data, demos = Demonstrations.load(exports / TASK), exports.with_name("demos")
    second = data._only(np.arange(len(data.state)) >= data.lengths[0], np.array([False, True]))
    with pytest.raises(DataError, match=r"Episode 0 of .* is not that of the export"):
        images.see(demos, TASK, second, 4)
    seen = images.see(demos, TASK, data, 4)
    rows = sum(-(-length // pictures.EVERY) for length in data.lengths.tolist())
    shapes = [(rows + 4, *size, 3) for size in sight.SIZES.values()]
    assert [one.shape for one in seen.images] == shapes
    assert seen.held.tolist() == [n >= seen.before.tolist().index(0, 1) for n in range(rows)] + [
        False,
        False,
        True,
        True,
    ]

    short = brief(2)
    monkeypatch.setattr(network, "Training", lambda device: replace(short, device=device))
    longer = images.Training(batch=16, passes=25, warm_up=5, layouts=4)
    monkeypatch.setattr(images, "Training", lambda device: replace(longer, device=device))
    asked = options(exports, tmp_path, passes=2, images=demos)
    assert "of 1" in table.job(asked, TASK, 0)
    told = json.loads(table.result(asked, TASK, 0).read_text())
    acts = tmp_path / f"runs/2-still/{TASK}/0.npz"  # the network of the table acts
    acted = hashlib.sha256(acts.read_bytes()).hexdigest()
    assert acted.startswith(told["training"]["first"]["checkpoint"])
    assert told["training"]["passes"] == 2
    assert table.result(asked, TASK, 0).parent.name == "2-passes-2-images"
    monkeypatch.setenv("CHECKPOINT", str(acts))
    with pytest.raises(PolicyError, match="sees no images"):
        images.Images()

    images.train(acts, data, seen, tmp_path / "sees.npz", 0, longer)
    with pytest.raises(DataError, match="of another task"):
        images.train(acts, replace(data, names=("x",)), seen, tmp_path / "no.npz", 0)
    monkeypatch.setenv("CHECKPOINT", str(tmp_path / "sees.npz"))
    policy = images.Images()
    assert not policy.metadata.object_state
    policy.reset("", 0)
    first = [torch.from_numpy(one[:1].transpose(0, 3, 1, 2)) for one in seen.images]
    found = policy.look(first, seen.state[:1])[0]
    for body in frames.bodies(data.names):  # one of the images that it has learned from
        x = data.names.index(f"{body}_x")
        assert np.linalg.norm(found[x : x + 3] - seen.objects[0, x : x + 3]) < 0.02
    pixels = {c: one[0] for c, one in zip(POLICY_CAMERAS, seen.images, strict=True)}
    assert policy.act({"agent_pos": seen.state[0], "pixels": pixels}).shape == (30, 16)
    monkeypatch.setenv("CHECKPOINT", str(tmp_path))
    with pytest.raises(PolicyError, match="no file of a network"):
        images.Images()


@pytest.mark.usefixtures("example")
def test_what_no_image_shows_is_not_told() -> None:
    pytest.importorskip("torch", reason="PyTorch is not installed here: make test-lerobot")
    from demonstrations import Demonstrations  # pyright: ignore[reportMissingImports]
    from images import Kinds  # pyright: ignore[reportMissingImports]

    rng = np.random.default_rng(0)
    objects = rng.random((6, len(NAMES)), dtype=np.float32)
    chosen = [n for n, name in enumerate(NAMES) if name.startswith(("wall", "start", "goal"))]
    first = rng.permuted(np.tile([[0], [1]], len(chosen)), axis=0)
    objects[:, chosen] = np.repeat(first, 3, axis=0)
    state, labels = np.zeros((6, 16), np.float32), np.zeros((6, 20), np.float32)
    still = Demonstrations(state, objects, labels, np.array([3, 3]), NAMES).still()
    moves = [n for n, name in enumerate(NAMES) if name.startswith("ball_velocity")]
    assert not still.objects[:, moves].any()
    assert np.array_equal(np.delete(objects, moves, 1), np.delete(still.objects, moves, 1))
    kinds = Kinds.of(still)
    assert [NAMES[part.start] for part in kinds.places] == ["board_x", "ball_x"]
    assert kinds.chosen == chosen
    assert kinds.others == [*moves, *range(len(NAMES), len(NAMES) + 4)]
    assert len(kinds.axes) == 2


@pytest.mark.usefixtures("example")
@pytest.mark.parametrize("gripper", GRIPPERS)
def test_rays_meet_where_an_object_is_and_patches_lie_on_it(gripper: str) -> None:
    torch = pytest.importorskip("torch", reason="PyTorch is not installed here: make test-lerobot")
    import sight  # pyright: ignore[reportMissingImports]

    names = tuple(f"cube_{end}" for end in ("x", "y", "z", "x_axis_x", "x_axis_y", "x_axis_z"))
    scale = {"o_mean": np.zeros(6, np.float32), "o_scale": np.ones(6, np.float32)}
    net = sight.Sight(names, scale, [3])
    options: dict[str, Any] = {"cameras": POLICY_CAMERAS, "image_sizes": sight.SIZES}
    env = duobench.make("bin_sort", gripper=gripper, **options)
    seen, _ = env.reset(seed=0)
    state = seen["agent_pos"][None]
    cameras = torch.from_numpy(sight.places_of_cameras(state, robot_with(gripper)))
    backend = SimBackend(env.get_wrapper_attr("simulation"))
    for nth, one in enumerate(backend.camera_geometry(sight.SIZES).values()):
        assert np.allclose(cameras[0, nth], one.table_from_camera, atol=1e-5)

    cube = torch.tensor([0.5, 0.1, 0.02])
    there = net.pixels(cube[None, None], cameras)
    assert there[0][1].item()  # the head sees it
    eye, (pixels, _) = net.eyes[0], there[0]
    maps = torch.full((1, 1, len(eye.grid)), -30.0).requires_grad_()
    rate = torch.optim.Adam([maps], lr=1.0)
    for _ in range(200):
        rate.zero_grad()
        eye.surprise(maps.log_softmax(-1), *there[0]).sum().backward()
        rate.step()
    assert torch.allclose(maps.softmax(-1) @ eye.grid, pixels, atol=0.1)

    def looks(nth: int, spread: float, wrong: float) -> Any:
        what = torch.zeros(1, 1, sight.CHANNELS + 3)
        return lambda _: (None, there[nth][0] + wrong, spread * torch.ones(1, 1), what)

    images = [torch.zeros(1, 3, *size) for size in sight.SIZES.values()]
    del net.eyes
    net.eyes = [looks(0, 0.0, 0.0), looks(1, 0.0, 0.0), looks(2, 1e6, 50.0)]  # one does not see it
    found, _ = net(images, cameras)
    assert torch.allclose(found[0, :3], cube, atol=2e-3)

    colours = []  # of an image that tells where its pixels are
    for size in sight.SIZES.values():
        across, down = torch.meshgrid(*(torch.arange(n) * 1.0 for n in size), indexing="xy")
        colours.append(torch.stack([across, down, 0 * down])[None])
    taken = []

    def reads(patches: Any) -> Any:
        taken.append(patches)
        return patches

    del net.reads
    net.reads = reads
    net.read(colours, cameras, cube[None, None], torch.eye(3)[None, None])
    patches = (taken[0][0].view(3, 3, sight.PATCH, sight.PATCH) + 1) * 127.5
    at = net.pixels((cube + net.patch[7])[None, None], cameras)[0][0][0, 0]
    assert torch.allclose(patches[0, :2].flatten(1)[:, 7], at, atol=0.1)


@pytest.mark.usefixtures("example")
@pytest.mark.parametrize("task", ["spring_door", "ball_maze"])
def test_what_is_seen_of_an_object_state_is_all_of_it(task: str) -> None:
    pytest.importorskip("torch", reason="PyTorch is not installed here: make test-lerobot")
    from frames import frames  # pyright: ignore[reportMissingImports]
    from images import recognized, shown  # pyright: ignore[reportMissingImports]

    env = duobench.make(task, cameras=False, object_state=True)
    names = tuple(env.get_wrapper_attr("object_state_names"))
    objects = np.stack([env.reset(seed=s)[0]["environment_state"] for s in range(12)])
    seen = shown(objects, names)
    state = np.zeros((len(objects), 16), np.float32)
    ahead = frames(state, seen[:, : len(names)], names)
    assert not ahead.quarters.any()
    assert np.allclose(recognized(seen, names), objects, atol=1e-6)
    longer = seen.copy()
    longer[:, : len(names)] += 0.01  # axes that are seen are of no exact length and angle
    axes = recognized(longer, names)[:, [n for n, name in enumerate(names) if "_x_axis_" in name]]
    assert np.allclose(np.linalg.norm(axes.reshape(len(axes), -1, 3), axis=-1), 1, atol=1e-6)
