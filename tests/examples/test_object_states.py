"""The baselines on object states: recorded, exported and played as a reader would."""

import hashlib
import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, replace
from itertools import permutations
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import duobench
from dev.benchmarks.corrections import FROZEN, record
from duobench.core.errors import (
    DataError,
    EvaluationError,
    OtherRunError,
    PolicyError,
    UnknownNameError,
)
from duobench.core.randomness import SUITE_VERSION, TRAIN, episode_seed
from duobench.core.spatial import rotation_about, rotation_by
from duobench.data import Actor, DataSet, Recorder, Recording
from duobench.evaluation.rollouts import rollout
from duobench.results.folder import RunFolder
from duobench.results.run import needed_options
from duobench.results.scores import wilson_interval
from duobench.results.suite import Suite
from duobench.tasks import catalog
from duobench.world.robot.cameras import POLICY_CAMERAS
from duobench.world.robot.frames import robot_with
from duobench.world.robot.gripper import GRIPPERS
from duobench.world.sim.backend import SimBackend
from tests.docs.markdown import ROOT, blocks, page_of

EXAMPLES = ROOT / "examples" / "object_states"
TASK = "carry_pot"


def export_of_the_page() -> tuple[str, ...]:
    """What the page says to export with; the action mode last."""
    _, export = blocks(page_of("baselines"), "sh")[0].replace("\\\n", " ").splitlines()
    program, said = shlex.split(export)[:6], shlex.split(export)[6:]
    assert program == ["duobench", "export", "lerobot", "demos", "--out", "exports"]
    for option in ("--workers", "--action"):
        at = said.index(option)
        last = said[at : at + 2]
        del said[at : at + 2]
    return (*said, *last)


EXPORT = export_of_the_page()


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


@pytest.mark.usefixtures("example")
def test_hands_stay_where_they_are_while_grippers_move_as_demonstrated() -> None:
    from demonstrations import Grippers, stillness  # pyright: ignore[reportMissingImports]

    labels = np.zeros((20, 20), dtype=np.float32)
    labels[:, 0] = [*[0.0] * 9, 0.3, 0.3, *[0.5] * 9]  # the left hand's x
    labels[:, 9] = [*[1.0] * 3, *[0.0] * 7, *[1.0] * 10]  # it closes at 3, goes at 9, opens at 10
    labels[:, 19] = 1.0
    assert stillness(labels, np.array([20])) == [[5, 0], [0, 0]]
    assert stillness(labels, np.array([6, 14])) == [[2, 0], [0, 0]]  # an episode ends at 6
    tilted = labels.copy()
    tilted[6:, 3] = 0.05  # an axis
    assert stillness(tilted, np.array([20])) == [[2, 0], [0, 0]]

    grippers = Grippers([[0.0, 1.0], [0.0, 1.0]], [[2, 1], [0, 0]])
    chunk = np.zeros((6, 20), dtype=np.float32)
    chunk[:, 0] = chunk[:, 10] = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]
    chunk[:, 9] = chunk[:, 19] = [1.0, 0.0, 0.0, 0.0, 1.0, 1.0]
    later = np.full((1, 20), 0.7, dtype=np.float32)
    for label in (*chunk, *later):  # what began in one chunk goes on in the next
        grippers.switch(label)
    assert chunk[:, 0] == pytest.approx([0.1, 0.2, 0.2, 0.2, 0.5, 0.5])
    assert chunk[:, 10] == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    assert later[0, [0, 10]] == pytest.approx([0.7, 0.7])
    grippers = Grippers([[0.0, 1.0], [0.0, 1.0]], [[2, 1], [0, 0]])
    for label in chunk[:2]:
        grippers.switch(label)
    grippers.switch(later[0])
    assert later[0, 0] == pytest.approx(0.2)


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
        network.train(Demonstrations.load(folder / "targets" / TASK), TASK, folder / "no.npz", 0)


@pytest.mark.slow
@pytest.mark.usefixtures("example", "checkpoint")
def test_nothing_is_played_without_a_checkpoint_of_today(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    import nearest  # pyright: ignore[reportMissingImports]
    import network  # pyright: ignore[reportMissingImports]

    with pytest.raises(PolicyError, match="no file of a network"):
        network.Network()  # of the folder of an export
    np.savez(tmp_path / "old.npz", about='{"names": [], "close": 0.05}')
    with pytest.raises(PolicyError, match=r"earlier state of this example.* train it again"):
        network.Network(tmp_path / "old.npz")
    np.savez(tmp_path / "none.npz", state=np.zeros(1))
    with pytest.raises(PolicyError, match="is no file of a network"):
        network.Network(tmp_path / "none.npz")
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


@pytest.mark.usefixtures("example")
def test_a_tilted_object_has_the_same_frame_after_every_quarter_turn() -> None:
    from frames import frames  # pyright: ignore[reportMissingImports]

    rng = np.random.default_rng(0)
    tilted = np.array([rotation_by(vector) for vector in rng.normal(size=(100, 3))])
    names = tuple(f"cube_{part}{end}" for part in ("", "x_axis_", "z_axis_") for end in "xyz")
    seen = []
    for quarters in range(4):
        turned = tilted @ rotation_about((0, 0, 1), quarters * np.pi / 2)
        objects = np.hstack([np.zeros((100, 3)), turned[..., 0], turned[..., 2]])
        seen.append(frames(np.zeros((100, 16), np.float32), np.float32(objects), names))
    for one in seen[1:]:
        assert np.allclose(one.rotations[:, 2], seen[0].rotations[:, 2], atol=1e-5)
    numbers = np.stack([one.quarters[:, 2] for one in seen])
    assert np.array_equal(np.sort(numbers, axis=0), np.tile(np.arange(4)[:, None], 100))


def brief(steps: int) -> Any:
    import learning  # pyright: ignore[reportMissingImports]

    return learning.Training(batch=64, warm_up=5, every=steps, most=steps, episodes=1)


@pytest.fixture
def unplayed(monkeypatch: pytest.MonkeyPatch, example: None) -> None:  # noqa: ARG001
    """Nothing is played to tell networks apart, which takes seconds; another test does.

    Nor are demonstrations told more often than four times.
    """
    import network  # pyright: ignore[reportMissingImports]
    import own_play  # pyright: ignore[reportMissingImports]

    monkeypatch.setattr(network, "ROWS", 100)
    monkeypatch.setattr(own_play.Trial, "score", lambda *_: (0, 0.5))


@pytest.mark.slow
@pytest.mark.usefixtures("unplayed", "checkpoint")
def test_network_is_trained_and_played(exports: Path, tmp_path: Path) -> None:
    torch = pytest.importorskip("torch", reason="PyTorch is not installed here: make test-lerobot")
    import network  # pyright: ignore[reportMissingImports]
    from demonstrations import Demonstrations, stillness  # pyright: ignore[reportMissingImports]
    from frames import features, frames  # pyright: ignore[reportMissingImports]

    data = Demonstrations.load(exports / TASK)
    for steps in (20, 300):
        network.train(data, TASK, tmp_path / f"{steps}.npz", 0, brief(steps))
    told = network.train(data, TASK, tmp_path / "again.npz", 0, brief(20))
    assert told["steps"] == told["kept"] == 20
    one, other = (dict(np.load(tmp_path / f"{name}.npz")) for name in ("20", "again"))
    assert all(np.array_equal(one[name], other[name]) for name in one)
    first = data.state[:1], data.objects[:1], data.names

    def chunk(name: str) -> tuple[np.ndarray, Any]:
        policy = network.Network(tmp_path / f"{name}.npz")
        return policy.chunk(features(*first)[0], frames(*first)), policy

    shown = data.labels[data.chunks(network.HORIZON)[0]]
    off = [np.abs(chunk(name)[0] - shown).mean() for name in ("20", "300")]
    assert off[1] < 0.6 * off[0]
    said, policy = chunk("300")
    policy.reset("", 0)
    env = duobench.make(TASK, cameras=False, object_state=True, action_mode="cartesian")
    played = policy.act(env.reset(seed=0)[0])
    assert played.shape == (30, 16)
    assert policy._grippers._still == stillness(data.labels, data.lengths)
    assert np.min(policy._grippers._still) > 0
    openings = np.concatenate(policy._hands[0]).astype(np.float32)
    assert set(np.unique(played[:, [7, 15]])) <= set(openings)

    rows = network._Rows(data, policy._net, "cpu", 0)
    module = network.module(data.names, policy._net).eval()
    module.load_state_dict({k: torch.tensor(v) for k, v in policy._net.items() if "." in k})
    shown = data.state, data.objects, data.names
    seen = [features(*shown), *vars(frames(*shown)).values()][:3]
    seen = [torch.from_numpy(part).float() for part in seen]
    with torch.no_grad():
        carried = module(*seen)[1]
    assert len(rows._told["x"]) >= network.ROWS
    copies = rows._told["x"].view(-1, *seen[0].shape)
    assert all(0.01 < (one - seen[0]).abs().max() < 3.0 for one in copies)
    known = carried.gather(-1, rows._carried.flatten(1)[..., None])[..., 0]
    holds = (rows._carried > 1).flatten(1)
    told_apart = known[holds].mean() + known[~holds].mean()
    assert told_apart > 1.1  # 1 if it said the same of all

    rng = np.random.default_rng(0)  # one that carries things too
    bias = policy._net["carried.bias"]
    policy._net["carried.bias"] = rng.normal(scale=2.0, size=bias.shape).astype(np.float32)
    said = policy.chunk(features(*first)[0], frames(*first))
    module.carried.bias.data = torch.from_numpy(policy._net["carried.bias"])
    with torch.no_grad():  # NumPy plays what PyTorch trained
        expected = module(*(part[:1] for part in seen))[0].numpy()
    expected = expected * policy._net["y_scale"] + policy._net["y_mean"]
    assert np.allclose(said, expected[0], atol=1e-4)


@pytest.mark.usefixtures("example")
def test_a_thing_is_brought_to_the_same_place_however_it_is_held(tmp_path: Path) -> None:
    torch = pytest.importorskip("torch", reason="PyTorch is not installed here: make test-lerobot")
    import network  # pyright: ignore[reportMissingImports]
    from frames import Frames, features, frames  # pyright: ignore[reportMissingImports]

    env = duobench.make("bin_sort", cameras=False, object_state=True)
    names = tuple(env.get_wrapper_attr("object_state_names"))
    seen = env.reset(seed=0)[0]
    now = seen["agent_pos"][None], seen["environment_state"][None], names
    inputs, things = features(*now).shape[1], frames(*now).positions.shape[1]
    scale = {f"{one}_mean": np.zeros(n, np.float32) for one, n in (("x", inputs), ("y", 20))}
    scale |= {f"{one}_scale": np.ones(n, np.float32) for one, n in (("x", inputs), ("y", 20))}
    net = network.module(names, scale)
    with torch.no_grad():
        for head in (net.shares, net.carried, net.poses):
            head.weight.zero_()
            head.bias.zero_()
        net.shares.bias.view(-1, things)[:, -1] = 100.0  # all is told in the table's frame
        place, x_axis, y_axis = [0.5, 0.1, 0.2], [0.0, 2.0, 0.0], [0.0, 0.0, 1.0]
        told = torch.tensor([[n / network.METRES for n in place], x_axis, y_axis])
        net.poses.bias.view(-1, network.VECTORS, things, 3)[:, :, -1] = told
        left, right = net.carried.bias.view(2, -1, things)
        cube = 3
        left[:, cube] = 100.0  # the right hand stays empty
        right[:, 1] = 100.0
    about = {"names": names, "columns": [*range(len(names))], "openings": [[0.0, 1.0]] * 2}
    about |= {"mode": "cartesian", "close": network.CLOSE, "still": [[0, 0]] * 2}
    arrays = network.arrays(net)
    np.savez(tmp_path / "net.npz", about=json.dumps(about), **scale, **arrays)
    policy = network.Network(tmp_path / "net.npz")
    here = frames(*now)
    turned = np.stack([x_axis, y_axis, np.cross(x_axis, y_axis)], axis=-1) / [2.0, 1.0, 2.0]
    chunks = []
    for held_at in ([0.0, 0.0, 0.0], [0.01, -0.02, 0.03]):  # in the tool
        positions = here.positions.copy()
        positions[0, cube] = positions[0, 0] + here.rotations[0, 0] @ held_at
        moved = Frames(positions, here.rotations, here.quarters)
        chunk = policy.chunk(np.zeros(inputs, np.float32), moved).reshape(-1, 2, 10)
        brought = chunk[:, 0, :3] + turned @ held_at
        assert np.allclose(brought, place, atol=1e-5)
        assert np.allclose(chunk[:, 1, :3], place, atol=1e-5)
        chunks.append(chunk[:, 0, :3])
    assert np.abs(chunks[1] - chunks[0]).max() > 0.02


@pytest.mark.usefixtures("example")
def test_object_poses_have_noise() -> None:
    from frames import bodies, frames, with_pose_noise  # pyright: ignore[reportMissingImports]

    objects = np.repeat(board(1, {}, np.array([1.0, 2.0])), 500, axis=0)
    state = np.zeros((len(objects), 16), np.float32)
    told = with_pose_noise(objects, NAMES, 2e-3, 0.02, np.random.default_rng(0))
    true, noisy = (frames(state, one, NAMES) for one in (objects, told))
    places = slice(2, 2 + len(bodies(NAMES)))
    off = (noisy.positions - true.positions)[:, places]
    assert np.allclose(off.std(axis=0), 2e-3, rtol=0.2)
    turned = true.rotations[:, 2].swapaxes(1, 2) @ noisy.rotations[:, 2]
    assert np.allclose(turned @ turned.swapaxes(1, 2), np.eye(3), atol=1e-5)
    about = np.stack([turned[:, 2, 1], turned[:, 0, 2], turned[:, 1, 0]], axis=1)
    assert np.allclose(about.std(axis=0), 0.02, rtol=0.2)
    moved = {n for n, name in enumerate(NAMES) if np.ptp(told[:, n]) > 0}
    ends = ("_x", "_y", "_z")
    assert {NAMES[n] for n in moved} == {
        name for name in NAMES if name.endswith(ends) and "velocity" not in name
    }


@pytest.mark.usefixtures("example")
def test_a_hand_is_closed_from_where_it_closed_to_where_it_opens() -> None:
    from grasps import _closed  # pyright: ignore[reportMissingImports]

    openings = np.float32([0.45, 0.45, 0.0, 0.0, 0.2, 0.45, 0.45, 0.0, 0.0, 0.0, 0.45])
    episodes = np.repeat([5, 8, 11], [5, 3, 3])
    closed = [False, False, True, True, False, False, False, True, True, True, False]
    assert _closed(openings, episodes).tolist() == closed


@pytest.mark.slow
@pytest.mark.usefixtures("example", "checkpoint")
def test_a_tool_carries_what_its_hand_holds_until_it_lets_go(exports: Path) -> None:
    from demonstrations import Demonstrations  # pyright: ignore[reportMissingImports]
    from frames import bodies, frames  # pyright: ignore[reportMissingImports]
    from grasps import Grasps  # pyright: ignore[reportMissingImports]

    data = Demonstrations.load(exports / TASK)
    grasps = Grasps.of(data, frames(data.state, data.objects, data.names))
    pot = 2 + bodies(data.names).index("pot")
    steps, own = np.arange(0, 30, 3), np.arange(2)[:, None]
    carried = grasps.carried(steps)
    first = np.cumsum(data.lengths) - data.lengths
    assert (carried[first] == own).all()  # what hands go for is not carried yet
    both = grasps.holds.all(axis=1)
    held = steps < grasps.left[both][..., None]
    assert np.array_equal(carried[both], np.where(held, pot, own))
    assert not held.all()  # it is let go within some chunks
    assert held.any()


@pytest.mark.slow
@pytest.mark.usefixtures("example", "checkpoint")
def test_grasps_are_what_hands_hold_and_what_they_go_for(exports: Path) -> None:
    from demonstrations import Demonstrations, opening_columns  # pyright: ignore[reportMissingImports]
    from frames import bodies, frames  # pyright: ignore[reportMissingImports]
    from grasps import NOTHING, Grasps  # pyright: ignore[reportMissingImports]

    data = Demonstrations.load(exports / TASK)
    here = frames(data.state, data.objects, data.names)
    grasps = Grasps.of(data, here)
    pot = bodies(data.names).index("pot")
    places = here.positions[:, 2 + pot]
    assert set(np.unique(grasps.things)) == {NOTHING, pot}
    ends = np.cumsum(data.lengths)
    starts = ends - data.lengths
    assert (grasps.things[starts] == pot).all()  # which hands go for
    assert not grasps.holds[[*starts, *(ends - 1)]].any()
    assert (grasps.things[ends - 1] == NOTHING).all()
    both = np.flatnonzero(grasps.holds.all(axis=1))
    assert len(both) > 50
    opens = data.labels[:, opening_columns(data.labels)] > 0.1  # less than half, beside handles
    assert opens[starts].all()
    assert not opens[both].any()
    for row in both[::10]:
        for side in range(2):
            left = grasps.left[row, side]
            assert not opens[row : row + left, side].any()
            assert opens[row + left, side]
    for row in starts:
        gone = row + grasps.left[row]
        assert (np.linalg.norm(places[gone] - places[row], axis=1) > 0.009).all()
        assert (np.linalg.norm(places[gone - 5] - places[row], axis=1) < 0.009).all()


@pytest.mark.slow
@pytest.mark.usefixtures("example", "checkpoint")
def test_what_is_held_or_lies_otherwise_is_brought_to_where_it_was_shown(exports: Path) -> None:
    torch = pytest.importorskip("torch", reason="PyTorch is not installed here: make test-lerobot")
    from demonstrations import Demonstrations  # pyright: ignore[reportMissingImports]
    from frames import bodies, frames  # pyright: ignore[reportMissingImports]
    from grasps import (  # pyright: ignore[reportMissingImports]
        FADE,
        NOTHING,
        Grasps,
        Moves,
        Otherwise,
        moved,
    )

    data = Demonstrations.load(exports / TASK)
    here = frames(data.state, data.objects, data.names)
    grasps = Grasps.of(data, here)
    pot = bodies(data.names).index("pot")
    both = np.flatnonzero(grasps.holds.all(axis=1))
    other = Otherwise.drawn(data, here, grasps, np.random.default_rng(0), (0.01, 0.1))
    there = frames(data.state, other.objects, data.names)
    is_left = (grasps.things == NOTHING).all(axis=1)
    assert np.array_equal(other.objects[is_left], data.objects[is_left])
    assert not np.isclose(other.objects, data.objects).all(axis=1)[~is_left].any()
    none = Moves.none(len(data.state))

    def told(rows: np.ndarray, goals: Moves, held: Moves, steps: int) -> np.ndarray:
        chunks = torch.from_numpy(data.labels[data.chunks(steps)[rows]]).double()
        poses = chunks.unflatten(-1, (2, -1))[..., :9]
        parts = (
            Moves(*(torch.from_numpy(part[rows]) for part in vars(one).values()))
            for one in (goals, held)
        )
        return moved(poses, *parts, torch.from_numpy(grasps.left[rows])).numpy()

    everything = np.arange(len(data.state))
    as_shown = told(everything, none, none, 200)
    otherwise = told(everything, other.goals, other.held, 200)
    over = np.arange(200)[None, :, None] - grasps.left[:, None]
    same = np.isclose(otherwise, as_shown, atol=1e-9).all(axis=-1)
    assert same[over >= FADE].all()
    counts = (over <= 0) & (grasps.things == pot)[:, None]
    assert not same[counts & grasps.holds[:, None]].any()

    def pose(numbers: np.ndarray) -> np.ndarray:
        x = numbers[3:6] / np.linalg.norm(numbers[3:6])
        y = numbers[6:9] - numbers[6:9] @ x * x
        y /= np.linalg.norm(y)
        return matrix(np.stack([x, y, np.cross(x, y)], axis=-1), numbers[:3])

    def matrix(turn: np.ndarray, place: np.ndarray) -> np.ndarray:
        whole = np.eye(4)
        whole[:3, :3], whole[:3, 3] = turn, place
        return whole

    for side in range(2):
        for row in both[::20]:
            tool, shown, now = (
                matrix(part.rotations[row, k], part.positions[row, k])
                for part, k in ((here, side), (here, 2 + pot), (there, 2 + pot))
            )
            brought = pose(as_shown[row, 0, side]) @ np.linalg.inv(tool) @ shown
            now_brought = pose(otherwise[row, 0, side]) @ np.linalg.inv(tool) @ now
            assert np.allclose(brought, now_brought, atol=1e-6)
        goes = ~grasps.holds[:, side] & (grasps.things[:, side] == pot)
        for row in np.flatnonzero(goes & (grasps.left[:, side] > 20))[::40]:
            shown, now = (
                matrix(part.rotations[row, 2 + pot], part.positions[row, 2 + pot])
                for part in (here, there)
            )
            step = grasps.left[row, side] - 1  # a hand that is far from the pot comes as it came
            goal, new = pose(as_shown[row, step, side]), pose(otherwise[row, step, side])
            far = np.linalg.norm((goal - shown)[:3, 3])
            way = (new - goal)[:3, 3] - (now - shown)[:3, 3]
            turn = now[:3, :3] @ shown[:3, :3].T
            share = np.clip(2 - far / 0.2, 0, 1)
            assert np.allclose(way, share * (turn - np.eye(3)) @ (goal - shown)[:3, 3], atol=1e-6)


def learned(
    scores: list[tuple[int, float]],
    out: Path,
    stopped_at: int = -1,
    seed: int = 0,
    source: str = "a line",
) -> dict[str, Any]:
    """Learn a line through two points; each look is told what it sees, and one may be the end."""
    import torch
    from learning import Training, learn  # pyright: ignore[reportMissingImports]

    torch.manual_seed(0)
    net, left = torch.nn.Linear(1, 1), iter(scores)

    def error() -> Any:
        x = torch.rand(4, 1)
        return (net(x) - 2 * x - 1).abs().mean()

    def look(average: Any, file: Path) -> tuple[int, float]:
        np.savez(file, **{k: v.numpy() for k, v in average.state_dict().items()})
        assert not torch.equal(average.weight, net.weight)  # weights of several steps
        score = next(left)
        if score == scores[stopped_at] and stopped_at >= 0:
            raise KeyboardInterrupt
        return score

    how = Training(batch=4, rate=0.1, warm_up=1, every=10, most=60, patience=20, episodes=4)
    return learn(net, error, how, look, out, seed, source)


@pytest.mark.usefixtures("example")
def test_a_network_learns_while_it_plays_better_and_the_best_is_kept(tmp_path: Path) -> None:
    pytest.importorskip("torch", reason="PyTorch is not installed here: make test-lerobot")
    import learning  # pyright: ignore[reportMissingImports]

    best = [(1, 0.3), (2, 0.5), (2, 0.4), (1, 0.9)]
    told = learned(best, tmp_path / "kept.npz")
    assert told["looks"] == [list(score) for score in best]
    assert (told["steps"], told["kept"]) == (40, 20)  # patience
    alike = learned([(1, 0.3), (2, 0.4), (2, 0.5), (1, 0.9)], tmp_path / "alike.npz")
    assert (alike["steps"], alike["kept"]) == (40, 30)  # it waits for more successes
    rising = [(n // 2, 0.5 + n / 100) for n in range(8)]
    assert learned(rising, tmp_path / "most.npz")["steps"] == 60
    assert learned([(4, 1.0)] * 6, tmp_path / "perfect.npz")["steps"] == 20
    kept, last, second = (
        np.load(tmp_path / f"{name}.npz")["weight"] for name in ("kept", "most", "perfect")
    )
    assert np.array_equal(kept, second)  # that of step 20
    assert not np.array_equal(kept, last)
    assert learned([], tmp_path / "kept.npz") | {"seconds": 0} == told | {"seconds": 0}  # is over
    names = ["alike", "kept", "most", "perfect"]
    for name in names:
        learning.forget(tmp_path / f"{name}.npz")
    assert sorted(file.name for file in tmp_path.iterdir()) == [f"{name}.npz" for name in names]


@pytest.mark.usefixtures("example")
def test_a_training_that_was_stopped_goes_on_to_the_same_bits(tmp_path: Path) -> None:
    pytest.importorskip("torch", reason="PyTorch is not installed here: make test-lerobot")
    scores = [(0, 0.1), (1, 0.2), (1, 0.3), (2, 0.4), (2, 0.5), (3, 0.6)]
    whole = learned(scores, tmp_path / "whole.npz")
    with pytest.raises(KeyboardInterrupt):
        learned(scores, tmp_path / "stopped.npz", 2)
    for other in ({"seed": 1}, {"source": "a curve"}):
        with pytest.raises(DataError, match=r"of another recipe, or from something else: delete"):
            learned(scores[2:], tmp_path / "stopped.npz", **other)
    best = (tmp_path / "stopped.npz").rename(tmp_path / "elsewhere.npz")
    with pytest.raises(DataError, match=r"stopped\.npz is gone, which .* goes on from: delete it"):
        learned(scores[2:], tmp_path / "stopped.npz")
    best.rename(tmp_path / "stopped.npz")
    again = learned(scores[2:], tmp_path / "stopped.npz")
    assert again | {"seconds": 0} == whole | {"seconds": 0}
    one, other = (dict(np.load(tmp_path / f"{name}.npz")) for name in ("whole", "stopped"))
    assert all(np.array_equal(one[name], other[name]) for name in one)


@pytest.fixture(scope="module")
def mazes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An export of two episodes of `ball_maze` that were soon over."""
    folder = tmp_path_factory.mktemp("mazes")
    env = Recorder(duobench.make("ball_maze", cameras=False), folder / "demos", Actor(name="me"))
    for seed in range(2):
        observation, _ = env.reset(seed=seed)
        for _ in range(4):
            observation, *_ = env.step(observation["agent_pos"])
    env.close()
    run("export", "lerobot", "demos", "--out", "out", "--keep-failures", *EXPORT, folder=folder)
    return folder / "out" / "ball_maze"


@pytest.mark.slow
@pytest.mark.usefixtures("unplayed")
@pytest.mark.parametrize("kind", ["nearest", "network"])
def test_how_fast_things_move_is_neither_shown_nor_asked(
    kind: str, mazes: Path, tmp_path: Path
) -> None:
    import eleven  # pyright: ignore[reportMissingImports]
    from demonstrations import Demonstrations  # pyright: ignore[reportMissingImports]

    data = Demonstrations.load(mazes)
    moves = [n for n, name in enumerate(NAMES) if "_velocity_" in name]
    assert len(moves) == 3
    assert data.names == tuple(np.delete(NAMES, moves))
    if kind == "nearest":
        eleven.keep(data, tmp_path / "acts.npz")
    else:
        pytest.importorskip("torch", reason="PyTorch is not installed here: make test-lerobot")
        import network  # pyright: ignore[reportMissingImports]

        network.train(data, "ball_maze", tmp_path / "acts.npz", 0, brief(1))
    policy = eleven.read(tmp_path / "acts.npz")
    env = duobench.make("ball_maze", cameras=False, object_state=True)
    seen = env.reset(seed=2)[0]
    chunks = []
    for speed in (0.0, 1.0):
        seen["environment_state"][moves] = speed  # an environment tells it nevertheless
        policy.reset("", 0)
        chunks.append(policy.act(seen))
    assert chunks[0].shape == (30, 16)
    assert np.array_equal(*chunks)


@pytest.mark.slow
@pytest.mark.usefixtures("example", "checkpoint")
def test_networks_are_told_apart_on_layouts_of_their_own() -> None:
    import own_play  # pyright: ignore[reportMissingImports]
    from nearest import Nearest  # pyright: ignore[reportMissingImports]

    begun: list[np.ndarray | None] = []

    class Played(Nearest):
        def reset(self, instruction: str, seed: int) -> None:
            begun.append(None)
            super().reset(instruction, seed)

        def act(self, observation: Any) -> np.ndarray:
            if begun[-1] is None:
                begun[-1] = observation["environment_state"].copy()
            return super().act(observation)

    trial = own_play.Trial(TASK, 2)
    first = trial.score(Played())
    assert 0 <= first[0] <= 2
    assert first[0] / 2 <= first[1] <= 1
    assert trial.score(Played()) == first
    env = duobench.make(TASK, cameras=False, object_state=True, split=TRAIN)
    seeds = [episode_seed(TASK, number, TRAIN) for number in (20_000, 20_001)]
    layouts = [env.reset(seed=seed)[0]["environment_state"] for seed in seeds]
    assert np.array_equal(begun, [*layouts, *layouts])
    other = own_play.Trial(TASK, 1, "franka_hand")
    other.score(Played())
    assert other._env.get_wrapper_attr("config").gripper == "franka_hand"


def options(exports: Path, folder: Path, **words: object) -> SimpleNamespace:
    """What the table is asked by its command line."""
    usual: dict[str, object] = {"export": exports, "out": folder / "runs", "demonstrations": 2}
    usual |= {"results": folder / "results", "until": "end", "episodes": 1, "device": "cpu"}
    usual |= {"images": None, "self_imitation": None, "corrections": None, "tasks": [TASK]}
    return SimpleNamespace(**usual | {"seeds": 1, "workers": 1} | words)


@pytest.mark.slow
@pytest.mark.usefixtures("unplayed", "checkpoint")
def test_a_network_knows_the_gripper_that_it_learned_with(
    exports: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("torch", reason="PyTorch is not installed here: make test-lerobot")
    import eleven  # pyright: ignore[reportMissingImports]
    import network  # pyright: ignore[reportMissingImports]
    import own_play  # pyright: ignore[reportMissingImports]
    import table  # pyright: ignore[reportMissingImports]
    from demonstrations import Demonstrations  # pyright: ignore[reportMissingImports]

    tried: list[str] = []
    monkeypatch.setattr(
        own_play.Trial, "score", lambda trial, _: (tried.append(trial.gripper) or 0, 0.5)
    )
    shutil.copytree(exports / TASK, tmp_path / TASK)
    about = tmp_path / TASK / "meta" / "duobench.json"
    about.write_text(json.dumps(json.loads(about.read_text()) | {"robot": "franka_hand"}))
    data = Demonstrations.load(tmp_path / TASK)
    assert Demonstrations.load(exports / TASK).gripper == "robotiq_2f85"
    assert (data + data).gripper == "franka_hand"
    network.train(data, TASK, tmp_path / "net.npz", 0, brief(2))
    assert tried == ["franka_hand"]
    eleven.keep(data, tmp_path / "nearest.npz")
    nearest, played = (eleven.read(tmp_path / f"{name}.npz") for name in ("nearest", "net"))
    assert nearest._data.gripper == "franka_hand"
    assert played._robot == robot_with("franka_hand")
    assert {one.metadata.robot for one in (nearest, played)} == {"franka_hand"}
    monkeypatch.setenv("GRIPPER", "robotiq_2f85")
    assert network.Network(tmp_path / "net.npz")._robot == robot_with("robotiq_2f85")
    monkeypatch.delenv("GRIPPER")

    def evaluate(_policy: str, suite: Any, _folder: Any) -> None:
        raise DataError(f"evaluated with {suite.gripper}")

    def record(*_: object, gripper: str, **__: object) -> None:
        raise DataError(f"recorded with {gripper}")

    short = brief(2)
    monkeypatch.setattr(network, "Training", lambda device: replace(short, device=device))
    monkeypatch.setattr(table, "evaluate", evaluate)
    monkeypatch.setattr(own_play, "record", record)
    with pytest.raises(DataError, match="evaluated with franka_hand"):
        table.job(options(tmp_path, tmp_path), TASK, 0)
    with pytest.raises(DataError, match="recorded with franka_hand"):
        table.job(options(tmp_path, tmp_path, self_imitation=1), TASK, 0)


@pytest.mark.slow
@pytest.mark.usefixtures("unplayed", "checkpoint")
def test_the_table_goes_on_where_it_was_stopped(
    exports: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("torch", reason="PyTorch is not installed here: make test-lerobot")
    import network  # pyright: ignore[reportMissingImports]
    import table  # pyright: ignore[reportMissingImports]

    short = brief(2)
    monkeypatch.setattr(network, "Training", lambda device="cpu": replace(short, device=device))
    monkeypatch.chdir(EXAMPLES)
    asked = options(exports, tmp_path)
    for seed in range(2):
        assert "of 1" in table.job(asked, TASK, seed)
    assert "is there" in table.job(asked, TASK, 0)
    with pytest.raises(OtherRunError, match=r"is of episodes 1, and this is of 2: name another"):
        table.job(options(exports, tmp_path, episodes=2), TASK, 0)
    (tmp_path / "results" / "2" / f"{TASK}-1.json").unlink()
    monkeypatch.setattr(network, "train", lambda *_: pytest.fail("trained again"))
    assert "of 1" in table.job(asked, TASK, 1)
    rows = list(table.table(asked.results, table.setting(asked)))
    assert rows[2].startswith(f"| `{TASK}` | ")
    told = json.loads(table.result(asked, TASK, 0).read_text())
    assert told["training"]["recipe"]["every"] == 2
    assert told["training"]["checkpoint"] == told["checkpoint"]
    rows = list(table.failures(asked.results, table.setting(asked)))
    assert rows[2].startswith(f"| `{TASK}` | 2 | ")
    other = replace(table.shown(asked, TASK), gripper="franka_hand")
    with monkeypatch.context() as patch:
        patch.setattr(table, "shown", lambda *_: other)
        with pytest.raises(OtherRunError, match="on other demonstrations: name another --out"):
            table.trained(asked, TASK, 0)
    short = brief(3)
    with pytest.raises(OtherRunError, match=r"the recipe .*'every': 2.* name another --out"):
        table.trained(asked, TASK, 0)


@pytest.mark.slow
@pytest.mark.usefixtures("example", "checkpoint")
def test_what_a_policy_achieved_is_there_to_be_learned_from(
    exports: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import own_play  # pyright: ignore[reportMissingImports]
    from demonstrations import Demonstrations  # pyright: ignore[reportMissingImports]

    monkeypatch.setattr(own_play, "LEARNED", 1)  # which is among those that were shown
    shown = Demonstrations.load(exports / TASK)
    monkeypatch.chdir(EXAMPLES)
    own, told = own_play.practise("nearest:Nearest", TASK, tmp_path, 1)
    assert told["successes"] == told["played"] == 1
    (path,) = DataSet.open(tmp_path / "episodes").episodes()
    assert Recording.read_info(path).seed == episode_seed(TASK, 1, TRAIN)
    assert len(own.lengths) == 1
    assert own.names == shown.names
    again, _ = own_play.practise("nearest:Nearest", TASK, tmp_path, 1)
    assert np.array_equal(own.labels, again.labels)
    with pytest.raises(DataError, match=r"`gripper` differs: 'robotiq_2f85' and 'franka_hand'"):
        shown + replace(own, gripper="franka_hand")
    with pytest.raises(DataError, match="export both with --action cartesian"):
        shown + replace(own, labels=own.labels[:, :16])
    with pytest.raises(UnknownNameError, match="Did you mean 'carry_pot'"):
        own_play.Trial("cary_pot", 1)
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
    import own_play  # pyright: ignore[reportMissingImports]
    import table  # pyright: ignore[reportMissingImports]

    learned, rows, played = [], [], []

    def train(data: Any, _task: str, out: Path, seed: int, how: Any) -> dict[str, Any]:
        learned.append(len(data.lengths))
        rows.append(len(data.state))
        out.write_bytes(bytes([len(learned)]))
        return {"recipe": asdict(how) | {"seed": seed}, "seconds": 1, "kept": len(learned)}

    def by_nearest(policy: str, task: str, folder: Path, count: int, gripper: str) -> Any:
        played.append((policy, os.environ["CHECKPOINT"]))
        os.environ["CHECKPOINT"] = str(exports / TASK)
        return own_play.practise("nearest:Nearest", task, folder, count, gripper)

    monkeypatch.chdir(EXAMPLES)
    monkeypatch.setattr(network, "train", train)
    monkeypatch.setattr(table, "practise", by_nearest)
    monkeypatch.setattr(own_play, "LEARNED", 0)  # which was shown
    asked = options(exports, tmp_path, self_imitation=1)
    checkpoint, told = table.trained(asked, TASK, 0)
    first = tmp_path / "runs" / "2" / TASK / "0.npz"
    assert played == [("network:Network", str(first))]
    assert learned == [2, 3]
    assert [told["first"]["rows"], told["rows"]] == rows
    assert told["played"] >= told["successes"] == 1
    assert told["kept"] == 2  # steps of the network
    assert told["first"]["checkpoint"] == hashlib.sha256(first.read_bytes()).hexdigest()[:16]
    assert table._minutes(told | {"seconds": 90}) == "0 + 2"
    assert table.setting(asked) == "2-self-1"
    assert table.trained(asked, TASK, 0) == (checkpoint, told)
    assert learned == [2, 3]


@pytest.mark.slow
@pytest.mark.usefixtures("example", "checkpoint")
def test_minutes_of_what_came_first_are_told_apart(
    exports: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("torch", reason="PyTorch is not installed here: make test-lerobot")
    import learning  # pyright: ignore[reportMissingImports]
    import network  # pyright: ignore[reportMissingImports]
    import table  # pyright: ignore[reportMissingImports]
    import train_images  # pyright: ignore[reportMissingImports]

    spent = [0.0]
    asked = options(exports, tmp_path, images=tmp_path)
    recipe = {"recipe": asdict(table.recipe_of(asked)) | {"seed": 0}}
    first = {"recipe": asdict(network.Training()) | {"seed": 0}}

    def acts(_data: object, _task: str, out: Path, *_: object) -> dict[str, int]:
        spent[0] += 60
        out.write_bytes(b"acts")
        return first | {"seconds": 60}

    def shown(*_: object) -> None:
        spent[0] += 120

    def sees(_acts: Path, _data: Any, _shown: None, _task: str, out: Path, *_: Any) -> Any:
        spent[0] += 180
        out.write_bytes(b"sees")
        return recipe | {"seconds": 180 + 40}  # which were spent before it was stopped

    monkeypatch.setattr(network, "train", acts)
    monkeypatch.setattr(train_images, "see", shown)
    monkeypatch.setattr(train_images, "train", sees)
    for module in (learning, table):
        monkeypatch.setattr(module, "processor_seconds", lambda: spent[0])
    _, told = table.trained(asked, TASK, 0)
    assert (told["first"]["seconds"], told["seconds"]) == (60, 340)
    assert table._minutes(told) == "1 + 6"


@pytest.mark.usefixtures("example")
def test_the_interval_holds_the_spread_of_the_seeds() -> None:
    from table import interval  # pyright: ignore[reportMissingImports]

    alike, apart = interval([0.5, 0.5, 0.5], 100), interval([0.2, 0.5, 0.8], 100)
    assert alike == wilson_interval(50, 100)
    assert apart[0] < 0.25
    assert apart[1] > 0.75
    assert interval([1.0, 1.0], 100)[0] > 0.95


@pytest.mark.usefixtures("example")
def test_settings_stand_beside_each_other_with_what_they_learned_from(tmp_path: Path) -> None:
    import table  # pyright: ignore[reportMissingImports]

    for setting, seed, successes, rows in (("10", 0, 4, 90), ("10", 1, 5, 90), ("60", 0, 9, 1540)):
        told = {"task": TASK, "suite": SUITE_VERSION, "episodes": 10, "successes": successes}
        told |= {"progress": 0.5, "last_stages": [10 - successes, successes]}
        told |= {"training": {"seconds": 60 * (seed + 1), "rows": rows}}
        file = tmp_path / setting / f"{TASK}-{seed}.json"
        file.parent.mkdir(exist_ok=True)
        file.write_text(json.dumps(told))
    called = {"10": "10 shown", "10-corrections": "none yet", "60": "60 shown"}
    head, _, few, many = table.compared(tmp_path, TASK, called)
    assert head.startswith("| learned from | success (95 %) |")
    assert few.startswith("| 10 shown (90 rows) | 45 (")
    assert few.endswith("| 40, 50 | 0.50 | 11, 9 | 1, 2 |")
    assert many.startswith("| 60 shown (1,540 rows) | 90 (")


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


@pytest.mark.slow
@pytest.mark.usefixtures("example", "checkpoint")
def test_a_table_ends_with_what_is_wrong_and_does_not_go_on(
    exports: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import table  # pyright: ignore[reportMissingImports]

    monkeypatch.setattr(table, "job", refuse_the_first)
    asked = options(exports, tmp_path, seeds=9, out=tmp_path)
    with pytest.raises(DataError, match="is wrong"):
        table.run(asked)
    assert not list(tmp_path.glob("*.done"))


def refuse_the_first(asked: Any, _task: str, seed: int) -> str:
    if seed == 0:
        raise DataError("It is wrong.")
    time.sleep(5)
    (asked.out / f"{seed}.done").touch()
    return ""


def kill_this_process(*_: object) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.slow
@pytest.mark.usefixtures("unplayed", "checkpoint")
def test_pictures_are_of_demonstrations_of_layouts_at_rest_and_of_play(
    exports: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("torch", reason="PyTorch is not installed here: make test-lerobot")
    import network  # pyright: ignore[reportMissingImports]
    import pictures  # pyright: ignore[reportMissingImports]
    import sight  # pyright: ignore[reportMissingImports]
    import train_images  # pyright: ignore[reportMissingImports]
    from demonstrations import Demonstrations  # pyright: ignore[reportMissingImports]
    from frames import places_in  # pyright: ignore[reportMissingImports]

    monkeypatch.setattr(pictures, "HELD_OUT", 2)
    data, demos = Demonstrations.load(exports / TASK), exports.with_name("demos")
    acts = tmp_path / "acts.npz"
    network.train(data, TASK, acts, 0, brief(1))
    how = train_images.Training(layouts=4, played=2)
    now = data.state[0], data.objects[0]
    told = []
    noisy = [train_images._WithNoise(acts) for _ in range(2)]
    for policy in (network.Network(acts), *noisy):
        policy.reset("", 0)
        told.append(policy.plan(*now))
    assert np.abs(told[1] - told[0]).max() > 1e-4  # it has noise, alike every time
    assert np.array_equal(told[1], told[2])
    other = replace(data, state=data.state + 0.1)
    with pytest.raises(DataError, match=r"Episode 0 of .* is not that of the export"):
        train_images.see(acts, demos, TASK, other, how)
    seen = train_images.see(acts, demos, TASK, data, how)
    of_episodes = [-(-length // pictures.EVERY) for length in data.lengths.tolist()]
    rows = sum(of_episodes)
    played = -(-catalog.get(TASK).horizon // pictures.EVERY)  # it succeeds in none
    shapes = [(rows + 4 + 2 * played, *size, 3) for size in sight.SIZES.values()]
    assert [one.shape for one in seen.images] == shapes
    held = [False, True] * 3
    held = np.repeat(held, [*of_episodes, 2, 2, played, played])
    assert np.array_equal(seen.held_out, held)
    for first in (rows + 4, rows + 4 + played):
        assert np.allclose(seen.state[first], data.state[0], atol=1e-3)
        assert np.abs(seen.state[first + played - 1] - seen.state[first]).max() > 0.1
        before = range(0, pictures.EVERY * played, pictures.EVERY)
        assert seen.row[first : first + played].tolist() == [*before]
    assert np.abs(np.diff(seen.objects[[rows + 4, rows + 4 + played]], axis=0)).max() > 1e-3
    there = np.stack([seen.objects[:, part] for part in places_in(data.names)], axis=1)
    away = np.linalg.norm(seen.window_places - there, axis=-1)
    assert 0.001 < np.median(away) < 0.05  # windows lie about there
    assert seen.near.shape[:3] == (len(away), len(sight.SIZES), away.shape[1])
    last = of_episodes[0] - 1
    assert np.array_equal(seen.objects[0], data.objects[0])
    off = seen.objects[last, :3] - data.objects[pictures.EVERY * last, :3]
    assert 1e-5 < np.abs(off).max() < 0.02  # it was carried, and is rendered elsewhere
    for rest in (0, 2):  # with their hands at home, and with those of a demonstration
        home, moved = seen.state[rows + rest : rows + rest + 2]
        assert seen.row[rows + rest :].tolist()[:2] == [0, pictures.UNDER_OTHER_ARMS]
        assert np.allclose(home, data.state[0], atol=1e-3)
        shown = np.abs(data.state - moved)[:, np.arange(16) % 8 != 7]
        assert shown.max(axis=1).min() < 1e-6
        assert moved[[7, 15]].tolist() == [1.0, 1.0]


@pytest.mark.slow
@pytest.mark.usefixtures("unplayed", "checkpoint")
def test_pictures_of_play_are_of_the_hand_that_demonstrations_had(
    exports: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("torch", reason="PyTorch is not installed here: make test-lerobot")
    import pictures  # pyright: ignore[reportMissingImports]
    from demonstrations import Demonstrations  # pyright: ignore[reportMissingImports]
    from nearest import Nearest  # pyright: ignore[reportMissingImports]

    make, hands = duobench.make, []

    def made(task: str, **options: Any) -> Any:
        hands.append(options["gripper"])
        return make(task, **options)

    monkeypatch.setattr(duobench, "make", made)
    data = replace(Demonstrations.load(exports / TASK), gripper="franka_hand")
    pictures.in_play(Nearest(), TASK, data, 1)
    pictures.at_rest(TASK, data, 1)
    assert hands == ["franka_hand", "franka_hand"]


@pytest.mark.usefixtures("example")
def test_what_is_held_is_rendered_elsewhere_and_what_lies_still_is_not() -> None:
    pytest.importorskip("torch", reason="PyTorch is not installed here: make test-lerobot")
    import pictures  # pyright: ignore[reportMissingImports]

    definition = catalog.get(TASK)
    env = duobench.make(TASK, cameras=False, object_state=True, split="train")
    simulation = env.get_wrapper_attr("simulation")
    names = definition.object_state.names
    first = env.reset(seed=0)[0]["environment_state"].astype(np.float32)
    pot, stove = (simulation.pose(body) for body in ("pot", "stove"))
    away = first.copy()
    away[names.index("pot_z")] += 0.05
    rng = np.random.default_rng(0)
    moved = [
        pictures._otherwise(simulation, objects, first, names, rng)
        for objects in [first] + 20 * [away]
    ]
    assert np.array_equal(moved[0], first)
    off = np.linalg.norm(np.stack(moved[1:])[:, :3] - away[:3], axis=1)
    assert 0.001 < np.median(off) < 0.006
    assert off.max() < 0.02
    now = simulation.pose("pot")
    assert np.allclose(now.translation, moved[-1][:3], atol=1e-6)
    x, z = (names.index(f"pot_{axis}_axis_x") for axis in "xz")
    assert np.allclose(now.rotation[:, 0], moved[-1][x : x + 3], atol=1e-4)
    assert np.allclose(now.rotation[:, 2], moved[-1][z : z + 3], atol=1e-4)
    assert 0.05 < degrees_off(now.rotation, pot.rotation) < 15
    assert np.array_equal(simulation.pose("stove").translation, stove.translation)
    ball = (*POINTED, "cube_z_axis_x")
    assert pictures._otherwise(simulation, away, first, ball, rng) is away


@pytest.mark.slow
@pytest.mark.usefixtures("unplayed")
def test_what_a_layout_chose_is_learned_and_told_as_most_looks_read_it(
    mazes: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("torch", reason="PyTorch is not installed here: make test-lerobot")
    import images  # pyright: ignore[reportMissingImports]
    import network  # pyright: ignore[reportMissingImports]
    import pictures  # pyright: ignore[reportMissingImports]
    import train_images  # pyright: ignore[reportMissingImports]
    from demonstrations import Demonstrations  # pyright: ignore[reportMissingImports]

    monkeypatch.setattr(pictures, "HELD_OUT", 2)
    data = Demonstrations.load(mazes)
    acts, sees = (tmp_path / f"{name}.npz" for name in ("acts", "sees"))
    network.train(data, "ball_maze", acts, 0, brief(1))
    shown = pictures.at_rest("ball_maze", data, 4)
    how = train_images.Training(batch=2, closer=2, every=2, most=2)
    told = train_images.train(acts, data, shown, "ball_maze", sees, 0, how)
    assert 0 <= told["read_right"] <= 1
    rows = train_images._Rows(data, shown, "cpu")
    assert shown.held_out.any()
    assert not shown.held_out[rows.drawn(100)].any()
    losses = rows.losses(rows.sight(), rows.learned[:1], rows.learned[:1])
    assert set(losses) == {"pixels", "windows", "axes", "others", "read"}
    assert all(loss.item() > 0 for loss in losses.values())

    policy, planned = images.Images(sees), []
    env = duobench.make("ball_maze", **needed_options(policy.metadata))
    seen = env.reset(seed=0)[0]
    known = policy.look(
        [torch_image(seen, camera) for camera in POLICY_CAMERAS], seen["agent_pos"][None]
    )
    for read in (0.4, 0.9, 0.4, 0.1):  # of a wall, look by look
        objects = known.copy()
        objects[:, policy._chosen] = read
        monkeypatch.setattr(policy, "look", lambda *_, objects=objects: objects)
        monkeypatch.setattr(policy, "plan", lambda _, told: planned.append(told))
        policy.act(seen)
    walls = [told[policy._chosen].tolist() for told in planned]
    assert walls == [[one] * len(policy._chosen) for one in (0, 1, 1, 0)]
    policy.reset("", 0)
    objects[:, policy._chosen] = 0.9
    policy.act(seen)
    assert planned[-1][policy._chosen].all()  # earlier episodes do not count


def torch_image(seen: Any, camera: str) -> Any:
    """An image of one camera as a network takes it (1, 3, height, width)."""
    import torch

    return torch.from_numpy(seen["pixels"][camera].transpose(2, 0, 1))[None]


def acts_on_what_it_sees(
    policy: Any, demos: Path, data: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Play a network on the first image that it has learned from."""
    import frames  # pyright: ignore[reportMissingImports]
    import images  # pyright: ignore[reportMissingImports]

    (path, _) = DataSet.open(demos).episodes()
    env = duobench.make(TASK, split="train", **needed_options(policy.metadata))
    seen, _ = env.reset(seed=Recording.read_info(path).seed)
    played = policy.act(seen)
    assert played.shape == (30, 16)
    elsewhere = 0.1 + policy._tracks._mean.places, policy._tracks._mean.turns
    policy.reset("", 0)
    monkeypatch.setattr(policy._tracks, "follow", lambda _: elsewhere)
    assert np.abs(policy.act(seen) - played).max() > 1e-3
    pixels = [torch_image(seen, camera) for camera in POLICY_CAMERAS]
    found = policy.look(pixels, seen["agent_pos"][None])[0]
    for body in frames.bodies(data.names):  # it has learned from these images
        x = data.names.index(f"{body}_x")
        assert np.linalg.norm(found[x : x + 3] - data.objects[0, x : x + 3]) < 0.02
    monkeypatch.setattr(images, "LOOKS", 0)  # as it is found without windows
    (far,) = policy.look(pixels, seen["agent_pos"][None])
    assert np.abs(far[:3] - found[:3]).max() > 1e-5


@pytest.mark.long
@pytest.mark.usefixtures("unplayed", "checkpoint")
def test_a_network_that_sees_images_is_trained_and_played(
    exports: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("torch", reason="PyTorch is not installed here: make test-lerobot")
    import images  # pyright: ignore[reportMissingImports]
    import network  # pyright: ignore[reportMissingImports]
    import pictures  # pyright: ignore[reportMissingImports]
    import table  # pyright: ignore[reportMissingImports]
    import train_images  # pyright: ignore[reportMissingImports]
    from demonstrations import Demonstrations  # pyright: ignore[reportMissingImports]

    monkeypatch.chdir(EXAMPLES)
    monkeypatch.setattr(pictures, "HELD_OUT", 2)
    data, demos = Demonstrations.load(exports / TASK), exports.with_name("demos")
    short = brief(2)
    monkeypatch.setattr(network, "Training", lambda device: replace(short, device=device))
    longer = train_images.Training(batch=16, every=100, most=100, layouts=4, played=2)
    monkeypatch.setattr(train_images, "Training", lambda device: replace(longer, device=device))
    asked = options(exports, tmp_path, images=demos)
    assert "of 1" in table.job(asked, TASK, 0)
    told = json.loads(table.result(asked, TASK, 0).read_text())["training"]
    assert table.setting(asked) == "2-images"
    acts, sees = (tmp_path / f"runs/{what}/{TASK}/0.npz" for what in ("2", "2-images"))
    acted = hashlib.sha256(acts.read_bytes()).hexdigest()
    assert acted.startswith(told["first"]["checkpoint"])
    assert told["first"]["kept"] == 2
    assert told["kept"] == longer.every
    every, first, mean = told["off_mm"]["pot"]
    assert max(every, first) < mean  # in an episode that it did not learn from
    policy = images.Images(sees)
    assert not policy.metadata.object_state
    policy.reset("", 0)
    acts_on_what_it_sees(policy, demos, data, monkeypatch)
    with pytest.raises(DataError, match="of another task"):
        train_images.check(acts, replace(data, names=("x",)))
    monkeypatch.setenv("CHECKPOINT", str(acts))
    with pytest.raises(PolicyError, match="sees no images"):
        images.Images()
    with pytest.raises(PolicyError, match=r"sees images: play it as images:Images"):
        network.Network(sees)
    parts = dict(np.load(sees))
    np.savez(tmp_path / "old.npz", **{k: parts[k] for k in parts if k != "sight.o_mean"})
    with pytest.raises(PolicyError, match="as in an earlier state of this example"):
        images.Images(tmp_path / "old.npz")


@pytest.mark.usefixtures("example")
def test_what_is_seen_is_of_a_kind() -> None:
    pytest.importorskip("torch", reason="PyTorch is not installed here: make test-lerobot")
    from demonstrations import Demonstrations  # pyright: ignore[reportMissingImports]
    from visible import Kinds  # pyright: ignore[reportMissingImports]

    names = tuple(name for name in NAMES if "_velocity_" not in name)
    rng = np.random.default_rng(0)
    objects = rng.random((6, len(names)), dtype=np.float32)
    chosen = [n for n, name in enumerate(names) if name.startswith(("wall", "start", "goal"))]
    first = rng.permuted(np.tile([[0], [1]], len(chosen)), axis=0)
    objects[:, chosen] = np.repeat(first, 3, axis=0)
    state, labels = np.zeros((6, 16), np.float32), np.zeros((6, 20), np.float32)
    kinds = Kinds.of(Demonstrations(state, objects, labels, np.array([3, 3]), names))
    assert [names[part.start] for part in kinds.places] == ["board_x", "ball_x"]
    assert [names[part.start] for part in kinds.axes] == ["board_x_axis_x", "board_z_axis_x"]
    assert kinds.chosen == chosen
    assert kinds.others == [*range(len(names), len(names) + 4)]


POINTED = ("cube_x", "cube_y", "cube_z", "cube_x_axis_x", "ball_x", "ball_y", "ball_z")
"""Of what `rays.Points` asks: a cube with axes, and a ball without."""


def looked_at(places: np.ndarray, turns: np.ndarray) -> Any:
    """Exact rays of three cameras to the points of a cube and a ball (T, 2, 3)."""
    from rays import Points, Rays  # pyright: ignore[reportMissingImports]

    at = Points.of(POINTED).at(places, turns)
    cameras = np.array([[0.0, 0.0, 1.0], [0.7, -0.4, 0.3], [0.2, 0.6, 0.4]])
    ways = at[:, None] - cameras[:, None]
    ways /= np.linalg.norm(ways, axis=-1, keepdims=True)
    sharpness = np.full(ways.shape[:3], 1e4)
    return Rays(np.tile(cameras, (len(places), 1, 1)), ways, sharpness)


def degrees_off(turns: np.ndarray, true: np.ndarray) -> np.ndarray:
    cosine = (np.einsum("...ij,...ij->...", turns, true) - 1) / 2
    return np.degrees(np.arccos(cosine.clip(-1, 1)))


@pytest.mark.usefixtures("example")
def test_rays_meet_in_poses_and_an_object_that_none_sees_stays_beside_the_others() -> None:
    from rays import Points, Usual, meet  # pyright: ignore[reportMissingImports]

    rng = np.random.default_rng(0)
    points = Points.of(POINTED)
    assert points.things.tolist() == [0] * 7 + [1]
    assert np.isclose(points.shares().sum(), 1)
    assert np.isclose(points.shares()[7], 0.5)
    cubes = rng.normal([0.5, 0.0, 0.05], 0.1, size=(100, 3))
    turns = np.tile(np.eye(3), (100, 2, 1, 1))
    turns[:, 0] = [rotation_about((0, 0, 1), angle) for angle in rng.uniform(-0.8, 0.8, 100)]
    slides = 0.1 + rng.normal(scale=0.03, size=(100, 1))  # along an axis of the cube
    usual = Usual.of(points, np.stack([cubes, cubes + slides * turns[:, 0, :, 1]], axis=1), turns)
    cubes, turns = cubes[:8], turns[:8]
    beside = cubes + slides.mean() * turns[:, 0, :, 1]
    places = np.stack([cubes, beside + rng.normal(scale=0.02, size=(8, 3))], axis=1)
    aside = [rotation_about(axis, np.radians(20)) for axis in rng.normal(size=(8, 3))]
    guess = turns.copy()
    guess[:, 0] = np.array(aside) @ turns[:, 0]
    found, turned = meet(looked_at(places, turns), points, usual, guess)
    assert np.abs(found - places).max() < 1e-4
    assert degrees_off(turned, turns)[:, 0].max() < 0.1

    blind = looked_at(places, turns)  # maps of what is not in an image
    blind.sharpness[:, 2] = 2.0
    blind.origins[:, 2] = usual.mean[-1, 0]  # a hand is there
    blind.ways[:, 2] = -blind.ways[:, 2, ::-1]
    found, turned = meet(blind, points, usual, guess)
    assert np.abs(found - places).max() < 1e-4
    assert degrees_off(turned, turns)[:, 0].max() < 0.1

    plain = looked_at(places, turns)
    plain.sharpness[:, :, 1:7] = 1.0  # where ends of axes are is hardly seen
    _, turned = meet(plain, points, usual, guess)
    assert degrees_off(turned, guess)[:, 0].max() < 6.0  # of 20: the guess stands
    still = degrees_off(turned, guess)[:, 0]
    plain.sharpness[:, :, 1:7] = 150.0  # as sharp as windows are: what is seen counts a little
    _, turned = meet(plain, points, usual, guess)
    assert (degrees_off(turned, guess)[:, 0] > still + 1.0).all()
    assert (degrees_off(turned, turns)[:, 0] < 18.0).all()


@pytest.mark.usefixtures("example")
def test_objects_are_followed_where_they_lie_and_in_hands_that_hold_them() -> None:
    from frames import Frames  # pyright: ignore[reportMissingImports]
    from tracks import Tracks  # pyright: ignore[reportMissingImports]

    rng = np.random.default_rng(0)
    turns = np.tile(np.eye(3), (1, 5, 1, 1))
    positions = np.array(
        [[[0.4, 0.3, 0.4], [0.4, -0.3, 0.4], [0.4, 0.2, 0], [0.5, 0, 0], [0, 0, 0]]]
    )
    tracks, wrong, told = Tracks(np.ones(2, np.bool_)), [], []
    for look in range(40):
        if look >= 5:  # the left hand takes the first object along
            turned = rotation_about((0, 0, 1), 0.02)
            ways = positions[0, 2] - positions[0, 0]
            positions[0, 0] += (0.01, -0.01, 0.005)
            positions[0, 2] = positions[0, 0] + turned @ ways
            turns[0, [0, 2]] = turned @ turns[0, [0, 2]]
        seen, seen_turns = positions.copy(), turns.copy()
        seen[0, 2:4] += rng.normal(scale=1e-3, size=(2, 3))
        seen_turns[0, 2] = rotation_about((1, 0, 0), rng.normal(scale=0.01)) @ turns[0, 2]
        quarters = np.zeros((1, 5), np.int64)
        quarters[0, 3] = look % 5 == 4  # sometimes taken for another side
        places, found = tracks.follow(Frames(seen, seen_turns, quarters))
        wrong.append(np.linalg.norm(seen[0, 2:4] - positions[0, 2:4], axis=1))
        told.append(np.linalg.norm(places - positions[0, 2:4], axis=1))
        assert degrees_off(found, turns[0, 2:4]).max() < 2.5
    late = slice(10, None)
    assert np.mean(told[late], axis=0).max() < 0.5 * np.mean(wrong[late], axis=0).min()
    seen[0, 2] += (0.0, 0.03, 0.0)  # it slips out of the hand
    places, _ = tracks.follow(Frames(seen, seen_turns, quarters))
    assert np.allclose(places[0], seen[0, 2])
    assert np.linalg.norm(places[1] - positions[0, 3]) < 1e-3


@pytest.mark.usefixtures("example")
def test_a_ball_is_followed_in_a_hand_that_turns_and_is_told_unturned() -> None:
    from frames import Frames  # pyright: ignore[reportMissingImports]
    from tracks import Tracks  # pyright: ignore[reportMissingImports]

    rng = np.random.default_rng(0)
    tracks, wrong, told = Tracks(np.zeros(1, np.bool_)), [], []
    turns, quarters = np.tile(np.eye(3), (1, 4, 1, 1)), np.zeros((1, 4), np.int64)
    for look in range(40):
        turns[0, 0] = rotation_about((0, 0, 1), 0.2 * look)  # further than is believed at once
        ball = np.array([0.4, 0.3, 0.4]) + turns[0, 0] @ [0.05, 0.0, 0.1]
        seen = ball + rng.normal(scale=1e-3, size=3)
        positions = np.array([[[0.4, 0.3, 0.4], [0.4, -0.3, 0.4], seen, [0, 0, 0]]])
        places, found = tracks.follow(Frames(positions, turns.copy(), quarters))
        wrong.append(np.linalg.norm(seen - ball))
        told.append(np.linalg.norm(places[0] - ball))
        assert np.array_equal(found[0], np.eye(3))
    assert np.mean(told[10:]) < 0.6 * np.mean(wrong[10:])


@pytest.mark.usefixtures("example")
@pytest.mark.parametrize("gripper", GRIPPERS)
def test_rays_meet_where_an_object_is_and_patches_lie_on_it(gripper: str) -> None:
    torch = pytest.importorskip("torch", reason="PyTorch is not installed here: make test-lerobot")
    import sight  # pyright: ignore[reportMissingImports]
    from rays import Usual, meet  # pyright: ignore[reportMissingImports]

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

    pose = cube[None, None].double().numpy(), np.eye(3)[None, None]
    points = net.pixels(torch.from_numpy(net.points.at(*pose)).float(), cameras)
    spread = torch.zeros(1, len(net.points.things))
    pixels = [at for at, _ in points]
    pixels[2] = pixels[2] + 50.0
    far_from_sure = np.stack([np.zeros((3, 3)), np.eye(3)])[:, None]
    usual = Usual(np.zeros((2, 1, 3)), far_from_sure)  # the third does not see it
    rays = net.rays(pixels, [spread + 1.0, spread + 1.0, spread + 1e6], cameras.numpy())
    places, turns = meet(rays, net.points, usual, np.eye(3)[None, None])
    assert np.allclose(places[0, 0], cube, atol=1e-3)
    assert np.allclose(turns[0, 0], np.eye(3), atol=1e-2)

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
def test_windows_lie_around_objects_and_are_as_large_on_them() -> None:
    torch = pytest.importorskip("torch", reason="PyTorch is not installed here: make test-lerobot")
    import sight  # pyright: ignore[reportMissingImports]
    from windows import SPAN, Windows  # pyright: ignore[reportMissingImports]

    state = duobench.make("bin_sort", cameras=False).reset(seed=0)[0]["agent_pos"][None]
    cameras = torch.from_numpy(sight.places_of_cameras(state, robot_with("robotiq_2f85")))
    net = sight.Sight(
        ("cube_x", "cube_y", "cube_z"), {"o_mean": np.zeros(3), "o_scale": np.ones(3)}, []
    )
    cube, things = torch.tensor([0.5, 0.1, 0.02]), torch.tensor([0])
    about = cube + torch.tensor([0.01, -0.02, 0.005])
    windows = Windows.around(about[None, None], cameras)
    rendered = []  # of images that tell where their pixels are, of those that count
    for size in sight.rendered_sizes().values():
        lines = [(torch.arange(n) + 0.5) / sight.FINE - 0.5 for n in size[::-1]]
        rendered.append(torch.stack(torch.meshgrid(*lines, indexing="xy"))[None])
    there = torch.stack([at for at, _ in net.pixels(cube[None, None], cameras)], 1)
    inside = windows.inside(there, things)
    assert torch.allclose(windows.outside(inside, things), there, atol=1e-2)
    head = inside[0, 0, 0].round().long()
    seen = windows.cut(rendered)[0, 0, 0][:, head[1], head[0]]
    assert torch.allclose(seen, there[0, 0, 0], atol=1.0)
    assert not torch.allclose(seen, windows.centres[0, 0, 0], atol=2.0)
    ends = [about + SPAN / 2 * axis for axis in torch.eye(3)]
    far = [net.pixels(end[None, None], cameras)[0][0][0, 0] for end in ends]
    widest = max(float((end - windows.centres[0, 0, 0]).norm()) for end in far)
    half = float(windows.scale[0, 0, 0]) * sight.WINDOW / 2
    assert half < widest < 1.5 * half  # away from its axis a lens shows things larger


@pytest.mark.usefixtures("example")
@pytest.mark.parametrize("task", ["spring_door", "ball_maze"])
def test_what_is_seen_of_an_object_state_is_all_of_it(task: str) -> None:
    pytest.importorskip("torch", reason="PyTorch is not installed here: make test-lerobot")
    from frames import frames  # pyright: ignore[reportMissingImports]
    from visible import recognized, shown  # pyright: ignore[reportMissingImports]

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


@pytest.mark.long
@pytest.mark.usefixtures("example", "checkpoint")
def test_a_network_learns_from_what_a_person_led_and_not_from_what_failed(
    exports: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import network  # pyright: ignore[reportMissingImports]
    import table  # pyright: ignore[reportMissingImports]

    record(TASK, FROZEN, DataSet.open(tmp_path / "corrected"), 1)
    words = ("export", "lerobot", "corrected", "--out")
    run(*words, "all", *EXPORT, folder=tmp_path)
    run(*words, "led", *EXPORT, "--only-corrections", folder=tmp_path)
    shown = []

    def train(data: Any, _task: str, out: Path, seed: int, how: Any) -> dict[str, Any]:
        shown.append(data)
        out.write_bytes(b"")
        return {"recipe": asdict(how) | {"seed": seed}}

    monkeypatch.setattr(network, "train", train)
    asked = options(exports, tmp_path, corrections=tmp_path / "all")
    with pytest.raises(DataError, match=r"holds rows of the policy .* with --only-corrections"):
        table.run(asked)
    asked.corrections = tmp_path / "led"
    _, told = table.trained(asked, TASK, 0)
    asked.corrections = None
    table.trained(asked, TASK, 0)
    assert table.setting(asked) == "2"
    both, alone = shown
    (recording,) = DataSet.open(tmp_path / "corrected").recordings()
    led = np.flatnonzero(~recording.is_led_by_policy)
    assert both.recorded[len(alone.state) :].tolist() == led.tolist()
    assert np.array_equal(both.state[: len(alone.state)], alone.state)
    assert told["rows"] == len(both.state)
    assert (tmp_path / "runs/2-corrections" / TASK / "0.json").exists()
