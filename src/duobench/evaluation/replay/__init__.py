"""Playing recorded targets or states again: verification, videos, replays in 3D, divergence."""

from typing import TYPE_CHECKING

from duobench.core.references import lazy

if TYPE_CHECKING:
    from duobench.evaluation.replay.player import (
        Divergence as Divergence,
        replay as replay,
    )
    from duobench.evaluation.replay.verification import (
        Finding as Finding,
        Verdict as Verdict,
        Verification as Verification,
        verify as verify,
    )
else:
    __getattr__, __dir__, __all__ = lazy(
        __name__,
        {
            "duobench.evaluation.replay.player": ["Divergence", "replay"],
            "duobench.evaluation.replay.verification": [
                "Finding",
                "Verdict",
                "Verification",
                "verify",
            ],
        },
    )
