"""Playing recorded targets or states again: verification, videos, replays in 3D, divergence."""

from typing import TYPE_CHECKING

from duobench.references import lazy

if TYPE_CHECKING:
    from duobench.replay.player import Divergence as Divergence, replay as replay
    from duobench.replay.verify import (
        Finding as Finding,
        Verdict as Verdict,
        Verification as Verification,
        verify as verify,
    )

lazy(__name__)
