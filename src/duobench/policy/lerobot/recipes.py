"""How LeRobot trains each kind of policy: options, and whose choice each of them is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from duobench.policy.lerobot.address import EXECUTED

DOMAIN = "domain"
"""Column of an export that says where a row is from: 0 simulation, 1 real robot."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Setting:
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
    steps: int
    """Steps of the optimizer."""
    steps_why: str
    """Where their number comes from."""
    workers: int
    """Most processes that decode images."""
    extra: str
    """Extra of LeRobot that this kind of policy needs."""
    one_task: bool = False
    """Whether a policy learns one task; otherwise it is told what to do."""
    takes_domains: bool = False
    """Whether simulated and real episodes can be told apart."""


_EXECUTED = Setting(
    option="policy.n_action_steps",
    value=str(EXECUTED),
    why=f"paper: {EXECUTED} actions are executed of each chunk",
)
_BFLOAT16 = Setting(
    option="policy.dtype", value="bfloat16", why="ours: half the memory; the paper does not say"
)
_BATCH = Setting(option="batch_size", value="32", why="ours: the paper does not say")

_ACT = (
    Setting(option="policy.type", value="act", why="paper: one ACT for each task"),
    Setting(
        option="policy.chunk_size",
        value=str(EXECUTED),
        why="ours: it predicts what is executed; the paper does not say",
    ),
    _EXECUTED,
)

_SMALL_ACT = (
    Setting(
        option="policy.pretrained_backbone_weights", value="null", why="ours: nothing to download"
    ),
    Setting(option="policy.dim_model", value="128", why="ours: a quarter of the default"),
    Setting(option="policy.n_heads", value="4", why="ours: 32 numbers a head"),
    Setting(option="policy.dim_feedforward", value="512", why="ours: four times dim_model"),
    Setting(option="policy.n_encoder_layers", value="2", why="ours: half the default"),
    Setting(option="policy.n_vae_encoder_layers", value="2", why="ours: half the default"),
    Setting(option="policy.dropout", value="0.0", why="ours: too few steps to overfit"),
    Setting(
        option="policy.optimizer_lr",
        value="1e-4",
        why="ours: ten times the default, because there are 25 times fewer steps",
    ),
    Setting(
        option="policy.optimizer_lr_backbone", value="1e-4", why="ours: it learns from nothing"
    ),
    Setting(option="batch_size", value="16", why="ours: half a second a step on two cores"),
    Setting(option="save_freq", value="500", why="ours: a checkpoint every few minutes"),
)

RECIPES: Mapping[str, Recipe] = MappingProxyType(
    {
        "act": Recipe(
            settings=(*_ACT, _BATCH),
            steps=100_000,
            steps_why="ours: LeRobot's default; the paper does not say",
            workers=14,
            extra="training",
            one_task=True,
        ),
        "pi05": Recipe(
            settings=(
                Setting(option="policy.type", value="pi05", why="paper: one π0.5 for all tasks"),
                Setting(
                    option="policy.pretrained_path",
                    value="lerobot/pi05_base",
                    why="ours: LeRobot's copy of the published weights",
                ),
                _EXECUTED,
                _BFLOAT16,
                Setting(
                    option="policy.gradient_checkpointing",
                    value="true",
                    why="ours: fits into 80 GB",
                ),
                _BATCH,
            ),
            steps=30_000,
            steps_why="ours: the length of its learning rate's decay; the paper does not say",
            workers=14,
            extra="training,pi",
        ),
        "xvla": Recipe(
            settings=(
                Setting(
                    option="policy.path",
                    value="lerobot/xvla-base",
                    why="paper: one X-VLA for all tasks; LeRobot's copy of the weights",
                ),
                Setting(
                    option="policy.input_features",
                    value="null",
                    why="ours: names of the data set's cameras, not of the base's",
                ),
                Setting(
                    option="policy.action_mode",
                    value="auto",
                    why="paper: joint actions of 16 numbers; the base's mode is tool poses",
                ),
                _EXECUTED,
                _BFLOAT16,
                _BATCH,
            ),
            steps=20_000,
            steps_why="ours: the paper does not say",
            workers=14,
            extra="training,xvla",
            takes_domains=True,
        ),
    }
)
"""Recipes with the paper's settings, by the names of LeRobot's kinds of policies."""

SMALL: Mapping[str, Recipe] = MappingProxyType(
    {
        "act": Recipe(
            settings=(*_ACT, *_SMALL_ACT),
            steps=4000,
            steps_why="ours: about half an hour on two cores",
            workers=1,
            extra="training",
            one_task=True,
        )
    }
)
"""Recipes for a processor: not the paper's, to see that everything works together."""
