"""A step of LeRobot's processors that executes what the operator leads."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from lerobot.processor import EnvTransition, ProcessorStep, ProcessorStepRegistry, TransitionKey
from lerobot.processor.hil_processor import TELEOP_ACTION_KEY
from lerobot.teleoperators.utils import TeleopEvents

from lerobot_teleoperator_duobench.teleoperator import KEYS


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
