"""Playing recorded targets or states again: verification, videos, replays in 3D, divergence."""

from typing import TYPE_CHECKING

from duobench.core.references import lazy

if TYPE_CHECKING:
    from duobench.evaluation.replay.player import Divergence as Divergence, replay as replay
    from duobench.evaluation.replay.verify import (
        Finding as Finding,
        Verdict as Verdict,
        Verification as Verification,
        verify as verify,
    )

lazy(__name__)
