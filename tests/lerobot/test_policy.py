"""Checkpoints of LeRobot as policies: small ones with random weights, saved by LeRobot itself."""

import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from lerobot.configs import FeatureType, PolicyFeature, PreTrainedConfig
from lerobot.envs.utils import preprocess_observation
from lerobot.policies import get_policy_class, make_pre_post_processors

from duobench import policy
from duobench.cli import main
from duobench.core.errors import DuoBenchError
from duobench.core.lerobot_keys import FEATURE_NAMES, LAST
from duobench.envs.action_labels import POSE_LABELS
from duobench.envs.state_labels import StatePart, names_of
from duobench.policy.batch import Batching, PolicyPool, SessionPolicy
from duobench.policy.lerobot_model import EpisodeNoise, LeRobotPolicy
from duobench.policy.policy import PolicyMetadata
from duobench.policy.registry import make_any
from duobench.results.bundle import read_source
from duobench.world.robot.mounts import HOME_JOINTS
from tests.lerobot import checkpoints
from tests.lerobot.checkpoints import CAMERAS, SIZE, change
from tests.lerobot.tools import HAS_GROOT, HERE, NEEDS_GROOT

INSTRUCTION = "Put the cube into the bowl"
SEED = 7
GROOT = pytest.param("groot", marks=NEEDS_GROOT)
NOISY = ("diffusion", GROOT, "pi05", "smolvla", "xvla")
KINDS = ("act", *NOISY)
ROUNDING = 1e-3
"""Batches are added up in another order, and noise starts at 1."""


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Path]]:
    root = tmp_path_factory.mktemp("checkpoints")
    with pytest.MonkeyPatch.context() as patch:
        checkpoints.shrink_pi05(patch, root)
        kinds = [kind for kind in KINDS if isinstance(kind, str)] + ["groot"] * HAS_GROOT
        yield {kind: getattr(checkpoints, kind)(root / kind) for kind in kinds}


def test_weights_that_pi05_fails_to_load_without_a_word_are_noticed(
    tmp_path: Path, folders: dict[str, Path]
) -> None:
    folder = shutil.copytree(folders["pi05"], tmp_path / "pi05")
    shutil.copy(folders["act"] / "model.safetensors", folder)
    with pytest.raises(DuoBenchError, match="weights of the model are not those of"):
        load(folder)


def load(folder: Path, query: str = "") -> LeRobotPolicy:
    made = make_any(f"lerobot:{folder}?device=cpu{query}")
    assert isinstance(made, LeRobotPolicy)
    return made


def observation(number: int) -> dict[str, Any]:
    generator = np.random.default_rng(number)
    shape = (SIZE, SIZE, 3)
    return {
        "agent_pos": generator.uniform(-1, 1, 16).astype(np.float32),
        "tcp_pose": generator.uniform(-1, 1, 14).astype(np.float32),
        "pixels": {name: generator.integers(0, 256, shape, dtype=np.uint8) for name in CAMERAS},
    }


def begun(made: LeRobotPolicy, seed: int = SEED) -> SessionPolicy:
    """A policy alone, whose episode has begun."""
    played = SessionPolicy(made, Batching(size=1))
    played.reset(INSTRUCTION, seed)
    return played


def chunk_of(made: LeRobotPolicy, seed: int = SEED, number: int = 0) -> np.ndarray:
    return np.asarray(begun(made, seed).act(observation(number)))


class Loop:
    """LeRobot's own loop: `select_action` at every step, with its processors."""

    def __init__(self, folder: Path, **changes: Any) -> None:
        config = PreTrainedConfig.from_pretrained(folder)
        for name, value in changes.items():
            setattr(config, name, value)
        self._policy = get_policy_class(config.type).from_pretrained(folder, config=config)
        self._before, self._after = make_pre_post_processors(config, pretrained_path=str(folder))
        self._policy.reset()

    def action(self, seen: dict[str, Any]) -> np.ndarray:
        images = {name: image[None] for name, image in seen["pixels"].items()}
        batch = preprocess_observation({"pixels": images, "agent_pos": seen["agent_pos"][None]})
        with torch.inference_mode():
            action = self._policy.select_action(self._before({**batch, "task": [INSTRUCTION]}))
        return self._after(action)[0].numpy()


class Samples:
    """Samples with torch whatever its seed is, as careless policies do."""

    metadata = PolicyMetadata(name="samples", cameras=())

    def reset(self, instruction: str, seed: int) -> None:
        """There is nothing to forget."""

    def act(self, observation: Any) -> np.ndarray:  # noqa: ARG002 - the protocol
        return torch.randn(1, 16).numpy()


def test_global_noise_of_torch_is_that_of_the_seed_whoever_plays_beside_it() -> None:
    alone, pool = PolicyPool(Samples(), Samples), PolicyPool(Samples(), Samples, size=2)
    session = alone.begin(INSTRUCTION, SEED)
    wanted = [alone.act_batch([session], [observation(0)])[0] for _ in range(3)]
    assert len({one.tobytes() for one in wanted}) == len(wanted)
    first, second = pool.begin(INSTRUCTION, SEED), pool.begin(INSTRUCTION, 2**64 - 1)
    for chunk in wanted:
        _, found = pool.act_batch([second, first], [observation(0)] * 2)
        np.testing.assert_array_equal(found, chunk)


def test_a_chunk_of_act_is_what_lerobots_loop_executes(folders: dict[str, Path]) -> None:
    loop = Loop(folders["act"])
    expected = [loop.action(observation(0)) for _ in range(30)]
    np.testing.assert_array_equal(chunk_of(load(folders["act"])), expected)
    np.testing.assert_array_equal(chunk_of(load(folders["act"], "&steps=10")), expected[:10])


def test_a_checkpoint_in_the_form_of_the_authors_plays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    left, right = HOME_JOINTS + np.array([[0.2], [0.0]])
    action = np.array([*left, 0.0, *right, 1.0])  # it closes the left gripper, and opens the right
    folder = checkpoints.act_as_the_authors(tmp_path / "act", action)
    made = load(folder)
    assert made.metadata.cameras == ("head", "left_wrist", "right_wrist")
    assert made.metadata.image_size == (224, 224)
    assert (made.metadata.action_mode, made.metadata.horizon) == ("joint", 30)
    monkeypatch.syspath_prepend(HERE)
    out, lines = tmp_path / "run", "--episodes 1 --workers 0 --videos 0 --tasks swing_task:TASK"
    play = ["eval", *lines.split(), "--policy", f"lerobot:{folder}?device=cpu"]
    main([*play, "--out", str(out)])
    _, (record,) = read_source(out)
    assert record.error is None
    assert record.final_stage > 0, "the left arm moved"
    sent = record.targets()
    assert sent is not None
    np.testing.assert_allclose(sent[-1], action, atol=0.02)
    assert set(sent[-1, [7, 15]].round(1)) == {0.0, 1.0}


@NEEDS_GROOT
def test_a_chunk_of_groot_is_what_lerobots_loop_executes(folders: dict[str, Path]) -> None:
    loop = Loop(folders["groot"])
    with EpisodeNoise([(SEED, 0)]):
        expected = [loop.action(observation(0)) for _ in range(30)]
    np.testing.assert_allclose(chunk_of(load(folders["groot"])), expected, atol=1e-6)


@NEEDS_GROOT
def test_groot_executes_as_many_actions_as_are_asked_for(folders: dict[str, Path]) -> None:
    for query, count in (("", 30), ("&steps=10", 10), ("&steps=40", 40)):
        assert chunk_of(load(folders["groot"], query)).shape == (count, 16)
    with pytest.raises(DuoBenchError, match="predicts 40 actions, not 41"):
        load(folders["groot"], "&steps=41")


def test_diffusion_sees_consecutive_observations_as_in_lerobots_loop(
    folders: dict[str, Path],
) -> None:
    folder, steps = folders["diffusion"], 8
    loop, played = Loop(folder, n_action_steps=steps), begun(load(folder, f"&steps={steps}"))
    executed: list[np.ndarray] = []
    while len(executed) < 3 * steps:
        executed.extend(np.asarray(played.act(observation(len(executed)))))
    expected = []
    for step in range(len(executed)):
        call = step // steps * 2  # each chunk is given in two answers
        with EpisodeNoise([(SEED, call)]):
            expected.append(loop.action(observation(step)))
    np.testing.assert_allclose(executed, expected, atol=1e-6)


@pytest.mark.parametrize("kind", NOISY)
def test_noise_follows_from_the_episode_and_the_call_alone(
    kind: str, folders: dict[str, Path]
) -> None:
    made = load(folders[kind])
    first = chunk_of(made)
    torch.rand(5)
    chunk_of(made, seed=SEED + 1)
    np.testing.assert_array_equal(chunk_of(made), first)
    assert not np.array_equal(chunk_of(made, seed=SEED + 1), first)
    session = made.begin(INSTRUCTION, SEED)
    session.call = 2
    (later,) = made.act_batch([session], [observation(0)])
    assert not np.array_equal(later, first)


@pytest.mark.parametrize("kind", KINDS)
def test_a_batch_answers_each_episode_as_if_it_were_alone(
    kind: str, folders: dict[str, Path]
) -> None:
    made = load(folders[kind])
    alone = [chunk_of(made, seed, seed) for seed in range(3)]
    order = [2, 0, 1]
    sessions = [made.begin(INSTRUCTION, seed) for seed in order]
    chunks = made.act_batch(sessions, [observation(seed) for seed in order])
    for seed, chunk in zip(order, chunks, strict=True):
        np.testing.assert_allclose(chunk, alone[seed], atol=ROUNDING)


def test_a_batch_may_hold_episodes_that_need_the_model_and_some_that_do_not(
    folders: dict[str, Path],
) -> None:
    made = load(folders["diffusion"])
    early, late = (made.begin(INSTRUCTION, seed) for seed in (1, 2))
    (first,) = made.act_batch([early], [observation(0)])
    early.call = 1
    single, chunk = made.act_batch([early, late], [observation(1), observation(0)])
    assert (len(first), len(single), len(chunk)) == (14, 1, 14)


def test_metadata_say_what_the_checkpoint_sees_and_what_decides_the_actions(
    tmp_path: Path,
) -> None:
    folder = checkpoints.act(tmp_path / "act")
    metadata = load(folder).metadata
    assert (metadata.cameras, metadata.image_size) == (CAMERAS, (SIZE, SIZE))
    version = metadata.version
    assert "float32 on cpu" in (version or "")
    (folder / "train_config.json").write_text("{}")
    assert load(folder).metadata.version == version
    assert load(folder, "&steps=10").metadata.version != version
    checkpoints.act(folder, latent_dim=8)
    assert load(folder).metadata.version != version


def test_cameras_that_were_renamed_for_training_are_shown_under_their_names(
    tmp_path: Path,
) -> None:
    names = tuple(f"camera{number}" for number in range(len(CAMERAS)))
    folder = checkpoints.act(tmp_path / "act", **checkpoints.features(names))
    before = folder / "policy_preprocessor.json"
    text, images = before.read_text(), "observation.images."
    renames = {images + old: images + new for old, new in zip(CAMERAS, names, strict=True)}
    assert '"rename_map": {}' in text
    before.write_text(text.replace('"rename_map": {}', f'"rename_map": {json.dumps(renames)}'))
    made = load(folder)
    assert made.metadata.cameras == CAMERAS
    assert np.isfinite(chunk_of(made)).all()


def test_objects_are_seen_as_numbers_and_names_say_what_actions_are(tmp_path: Path) -> None:
    objects = np.zeros(5, np.float32)
    features = checkpoints.features(cameras=())
    feature = PolicyFeature(FeatureType.ENV, objects.shape)
    features["input_features"]["observation.environment_state"] = feature
    feature = PolicyFeature(FeatureType.ACTION, (len(POSE_LABELS),))
    features["output_features"]["action"] = feature
    folder = checkpoints.act(tmp_path / "act", **features)
    (folder / FEATURE_NAMES).write_text(json.dumps({"action": POSE_LABELS}))
    made = load(folder)
    metadata = made.metadata
    assert (metadata.cameras, metadata.object_state) == ((), True)
    assert metadata.action_mode == "cartesian"
    played = begun(made)
    chunk = np.asarray(played.act({**observation(0), "environment_state": objects}))
    assert chunk.shape == (30, 16)
    lengths = np.linalg.norm(chunk.reshape(-1, 8)[:, 3:7], axis=1)
    np.testing.assert_allclose(lengths, 1.0, atol=1e-6)
    with pytest.raises(DuoBenchError, match="learned another task"):
        played.act({**observation(0), "environment_state": objects[1:]})


def test_tool_poses_are_shown_where_the_state_was_learned_with_them(tmp_path: Path) -> None:
    features = checkpoints.features(cameras=())
    names = names_of([StatePart.TCP_POSE])
    features["input_features"] |= {
        "observation.state": PolicyFeature(FeatureType.STATE, (len(names),)),
        "observation.environment_state": PolicyFeature(FeatureType.ENV, (5,)),
    }
    folder = checkpoints.act(tmp_path / "act", **features)
    with pytest.raises(DuoBenchError, match="tool poses may follow where"):
        load(folder)
    (folder / FEATURE_NAMES).write_text(json.dumps({"observation.state": names}))
    made, seen = load(folder), {**observation(0), "environment_state": np.zeros(5, np.float32)}
    prepared = made._before

    def note(batch: dict[str, Any]) -> Any:
        expected = np.concatenate([seen["agent_pos"], seen["tcp_pose"]])
        np.testing.assert_array_equal(batch["observation.state"].numpy(), expected[None])
        return prepared(batch)

    made._before = note
    chunk = np.asarray(begun(made).act(seen))
    seen["tcp_pose"] = seen["tcp_pose"] + 0.1
    assert not np.allclose(chunk, np.asarray(begun(made).act(seen)), atol=ROUNDING)


def test_weights_can_run_in_other_numbers(folders: dict[str, Path]) -> None:
    made = load(folders["xvla"], "&dtype=bfloat16")
    assert "bfloat16" in (made.metadata.version or "")
    assert np.isfinite(chunk_of(made)).all()


def test_policy_with_domain_ids_is_told_where_it_plays(tmp_path: Path) -> None:
    folder = checkpoints.xvla(tmp_path / "xvla", domain_feature_key="domain")
    simulated, real = load(folder), load(folder, "&domain=real")
    assert "domain real" in (real.metadata.version or "")
    seen: list[list[int]] = []
    for made in (simulated, real):
        asked = made._model._get_domain_id

        def note(*words: Any, asked: Callable[..., torch.Tensor] = asked) -> torch.Tensor:
            seen.append(asked(*words).tolist())
            return asked(*words)

        made._model._get_domain_id = note
    chunks = [chunk_of(made) for made in (simulated, real)]
    assert seen == [[0], [1]]
    assert not np.allclose(*chunks, atol=ROUNDING)
    plain = checkpoints.xvla(tmp_path / "plain")
    without = [chunk_of(load(plain, query)) for query in ("", "&domain=real")]
    np.testing.assert_array_equal(*without)  # it learned without, and is told nothing


Maker = Callable[[Path], Path]
"""Saves a checkpoint in a folder, and gives what is loaded."""


def saved(spoil: Callable[[Path], object] = lambda _folder: None, **options: Any) -> Maker:
    """Saves an ACT with some options, and then spoils it."""

    def make(folder: Path) -> Path:
        spoil(checkpoints.act(folder, **options))
        return folder

    return make


def seeing(key: str, kind: FeatureType, shape: tuple[int, ...]) -> Maker:
    """Saves one that sees one feature more, or one in another shape."""
    features = checkpoints.features()
    features["input_features"][f"observation.{key}"] = PolicyFeature(kind, shape)
    return saved(**features)


def with_config(**values: Any) -> Callable[[Path], None]:
    return lambda folder: change(folder, "config.json", **values)


def test_each_camera_has_the_size_that_a_checkpoint_sees(tmp_path: Path) -> None:
    make_policy = seeing("images.head", FeatureType.VISUAL, (3, SIZE, 2 * SIZE))
    metadata = load(make_policy(tmp_path / "policy")).metadata
    assert metadata.image_size is None
    assert metadata.image_sizes == {"head": (SIZE, 2 * SIZE), "left_wrist": (SIZE, SIZE)}


@pytest.mark.parametrize(
    ("make", "query", "message"),
    [
        (saved(), "&steps=31", "predicts 30 actions, not 31"),
        (saved(), "&stops=3", "Did you mean 'steps'"),
        (saved(), "&dtype=bfloat16", "runs in float32"),
        (checkpoints.diffusion, "&steps=1", "sees 2 observations at a time"),
        (lambda folder: folder, "", "There is no folder"),
        (saved(**checkpoints.features(width=14)), "", "actions have 14 numbers"),
        (
            saved(**checkpoints.features(width=14)),
            "&action=cartesian",
            "14 numbers, those of mode 'cartesian' 20",
        ),
        (
            saved(**checkpoints.features(("head", "left_wirst"))),
            "",
            "did you mean observation.images.left_wrist",
        ),
        (
            saved(with_config(temporal_ensemble_coeff=0.01), n_action_steps=1),
            "",
            "temporal_ensemble_coeff",
        ),
        (seeing("more", FeatureType.ENV, (3,)), "", "also sees observation.more"),
        (
            lambda folder: checkpoints.act(folder / LAST).parents[2],
            "",
            f"Did you mean .*{LAST}",
        ),
        (
            saved(lambda folder: (folder / "policy_preprocessor.json").unlink()),
            "",
            "migrate_policy_normalization",
        ),
        (saved(with_config(n_encoder_layers=2)), "", "Missing key"),  # that the weights lack
    ],
)
def test_what_does_not_fit_is_rejected(tmp_path: Path, make: Any, query: str, message: str) -> None:
    folder = make(tmp_path / "policy")
    with pytest.raises(DuoBenchError, match=message):
        load(folder, query)


def test_a_device_that_is_not_there_is_rejected(folders: dict[str, Path]) -> None:
    for device, message in (("gpu", "knows no device"), ("mps", "no device 'mps' here")):
        with pytest.raises(DuoBenchError, match=message):
            policy.make(f"lerobot:{folders['act']}?device={device}")
