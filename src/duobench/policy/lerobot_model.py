"""A LeRobot checkpoint as a policy, with its own processors; it needs LeRobot and torch."""

from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import torch  # pyright: ignore[reportMissingImports]
from lerobot.configs import PreTrainedConfig  # pyright: ignore[reportMissingImports]
from lerobot.policies import (  # pyright: ignore[reportMissingImports]
    get_policy_class,
    make_pre_post_processors,
)
from lerobot.utils.device_utils import (  # pyright: ignore[reportMissingImports]
    auto_select_torch_device,
    is_torch_device_available,
)
from safetensors import safe_open  # pyright: ignore[reportMissingImports]
from torch.overrides import TorchFunctionMode  # pyright: ignore[reportMissingImports]

from duobench.core.errors import PolicyError
from duobench.core.lerobot_keys import (
    DOMAINS,
    EXECUTED,
    IMAGE_PREFIX,
    OBJECT_STATE,
    STATE,
)
from duobench.envs.state_labels import shown
from duobench.policy import lerobot_checkpoint as checkpoint
from duobench.policy.batch import (
    NOISE_STREAM,
    Chunk,
    Observation,
    Session,
)
from duobench.policy.lerobot_checkpoint import (
    DIFFUSION,
    GROOT,
    horizon,
    inputs,
    labels_of,
    object_numbers,
    robot_of,
    state_parts,
)
from duobench.policy.policy import PolicyMetadata
from duobench.tasks.object_state import ENVIRONMENT_STATE

_RENAMING = "rename_observations_processor"
_DTYPES = ("bfloat16", "float32")
_NORMAL = (torch.randn, torch.randn_like, torch.normal)
_PREFIX = "model."
"""Prefix that published weights leave out of their names."""
_MOST_NAMED = 3


@dataclass(kw_only=True, slots=True)
class LeRobotSession(Session):
    """One episode of a LeRobot policy."""

    past: tuple[Observation, ...] = ()
    """The last observations, for a model that sees more than one."""
    left: Chunk | None = None
    """Actions of the last chunk that are executed one by one, so that what lies between them is
    seen."""


class LeRobotPolicy:
    """A checkpoint of LeRobot that returns chunks, for one episode or several at a time.

    The model is asked for a chunk with `predict_action_chunk`; the queues inside LeRobot's policies
    stay empty, so that the state of an episode is in its session alone. A model that sees the last
    n observations is shown n consecutive ones, as in training: the last n - 1 actions of a chunk
    are given one at a time. The text is what `lerobot_checkpoint.parse` reads; what cannot be
    loaded, or does not fit this benchmark, is a `PolicyError`.
    """

    def __init__(self, text: str) -> None:
        address = checkpoint.parse(text)
        folder = checkpoint.find(address.checkpoint)
        device = _device(address.device)
        config = PreTrainedConfig.from_pretrained(folder)
        action = config.action_feature
        size = 0 if action is None else int(action.shape[0])
        self._labels = labels_of(folder, size, address.action)
        longest = horizon(config)
        self._steps = _steps(address.steps, longest)
        self._past = config.n_obs_steps if config.type == DIFFUSION else None
        if config.type in (DIFFUSION, GROOT):
            config.n_action_steps = (
                longest  # it predicts no more than it is going to execute
            )
        if self._past is not None and self._steps < self._past:
            raise PolicyError(
                f"The checkpoint sees {self._past} observations at a time, so at least that "
                f"many of its actions are executed, not {self._steps}."
            )
        _configure(config, folder, device, address.dtype)
        self._model = get_policy_class(config.type).from_pretrained(
            folder, config=config, strict=True
        )
        _check_loaded(self._model, folder / checkpoint.WEIGHTS)
        self._before, self._after = make_pre_post_processors(
            config,
            pretrained_path=str(folder),
            preprocessor_overrides={"device_processor": {"device": device}},
        )
        self._precision = (
            torch.autocast(device_type=torch.device(device).type)
            if config.use_amp
            else nullcontext()
        )
        sizes = inputs(config, _rename_map(self._before))
        self._cameras, several = tuple(sizes), len({*sizes.values()}) > 1
        self._state_parts = state_parts(folder, config)
        self._object_numbers = object_numbers(config)
        self._domain_key = getattr(config, "domain_feature_key", None)
        self._domain = DOMAINS.index(address.domain)
        mode = self._labels.mode.name
        self.metadata = PolicyMetadata(
            name=f"lerobot {config.type}",
            cameras=self._cameras,
            object_state=self._object_numbers > 0,
            image_size=None if several else next(iter(sizes.values()), None),
            image_sizes=sizes if several else {},
            action_mode=mode,
            robot=robot_of(folder),
            version=_version(
                folder, self._steps, mode, self._model, device, config.use_amp
            )
            + (f", domain {address.domain}" if self._domain_key else ""),
            horizon=None if self._past is not None else self._steps,
            dtype=_dtype(self._model),
            device=torch.device(device).type,
        )
        """Expectations on the environment, and a version that names checkpoint, numbers and
        device."""

    def begin(self, instruction: str, seed: int) -> LeRobotSession:
        """Begin an episode, beside those that are under way."""
        return LeRobotSession(instruction=instruction, seed=seed)

    def act_batch(
        self, sessions: Sequence[LeRobotSession], observations: Sequence[Observation]
    ) -> list[Chunk]:
        """The next actions (H, n) in each episode, in the action mode that the metadata name."""
        pairs = [
            (session, self._window(session, observation))
            for session, observation in zip(sessions, observations, strict=True)
        ]
        pending = [pair for pair in pairs if pair[0].left is None]
        chunks = iter(self._predict(pending) if pending else ())
        one_by_one = (self._past or 1) - 1
        executed = []
        for session, window in pairs:
            if session.left is None:
                chunk = next(chunks)
                first, left = np.split(chunk, [len(chunk) - one_by_one])
            else:
                first, left = np.split(session.left, [1])
            session.left = left if len(left) else None
            session.past = window[1:]
            executed.append(first)
        return executed

    def _window(
        self, session: LeRobotSession, observation: Observation
    ) -> tuple[Observation, ...]:
        past = self._past or 1
        before = session.past or (observation,) * (past - 1)
        return (*before, observation)[-past:]

    def _predict(
        self, pending: Sequence[tuple[LeRobotSession, tuple[Observation, ...]]]
    ) -> list[Chunk]:
        """One call of the model: the actions (steps, n) that are executed of each chunk."""
        sessions, windows = zip(*pending, strict=True)
        batch: dict[str, Any] = {
            STATE: self._stacked(windows, lambda one: shown(one, self._state_parts))
        }
        if self._object_numbers:
            batch[OBJECT_STATE] = self._stacked(windows, self._objects)
        for camera in self._cameras:
            images = self._stacked(
                windows, lambda one, name=camera: one["pixels"][name]
            )
            channels_first = images.movedim(-1, -3).contiguous().float()
            batch[IMAGE_PREFIX + camera] = channels_first / 255
        batch["task"] = [session.instruction for session in sessions]
        keys = [(session.seed, session.call) for session in sessions]
        with torch.inference_mode(), self._precision, EpisodeNoise(keys):
            prepared = self._before(batch)
            if self._domain_key:  # the processors drop it
                domains = torch.full((len(sessions),), self._domain)
                prepared[self._domain_key] = domains.to(prepared[STATE].device)
            actions = self._model.predict_action_chunk(prepared)
        actions = self._after(actions[:, : self._steps])
        return [self._labels.to_actions(rows) for rows in actions.float().cpu().numpy()]

    def _objects(self, observation: Observation) -> Chunk:
        """State of the objects; tasks differ in how many numbers that is."""
        numbers = np.asarray(observation[ENVIRONMENT_STATE], np.float32)
        if len(numbers) != self._object_numbers:
            raise PolicyError(
                f"The checkpoint sees {self._object_numbers} numbers of objects, this task has "
                f"{len(numbers)}: it learned another task."
            )
        return numbers

    def _stacked(self, windows: Sequence[tuple[Observation, ...]], value: Any) -> Any:
        """A tensor (B, ...), or (B, n, ...) for a model that sees n observations."""
        rows = [np.stack([value(one) for one in window]) for window in windows]
        stacked = torch.from_numpy(np.stack(rows))
        return stacked if self._past is not None else stacked[:, 0]


def _device(wanted: str | None) -> str:
    if wanted is None:
        return str(auto_select_torch_device())
    try:
        is_there = is_torch_device_available(str(torch.device(wanted).type))
    except (RuntimeError, ValueError) as error:
        raise PolicyError(f"torch knows no device {wanted!r}: {error}") from error
    if not is_there:
        raise PolicyError(f"There is no device {wanted!r} here; cpu always works.")
    return wanted


def _steps(wanted: int | None, longest: int) -> int:
    if wanted is not None and wanted > longest:
        raise PolicyError(f"The checkpoint predicts {longest} actions, not {wanted}.")
    return wanted or min(EXECUTED, longest)


def _configure(
    config: Any,
    folder: Path,
    device: str,
    dtype: str | None,
) -> None:
    """Say in the configuration where and in which numbers the model runs."""
    config.pretrained_path, config.device = folder, device
    if hasattr(config, "pretrained_backbone_weights"):
        config.pretrained_backbone_weights = None  # they are in the checkpoint
    if hasattr(config, "compile_model"):
        config.compile_model = False  # a compiled model samples its noise out of sight
    if torch.device(device).type == "cuda":
        torch.backends.cudnn.deterministic = True
        torch.backends.cudnn.benchmark = False
    if dtype is None:
        return
    known = _DTYPES if hasattr(config, "dtype") else _DTYPES[1:]
    if dtype not in known:
        raise PolicyError(
            f"A checkpoint of type {config.type} runs in {' or '.join(known)}, not in {dtype!r}."
        )
    if hasattr(config, "dtype"):
        config.dtype = dtype


def _rename_map(processor: Any) -> Mapping[str, str]:
    """Map from names of the environment to names in the checkpoint, as trained."""
    steps = (
        step
        for step in processor.steps
        if getattr(step, "_registry_name", "") == _RENAMING
    )
    return next((step.rename_map for step in steps), {})


def _dtype(model: Any) -> str:
    return "+".join(
        sorted({str(v.dtype).removeprefix("torch.") for v in model.parameters()})
    )


def _version(
    folder: Path, steps: int, mode: str, model: Any, device: str, amp: bool
) -> str:
    """Version of a policy: checkpoint, actions executed, numbers, device, libraries."""
    where = torch.device(device)
    card = f" ({torch.cuda.get_device_name(where)})" if where.type == "cuda" else ""
    return (
        f"checkpoint {checkpoint.content_hash(folder)[:16]}, {steps} {mode} actions a chunk, "
        f"{_dtype(model)}{' with autocast' if amp else ''} on {where.type}{card}, "
        f"lerobot {version('lerobot')}, torch {torch.__version__}"
    )


class EpisodeNoise(TorchFunctionMode):
    """While active, normal noise for a batch is made row by row, each from its own generator.

    Models differ in whether they take noise as an argument and how often they sample, but all of
    them sample with torch and put the batch first, so noise is replaced there. It is made on the
    processor by NumPy, the same on every device, from the seed of the episode and the number of the
    call in it, for each row.
    """

    def __init__(self, keys: Sequence[tuple[int, int]]) -> None:
        super().__init__()
        self._generators = [np.random.default_rng((NOISE_STREAM, *key)) for key in keys]
        # Everything else that a model samples depends on the whole batch, at least.
        seeds = np.random.SeedSequence([number for key in keys for number in key])
        torch.manual_seed(int(seeds.generate_state(1)[0]))

    def __torch_function__(
        self, func: Any, types: Any, args: tuple[Any, ...] = (), kwargs: Any = None
    ) -> Any:
        kwargs = kwargs or {}
        result = func(*args, **kwargs)
        if (
            func not in _NORMAL
            or not result.ndim
            or len(result) != len(self._generators)
        ):
            return result
        rows = [
            generator.standard_normal(result.shape[1:], dtype=np.float32)
            for generator in self._generators
        ]
        noise = torch.from_numpy(np.stack(rows)).to(result)
        if func is torch.normal:
            named = {
                "mean": 0.0,
                "std": 1.0,
                **dict(zip(("mean", "std"), args, strict=False)),
            }
            named |= kwargs
            return noise * named["std"] + named["mean"]
        return noise


def _check_loaded(model: Any, file: Path) -> None:
    """Compare a model with the file of its weights, by the first row of every tensor.

    LeRobot's π0 and π0.5 go on with random weights where loading fails, and only print a warning.
    """
    state = model.state_dict()
    with safe_open(file, framework="pt") as weights:
        names = {
            name if name in state else _PREFIX + name: name
            for name in weights.keys()  # noqa: SIM118 - no mapping
        }
        wrong = [
            own
            for own, name in names.items()
            if own in state and not _is_equal(state[own], weights.get_slice(name))
        ]
    there = {
        state[name].data_ptr() for name in names if name in state
    }  # some share memory
    wrong += [
        name
        for name, value in state.items()
        if name not in names and value.data_ptr() not in there
    ]
    if wrong:
        listed = ", ".join(wrong[:_MOST_NAMED]) + (
            " …" if len(wrong) > _MOST_NAMED else ""
        )
        raise PolicyError(
            f"{len(wrong)} of {len(state)} weights of the model are not those of {file}: {listed}. "
            "The file belongs to another configuration or another version of LeRobot."
        )


def _is_equal(own: Any, saved: Any) -> bool:
    if list(own.shape) != saved.get_shape():
        return False
    first = slice(1) if own.ndim else ...
    return torch.equal(own[first].cpu(), saved[first].to(own.dtype))
