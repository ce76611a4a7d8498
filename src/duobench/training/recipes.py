"""How LeRobot trains each kind of policy: options, and whose choice each of them is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from duobench.lerobot_keys import EXECUTED


class Setting(NamedTuple):
    """One option of `lerobot-train`."""

    option: str
    """Its name, without dashes."""
    value: str
    """Its value."""
    why: str
    """Where the value comes from: the paper, or a choice of ours and its reason."""

    @property
    def argument(self) -> str:
        """The option as it is given."""
        return f"--{self.option}={self.value}"


@dataclass(frozen=True, kw_only=True, slots=True)
class Recipe:
    """How one kind of policy is trained."""

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


_EXECUTED = Setting(
    "policy.n_action_steps", str(EXECUTED), f"paper: {EXECUTED} actions are executed of each chunk"
)
_BFLOAT16 = Setting("policy.dtype", "bfloat16", "ours: half the memory; the paper does not say")
_BATCH = Setting("batch_size", "32", "ours: the paper does not say")

_ACT = (
    Setting("policy.type", "act", "paper: one ACT for each task"),
    Setting(
        "policy.chunk_size",
        str(EXECUTED),
        "ours: it predicts what is executed; the paper does not say",
    ),
    _EXECUTED,
)

_SMALL_TRANSFORMER = (
    Setting("policy.dim_model", "128", "ours: a quarter of the default"),
    Setting("policy.n_heads", "4", "ours: 32 numbers a head"),
    Setting("policy.dim_feedforward", "512", "ours: four times dim_model"),
    Setting("policy.n_encoder_layers", "2", "ours: half the default"),
    Setting("policy.n_vae_encoder_layers", "2", "ours: half the default"),
    Setting("policy.dropout", "0.0", "ours: too few steps to overfit"),
)
_SMALL_ACT = (
    Setting("policy.pretrained_backbone_weights", "null", "ours: nothing to download"),
    *_SMALL_TRANSFORMER,
    Setting(
        "policy.optimizer_lr",
        "1e-4",
        "ours: ten times the default, because there are 25 times fewer steps",
    ),
    Setting("policy.optimizer_lr_backbone", "1e-4", "ours: it learns from nothing"),
    Setting("batch_size", "16", "ours: half a second a step on two cores"),
    Setting("save_freq", "500", "ours: a checkpoint every few minutes"),
)

_PI05 = (
    Setting("policy.type", "pi05", "paper: one π0.5 for all tasks"),
    Setting(
        "policy.pretrained_path",
        "lerobot/pi05_base",
        "ours: LeRobot's copy of the published weights",
    ),
    _EXECUTED,
    _BFLOAT16,
    Setting("policy.gradient_checkpointing", "true", "ours: fits into 80 GB"),
    _BATCH,
)

_XVLA = (
    Setting(
        "policy.path",
        "lerobot/xvla-base",
        "paper: one X-VLA for all tasks; LeRobot's copy of the weights",
    ),
    Setting(
        "policy.input_features", "null", "ours: names of the data set's cameras, not of the base's"
    ),
    Setting(
        "policy.action_mode",
        "auto",
        "paper: joint actions of 16 numbers; the base's mode is tool poses",
    ),
    _EXECUTED,
    _BFLOAT16,
    _BATCH,
)

RECIPES: Mapping[str, Recipe] = {
    "act": Recipe(
        settings=(*_ACT, _BATCH),
        steps=Setting("steps", "100000", "ours: LeRobot's default; the paper does not say"),
        workers=14,
        one_task=True,
    ),
    "pi05": Recipe(
        settings=_PI05,
        steps=Setting(
            "steps",
            "30000",
            "ours: the length of its learning rate's decay; the paper does not say",
        ),
        workers=14,
    ),
    "xvla": Recipe(
        settings=_XVLA,
        steps=Setting("steps", "20000", "ours: the paper does not say"),
        workers=14,
        takes_domains=True,
    ),
}
"""Recipes with the paper's settings, by the names of LeRobot's kinds of policies."""

SMALL: Mapping[str, Recipe] = {
    "act": Recipe(
        settings=(*_ACT, *_SMALL_ACT),
        steps=Setting("steps", "4000", "ours: about half an hour on two cores"),
        workers=1,
        one_task=True,
    )
}
"""Recipes for a processor: not the paper's, to see that everything works together."""

_OBJECTS = (
    Setting("batch_size", "64", "ours: rows without images are small"),
    Setting("policy.device", "cpu", "ours: needs no graphics card"),
    Setting("save_freq", "2000", "ours: a checkpoint every few minutes"),
)
_OBJECTS_ACT = (
    *_ACT,
    *_SMALL_TRANSFORMER,
    Setting("policy.optimizer_lr", "5e-4", "ours: with 1e-4 the loss still falls at the end"),
)
_DIFFUSION = (
    Setting("policy.type", "diffusion", "ours: the paper has none"),
    Setting("policy.horizon", "32", "ours: the chunk, and what its convolutions need beside it"),
    Setting("policy.n_obs_steps", "2", "ours: LeRobot's default"),
    _EXECUTED,
    Setting("policy.drop_n_last_frames", "1", "ours: 32 actions less those that are executed"),
    Setting("policy.down_dims", "[64,128,256]", "ours: an eighth of the default"),
    Setting("policy.noise_scheduler_type", "DDIM", "ours: a tenth of the steps at play"),
    Setting("policy.num_inference_steps", "10", "ours: see the scheduler"),
    Setting("policy.prediction_type", "sample", "ours: with noise 4,000 steps learned nothing"),
    Setting("policy.optimizer_lr", "5e-4", "ours: five times the default, for few steps"),
)
OBJECT_STATES: Mapping[str, Recipe] = {
    kind: Recipe(
        settings=(*settings, *_OBJECTS),
        steps=Setting(
            "steps", "4000", "ours: half an hour on a busy core; the loss still falls a little"
        ),
        workers=0,
        one_task=True,
    )
    for kind, settings in {"act": _OBJECTS_ACT, "diffusion": _DIFFUSION}.items()
}
"""Recipes for data sets of object states without images, on a processor; not the paper's."""
