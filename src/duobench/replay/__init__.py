"""Playing recorded targets or states again: verification, videos, replays in 3D, divergence."""

from typing import TYPE_CHECKING

from duobench.references import lazy

if TYPE_CHECKING:
    from duobench.replay.player import Divergence as Divergence
    from duobench.replay.player import replay as replay
    from duobench.replay.verify import Finding as Finding
    from duobench.replay.verify import Verdict as Verdict
    from duobench.replay.verify import Verification as Verification
    from duobench.replay.verify import verify as verify

lazy(__name__)
