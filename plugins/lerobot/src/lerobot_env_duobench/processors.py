"""What LeRobot's processors need to know: how an operator leads, and the column `domain`."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from lerobot.processor import (
    EnvTransition,
    ProcessorStep,
    ProcessorStepRegistry,
    TransitionKey,
    converters,
)
from lerobot.processor.hil_processor import TELEOP_ACTION_KEY
from lerobot.teleoperators.utils import TeleopEvents

from duobench.core.lerobot_keys import DOMAIN
from lerobot_env_duobench.config import KEYS


def pass_domains_on() -> None:
    """Have LeRobot's processors pass the column on, with the task and the index of a row.

    X-VLA has an option, `domain_feature_key`, that names a column with the domain of each row. The
    processors of LeRobot 0.6 drop all columns but those of a fixed list before X-VLA sees them, and
    then the option does nothing.
    """
    if DOMAIN not in converters._COMPLEMENTARY_KEYS:
        converters._COMPLEMENTARY_KEYS += (DOMAIN,)


@ProcessorStepRegistry.register("duobench_lead_arms")
@dataclass
class LeadArms(ProcessorStep):
    """Puts the 16 numbers of the teleoperator in place of the action, and ends episodes.

    It belongs behind LeRobot's `AddTeleopActionAsComplimentaryDataStep` and
    `AddTeleopEventsAsInfoStep`, in the place of `InterventionActionProcessorStep`, which knows
    displacements of one tool alone.
    """

    def __call__(self, transition: EnvTransition) -> EnvTransition:
        """The transition with the operator's action; keep ends it with reward 1, discard with 0."""
        numbers = transition[TransitionKey.COMPLEMENTARY_DATA][TELEOP_ACTION_KEY]
        events = transition[TransitionKey.INFO]
        changed = transition.copy()
        changed[TransitionKey.ACTION] = torch.tensor([numbers[key] for key in KEYS])
        changed[TransitionKey.DONE] = events[TeleopEvents.TERMINATE_EPISODE]
        changed[TransitionKey.REWARD] = float(events[TeleopEvents.SUCCESS])
        return changed

    def transform_features(self, features):
        """Features stay as they are."""
        return features
