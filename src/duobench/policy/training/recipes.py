"""LeRobot's training of each kind of policy: options, and the source of each choice."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from duobench.core.lerobot_keys import EXECUTED


class Setting(NamedTuple):
    """One option of `lerobot-train`, without dashes, and its value."""

    option: str
    value: str
    why: str
    """Source of the value: the paper, the checkpoints that its authors have published since
    (their model cards, November 2026), or a choice of ours and its reason."""

    @property
    def argument(self) -> str:
        """The option as it is given."""
        return f"--{self.option}={self.value}"


@dataclass(frozen=True, kw_only=True, slots=True)
class TrainingRecipe:
    """Training options of one kind of policy."""

    settings: tuple[Setting, ...]
    """Options, in the order in which they are given."""
    steps: Setting
    """Steps of the optimizer, unless other ones are chosen."""
    workers: int
    """Most processes that decode images."""
    one_task: bool = False
    """Whether a policy learns one task; otherwise it takes an instruction."""
    takes_domains: bool = False
    """Whether simulated and real episodes can be distinguished."""


def _settings(table: str) -> tuple[Setting, ...]:
    """Settings from a table with a line `option=value why` for each."""
    rows = (line.split(maxsplit=1) for line in table.strip().splitlines())
    named = ((*option.partition("=")[::2], why) for option, why in rows)
    return tuple(Setting(option, value, why) for option, value, why in named)


def _steps(steps: int, why: str) -> Setting:
    return Setting("steps", str(steps), why)


_EXECUTED = f"policy.n_action_steps={EXECUTED} paper: {EXECUTED} actions are executed of each chunk"
_BFLOAT16 = "policy.dtype=bfloat16 ours: half the memory"
_AUTHORS = "authors: as in their published checkpoint"
_SEED = f"seed=1000 {_AUTHORS}"

_ACT = _settings(f"""
    policy.type=act paper: one ACT for each task
    {_EXECUTED}
""")
_AS_THE_AUTHORS = _settings(f"""
    policy.chunk_size=100 {_AUTHORS}
    policy.optimizer_lr=1e-5 {_AUTHORS}
    batch_size=64 {_AUTHORS}
    {_SEED}
""")
_CHUNK = _settings(f"policy.chunk_size={EXECUTED} ours: it predicts what is executed")
_SMALL_TRANSFORMER = _settings("""
    policy.dim_model=128 ours: a quarter of the default
    policy.n_heads=4 ours: 32 numbers a head
    policy.dim_feedforward=512 ours: four times dim_model
    policy.n_encoder_layers=2 ours: half the default
    policy.n_vae_encoder_layers=2 ours: half the default
    policy.dropout=0.0 ours: too few steps to overfit
""")
_NO_BACKBONE = _settings(
    "policy.pretrained_backbone_weights=null ours: nothing to download"
)
_SMALL_ACT = _settings("""
    policy.optimizer_lr=1e-4 ours: ten times the default, because there are 25 times fewer steps
    policy.optimizer_lr_backbone=1e-4 ours: it learns from nothing
    batch_size=16 ours: half a second a step on two cores
    save_freq=500 ours: a checkpoint every few minutes
""")
_PI05 = _settings(f"""
    policy.type=pi05 paper: one π0.5 for all tasks
    policy.pretrained_path=lerobot/pi05_base authors: LeRobot's copy of the weights, at 9e55186
    policy.chunk_size=50 {_AUTHORS}
    {_EXECUTED}
    policy.optimizer_lr=2.5e-5 {_AUTHORS}
    {_BFLOAT16}
    policy.gradient_checkpointing=true ours: fits into 80 GB
    batch_size=16 {_AUTHORS}
    {_SEED}
""")
_XVLA = _settings(f"""
    policy.path=lerobot/xvla-base paper: one X-VLA for all tasks; LeRobot's copy of the weights
    policy.input_features=null ours: names of the data set's cameras, not of the base's
    policy.action_mode=auto paper: joint actions of 16 numbers; the base's mode is tool poses
    policy.chunk_size=30 {_AUTHORS}
    {_EXECUTED}
    policy.optimizer_lr=1e-4 {_AUTHORS}
    {_BFLOAT16}
    batch_size=48 {_AUTHORS}
    {_SEED}
""")
_SMOLVLA = _settings(f"""
    policy.path=lerobot/smolvla_base ours: LeRobot's base; the paper has no SmolVLA
    policy.input_features=null ours: names of the data set's cameras, not of the base's
    {_EXECUTED}
    batch_size=64 ours: as the base's card says
""")
_GROOT = _settings(f"""
    policy.type=groot ours: the paper has no GR00T
    policy.base_model_path=nvidia/GR00T-N1.7-3B ours: the version that LeRobot 0.6 has
    {_EXECUTED}
    batch_size=32 ours: for one card of 80 GB
""")

RECIPES: Mapping[str, TrainingRecipe] = {
    "act": TrainingRecipe(
        settings=_ACT + _AS_THE_AUTHORS,
        steps=_steps(150000, _AUTHORS),
        workers=14,
        one_task=True,
    ),
    "pi05": TrainingRecipe(
        settings=_PI05,
        steps=_steps(40000, _AUTHORS),
        workers=14,
    ),
    "xvla": TrainingRecipe(
        settings=_XVLA,
        steps=_steps(40000, _AUTHORS),
        workers=14,
        takes_domains=True,
    ),
    "smolvla": TrainingRecipe(
        settings=_SMOLVLA,
        steps=_steps(20000, "ours: as the base's card says"),
        workers=14,
    ),
    "groot": TrainingRecipe(
        settings=_GROOT,
        steps=_steps(20000, "ours: as in NVIDIA's LeRobot checkpoint of LIBERO"),
        workers=14,
    ),
}
"""Recipes by the names of LeRobot's kinds of policies: of those that the paper has, with its
settings and its authors'."""

SMALL: Mapping[str, TrainingRecipe] = {
    "act": TrainingRecipe(
        settings=_ACT + _CHUNK + _NO_BACKBONE + _SMALL_TRANSFORMER + _SMALL_ACT,
        steps=_steps(4000, "ours: about half an hour on two cores"),
        workers=1,
        one_task=True,
    )
}
"""Recipes for a processor: not the paper's, to see that everything works together."""

_OBJECTS = _settings("""
    batch_size=64 ours: rows without images are small
    policy.device=cpu ours: needs no graphics card
    save_freq=2000 ours: a checkpoint every few minutes
""")
_OBJECTS_ACT = _settings("""
    policy.optimizer_lr=5e-4 ours: with 1e-4 the loss still falls at the end
""")
_DIFFUSION = _settings(f"""
    policy.type=diffusion ours: the paper has none
    policy.horizon=32 ours: the chunk, and what its convolutions need beside it
    policy.n_obs_steps=2 ours: LeRobot's default
    {_EXECUTED}
    policy.drop_n_last_frames=1 ours: 32 actions less those that are executed
    policy.down_dims=[64,128,256] ours: an eighth of the default
    policy.noise_scheduler_type=DDIM ours: a tenth of the steps at play
    policy.num_inference_steps=10 ours: see the scheduler
    policy.prediction_type=sample ours: with noise 4,000 steps learned nothing
    policy.optimizer_lr=5e-4 ours: five times the default, for few steps
""")
OBJECT_STATES: Mapping[str, TrainingRecipe] = {
    kind: TrainingRecipe(
        settings=settings + _OBJECTS,
        steps=_steps(
            4000, "ours: half an hour on a busy core; the loss still falls a little"
        ),
        workers=0,
        one_task=True,
    )
    for kind, settings in {
        "act": _ACT + _CHUNK + _SMALL_TRANSFORMER + _OBJECTS_ACT,
        "diffusion": _DIFFUSION,
    }.items()
}
"""Recipes for data sets of object states without images, on a processor; not the paper's."""
